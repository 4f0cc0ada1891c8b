"""M4 at rest and landing: forces that sum to the weight, moments that balance, momentum that is accounted for."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from scenes import on_incline, placed

from m4_dynamics.full import kernels
from m4_dynamics.full.dynamics import bias_forces, centre_of_mass, energies
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.stepping import ImplicitStepper
from m4_dynamics.robot.robot import Robot

Array = NDArray[np.float64]
WEIGHT = 6.0 * 9.81


def forces_and_places(stepper: ImplicitStepper) -> tuple[Array, Array]:
    """Every ground force on the robot, and where it acts, shapes (n, 3)."""
    robot = stepper.model.robot
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, stepper.configuration)
    points = [data.oMi[point.joint_id].act(point.position_in_joint) for point in robot.contact_points]
    forces = np.vstack((stepper.wheel_force_in_world, stepper.point_force_in_world))
    return forces, np.vstack((stepper.wheel_contact_in_world, np.reshape(points, (-1, 3))))


def settled(
    model: FullModel, posture: str, *, slope: float = 0.0, brake: float = 0.0, steps: int = 3000
) -> ImplicitStepper:
    stepper = ImplicitStepper(model, 1e-3)
    stepper.reset(placed(model, posture, slope=slope))
    stepper.actuation.wheel_brake[:] = brake
    stepper.step(steps)
    return stepper


@pytest.mark.parametrize(
    ("posture", "carrier"),
    [("ugv", "wheel"), ("quadruped", "wheel"), ("uas", "skid"), ("mip_sitting", "skid")],
)
def test_at_rest_forces_sum_to_the_weight_and_moments_balance(
    m4_on_ground: FullModel, posture: str, carrier: str
) -> None:
    stepper = settled(m4_on_ground, posture, brake=1.0)
    assert np.abs(stepper.velocity).max() < 5e-4
    forces, places = forces_and_places(stepper)
    np.testing.assert_allclose(forces.sum(axis=0), (0.0, 0.0, WEIGHT), atol=1e-3 * WEIGHT)
    com = centre_of_mass(m4_on_ground, stepper.configuration)
    moment = np.cross(places - com, forces).sum(axis=0)
    np.testing.assert_allclose(moment, 0.0, atol=1e-3 * WEIGHT * 0.2)
    assert (forces[:, 2] >= 0.0).all()
    # The centre of pressure is below the centre of mass, within what touches.
    touching = places[forces[:, 2] > 0.0]
    assert touching[:, 0].min() < com[0] < touching[:, 0].max()
    assert touching[:, 1].min() < com[1] < touching[:, 1].max()
    names = [wheel.joint for wheel in m4_on_ground.robot.wheels] + [p.name for p in m4_on_ground.robot.contact_points]
    loaded = [name for name, force in zip(names, forces, strict=True) if force[2] > 0.0]
    assert len(loaded) == 4
    assert all(carrier in name for name in loaded)


@pytest.mark.parametrize("posture", ["ugv", "uas"])
def test_at_rest_every_joint_is_in_balance(m4_on_ground: FullModel, posture: str) -> None:
    """h(q, 0) = servo torques + sum J^T f, with Jacobians from finite displacements left to Pinocchio."""
    stepper = settled(m4_on_ground, posture, brake=1.0)
    robot, q = m4_on_ground.robot, stepper.configuration
    data = robot.model.createData()
    pin.computeJointJacobians(robot.model, data, q)
    total = np.zeros(robot.model.nv)
    joints = [wheel.joint_id for wheel in robot.wheels] + [point.joint_id for point in robot.contact_points]
    for joint, force, place in zip(joints, *forces_and_places(stepper), strict=True):
        world = pin.getJointJacobian(robot.model, data, joint, pin.ReferenceFrame.WORLD)
        total += world.T @ np.concatenate((force, np.cross(place, force)))
    for servo, torque in zip(robot.servos, stepper.servo_torque, strict=True):
        error = robot.posture(posture).configuration[servo.index_q] - q[servo.index_q]
        assert torque == pytest.approx(servo.stiffness * error, abs=2e-3)
        total[servo.index_v] += torque
    np.testing.assert_allclose(total, bias_forces(m4_on_ground, q, np.zeros_like(stepper.velocity)), atol=0.01)


def test_wheels_sink_by_their_load_over_the_stiffness(m4_on_ground: FullModel) -> None:
    """A quarter of the weight each, beyond the transition width: f = k d."""
    stepper = settled(m4_on_ground, "ugv", brake=1.0)
    depths = -stepper.wheel_contact_in_world[:, 2]
    np.testing.assert_allclose(depths, stepper.wheel_force_in_world[:, 2] / m4_on_ground.ground.stiffness, rtol=1e-4)
    np.testing.assert_allclose(stepper.wheel_force_in_world[:, 2], WEIGHT / 4.0, rtol=1e-3)


@pytest.mark.parametrize(("posture", "slope_deg", "friction"), [("ugv", 45.0, 1.2), ("uas", 35.0, 0.8)])
def test_creep_at_rest_on_a_steep_slope(m4: Robot, posture: str, slope_deg: float, friction: float) -> None:
    """Under 1 mm in 10 s, on braked wheels or on the skids (on which it would fall over backwards at 45 deg).

    Dynamic friction suffices to hold it, so that it comes to rest after it has been put down.
    """
    slope = math.radians(slope_deg)
    ground = dataclasses.replace(m4.ground, friction_static=friction, friction_dynamic_fraction=0.9)
    model = on_incline(m4, slope, ground=ground)
    stepper = settled(model, posture, slope=slope, brake=1e4)
    start = centre_of_mass(model, stepper.configuration)
    stepper.step(10000)
    moved = centre_of_mass(model, stepper.configuration) - start
    assert np.linalg.norm(moved) < 1e-3
    # It is the creep of the regularised law, not nothing: at least the speed at which friction is tan(slope), more
    # where legs that want to spread use some of the friction sideways.
    least = 10.0 * ground.stiction_speed * (1.0 - math.sqrt(1.0 - math.tan(slope) / friction))
    assert moved @ (-math.cos(slope), 0.0, -math.sin(slope)) > 0.99 * least
    assert stepper.counters.newton_failures == 0


@pytest.mark.parametrize(("posture", "drop"), [("ugv", 0.02), ("ugv", 0.1), ("quadruped", 0.05)])
def test_landing_impulse_accounts_for_the_momentum(m4_on_ground: FullModel, posture: str, drop: float) -> None:
    """Integral of the ground's force = m g T + change of momentum, at touch-down, soon after and at rest."""
    model = m4_on_ground
    stepper = ImplicitStepper(model, 1e-3)
    q = placed(model, posture, above=drop)
    stepper.reset(q)
    start = centre_of_mass(model, q)[2]
    before = energies(model, q, stepper.velocity).total
    for steps in (math.floor(math.sqrt(2.0 * drop / 9.81) / 1e-3) + 10, 40, 900):
        stepper.step(steps)
        data = model.robot.model.createData()
        pin.centerOfMass(model.robot.model, data, stepper.configuration, stepper.velocity)
        momentum = model.robot.mass * data.vcom[0]
        impulse = stepper.statistics[:, kernels.IMPULSE_X : kernels.IMPULSE_Z + 1].sum(axis=0)
        expected = momentum + np.array([0.0, 0.0, WEIGHT * stepper.time])
        np.testing.assert_allclose(impulse, expected, atol=2e-3 * WEIGHT * stepper.time)
    assert not stepper.point_force_in_world.any()
    fallen = start - centre_of_mass(model, stepper.configuration)[2]
    after = energies(model, stepper.configuration, stepper.velocity).total
    assert after == pytest.approx(before - WEIGHT * fallen, rel=1e-6)
    assert drop < fallen < drop + 0.02
    air = stepper.statistics[:, kernels.AIR_TIME]
    np.testing.assert_allclose(air, math.sqrt(2.0 * drop / 9.81), atol=0.06)
    assert stepper.counters.newton_failures == 0
