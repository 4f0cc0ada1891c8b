"""The full robot reduces to the pendulum, and what does not fit is reported."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from m4_dynamics.errors import RobotDescriptionError, UnknownNameError
from m4_dynamics.reduced import pendulum
from m4_dynamics.reduced.ground_force import ground_force_in_slope
from m4_dynamics.reduced.reduction import Reduction, contact_wrench, reduce_robot, residual, velocity_map
from m4_dynamics.reduced.reduction.projection import planar_configuration, planar_input_map
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Balance, Robot


def random_states(rng: np.random.Generator, count: int):
    for _ in range(count):
        state = rng.uniform((-10.0, -1.5, -10.0, -5.0), (10.0, 1.5, 10.0, 5.0))
        yield rng.uniform(-0.3, 1.2), state, rng.uniform((-1.0, 0.0), (1.0, 43.2))


def with_moved_base(robot: Robot, sideways: float) -> Robot:
    """A copy whose base CoM is moved along base y."""
    model = robot.model.copy()
    inertia = model.inertias[1]
    model.inertias[1] = pin.Inertia(inertia.mass, inertia.lever + np.array([0.0, sideways, 0.0]), inertia.inertia)
    return dataclasses.replace(robot, model=model)


def test_figures_of_m4(m4_reduction: Reduction):
    parameters = m4_reduction.parameters
    assert parameters.mass_body == pytest.approx(5.095, abs=1e-9)
    assert parameters.mass_wheel == pytest.approx(0.905, abs=1e-9)
    assert parameters.com_in_body == pytest.approx((0.021, 0.447), abs=5e-4)
    assert parameters.thrust_point_in_body == pytest.approx((0.114, 0.744), abs=5e-4)
    assert parameters.inertia_body == pytest.approx(0.305, abs=1e-3)
    assert parameters.inertia_wheel == pytest.approx(0.004, abs=1e-9)
    assert m4_reduction.thrust_max == pytest.approx(43.2)
    assert m4_reduction.frame.track == pytest.approx(0.2788)


def test_axes_of_m4_follow_from_its_posture(m4: Robot, m4_reduction: Reduction):
    frame = m4_reduction.frame
    np.testing.assert_allclose(frame.rotation_in_base, [[0, 0, 1], [0, -1, 0], [1, 0, 0]], atol=1e-12)
    np.testing.assert_array_equal(frame.wheel_signs, [-1.0, -1.0])
    left = frame.wheel_joints.index("rear_left_wheel")
    assert frame.wheel_offsets[left] < 0.0, "the robot's left wheel is on the pendulum's right"
    assert np.linalg.det(frame.rotation_in_base) == pytest.approx(1.0)
    np.testing.assert_allclose(m4_reduction.thrust_shares, [0.5, 0.5, 0.0, 0.0])


@pytest.mark.parametrize("seed", [1, 2])
def test_symmetric_robot_reduces_without_residual(m4: Robot, m4_reduction: Reduction, seed: int):
    found = residual(m4, m4_reduction, m4_reduction.parameters, thrust_max=43.2, samples=30, seed=seed)
    assert found.in_plane <= 1e-9
    assert found.out_of_plane <= 1e-9
    assert abs(m4_reduction.com_lateral) <= 1e-9


def test_sideways_com_shows_out_of_plane_only(m4: Robot, m4_reduction: Reduction):
    reduction = reduce_robot(with_moved_base(m4, 0.015))
    assert reduction.residual_in_plane <= 1e-9
    # The roll moment of the moved weight alone is m_base g 15 mm, over the robot's weight times half its track.
    roll = 2.45 * 0.015 / (6.0 * 0.5 * m4_reduction.frame.track)
    assert reduction.residual_out_of_plane > roll
    assert reduction.com_lateral == pytest.approx(-2.45 * 0.015 / 6.0)


def test_wrong_parameters_show_in_plane(m4: Robot, m4_reduction: Reduction):
    for change in ({"mass_body": 5.2}, {"com_in_body": (0.03, 0.447)}, {"inertia_body": 0.31}, {"wheel_radius": 0.12}):
        wrong = m4_reduction.parameters.with_(**change)
        assert residual(m4, m4_reduction, wrong, thrust_max=43.2, samples=3).in_plane > 1e-3, change


def test_velocity_map_is_the_derivative_of_the_configuration(m4: Robot, m4_reduction: Reduction, rng):
    step = 1e-6
    for slope, x, _ in random_states(rng, 5):
        n, n_dot = velocity_map(m4, m4_reduction, slope, x)
        ahead, behind = x.copy(), x.copy()
        ahead[:2] += step * x[2:]
        behind[:2] -= step * x[2:]
        q_ahead = planar_configuration(m4, m4_reduction, slope, ahead)
        q_behind = planar_configuration(m4, m4_reduction, slope, behind)
        velocity = pin.difference(m4.model, q_behind, q_ahead) / (2.0 * step)
        np.testing.assert_allclose(n @ x[2:], velocity, atol=1e-7)
        difference = velocity_map(m4, m4_reduction, slope, ahead)[0] - velocity_map(m4, m4_reduction, slope, behind)[0]
        np.testing.assert_allclose(n_dot, difference / (2.0 * step), atol=1e-8)


def test_contact_wrench_is_the_pendulums_ground_force(m4: Robot, m4_reduction: Reduction, rng):
    parameters = m4_reduction.parameters
    for slope, x, u in random_states(rng, 10):
        acceleration = pendulum.acceleration(parameters, slope, x, u)
        torque = pendulum.motor_torque(parameters, x, u[0])
        wrench = contact_wrench(m4, m4_reduction, slope, x, acceleration, (torque, u[1]))
        expected = ground_force_in_slope(parameters, slope, x, u)
        scale = max(parameters.weight, float(np.linalg.norm(expected)))
        np.testing.assert_allclose(wrench.force_in_slope[[0, 2]], expected, atol=1e-9 * scale)
        np.testing.assert_allclose(wrench.moment_in_slope[1], 0.0, atol=1e-9 * scale)


def test_full_forward_dynamics_gives_the_pendulums_acceleration(m4: Robot, m4_reduction: Reduction, rng):
    """Articulated-body dynamics under the pendulum's ground force, with the joints held, moves like the pendulum."""
    parameters, frame = m4_reduction.parameters, m4_reduction.frame
    for slope, x, u in random_states(rng, 5):
        q = planar_configuration(m4, m4_reduction, slope, x)
        n, n_dot = velocity_map(m4, m4_reduction, slope, x)
        v = n @ x[2:]
        force = ground_force_in_slope(parameters, slope, x, u)
        tangent, normal = np.array([np.cos(slope), 0, np.sin(slope)]), np.array([-np.sin(slope), 0, np.cos(slope)])
        per_wheel = 0.5 * (force[0] * tangent + force[1] * normal)
        data = m4.model.createData()
        pin.computeJointJacobians(m4.model, data, q)
        push = planar_input_map(m4, m4_reduction, q) @ [pendulum.motor_torque(parameters, x, u[0]), u[1]]
        for name in frame.wheel_joints:
            jacobian = pin.getJointJacobian(m4.model, data, m4.joint_id(name), pin.LOCAL_WORLD_ALIGNED)
            moment = np.cross(-frame.wheel_radius * normal, per_wheel)
            push = push + jacobian[:3].T @ per_wheel + jacobian[3:].T @ moment
        expected = n @ pendulum.acceleration(parameters, slope, x, u) + n_dot @ x[2:]
        # Hold every joint but the drive wheels: solve for the torques that keep its acceleration at zero.
        wheels = [m4.wheel(name).index_v for name in frame.wheel_joints]
        held = [i for i in range(6, m4.model.nv) if i not in wheels]
        inverse_mass = np.array(pin.computeMinverse(m4.model, data, q))
        inverse_mass = np.triu(inverse_mass) + np.triu(inverse_mass, 1).T
        free = np.array(pin.aba(m4.model, data, q, v, push))
        holding = np.linalg.solve(inverse_mass[np.ix_(held, held)], -free[held])
        push[held] += holding
        found = np.array(pin.aba(m4.model, data, q, v, push))
        np.testing.assert_allclose(found, expected, atol=1e-8 * max(1.0, np.abs(expected).max()))


def test_robot_without_thrusters_and_with_opposed_wheel_axes(scooter_description: Path):
    robot = load_robot(scooter_description)
    reduction = reduce_robot(robot)
    np.testing.assert_allclose(reduction.frame.rotation_in_base, np.eye(3), atol=1e-12)
    np.testing.assert_array_equal(reduction.frame.wheel_signs, [1.0, -1.0])
    assert reduction.thrust_max == 0.0
    assert reduction.residual_in_plane <= 1e-9
    assert reduction.residual_out_of_plane <= 1e-9
    assert reduction.parameters.com_in_body == pytest.approx((0.01, 0.35))
    np.testing.assert_allclose(
        sorted(map(tuple, reduction.outline_in_body)), [(-0.1, 0.05), (-0.1, 0.65), (0.1, 0.05), (0.1, 0.65)]
    )


def test_forward_can_be_described(m4: Robot, m4_reduction: Reduction, scooter_description: Path):
    robot = load_robot(scooter_description)
    backwards = dataclasses.replace(robot, balance=dataclasses.replace(robot.balance, forward=(-1.0, 0.0, 0.0)))
    reduction = reduce_robot(backwards)
    np.testing.assert_allclose(reduction.frame.rotation_in_base, np.diag([-1.0, -1.0, 1.0]), atol=1e-12)
    assert reduction.parameters.com_in_body == pytest.approx((-0.01, 0.35))
    assert reduction.residual_in_plane <= 1e-9


@pytest.mark.parametrize(
    ("balance", "message"),
    [
        (None, "does not say how it balances"),
        (Balance("mip", ("rear_left_wheel", "front_right_wheel")), "not coaxial|not on one axle"),
        (Balance("mip", ("rear_left_wheel", "rear_right_wheel"), forward=(0.0, 1.0, 0.0)), "along the axle"),
    ],
)
def test_robots_that_cannot_be_a_pendulum_are_refused(m4: Robot, balance: Balance | None, message: str):
    with pytest.raises(RobotDescriptionError, match=message):
        reduce_robot(dataclasses.replace(m4, balance=balance))


def test_unknown_posture_is_named(m4: Robot):
    with pytest.raises(UnknownNameError, match="mip_sitting"):
        reduce_robot(m4, "headstand")
