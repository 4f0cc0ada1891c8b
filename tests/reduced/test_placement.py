"""Placing the robot on a slope, its yaw dynamics, and the loads of its legs, each against the full model."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pinocchio as pin
import pytest

from m4_dynamics.errors import NonFiniteError, RobotDescriptionError
from m4_dynamics.reduced.reduction import (
    Reduction,
    configuration_on_slope,
    heading_dynamics,
    holding_torques,
    loaded_configuration,
    reduce_robot,
    velocity_on_slope,
)
from m4_dynamics.reduced.reduction.projection import planar_input_map
from m4_dynamics.reduced.trim import select_trim
from m4_dynamics.robot.robot import Robot

SLOPE = math.radians(45.0)
TANGENT = np.array([math.cos(SLOPE), 0.0, math.sin(SLOPE)])
NORMAL = np.array([-math.sin(SLOPE), 0.0, math.cos(SLOPE)])
AXES = np.stack([TANGENT, [0.0, 1.0, 0.0], NORMAL])


def rim_jacobians(robot: Robot, reduction: Reduction, q: np.ndarray) -> np.ndarray:
    """Jacobian of the lowest points of both rims, in slope axes, shape (6, nv)."""
    data = robot.model.createData()
    pin.computeJointJacobians(robot.model, data, q)
    blocks = []
    for name in reduction.frame.wheel_joints:
        jacobian = pin.getJointJacobian(robot.model, data, robot.joint_id(name), pin.LOCAL_WORLD_ALIGNED)
        blocks.append(AXES @ (jacobian[:3] - pin.skew(-reduction.frame.wheel_radius * NORMAL) @ jacobian[3:]))
    return np.vstack(blocks)


@pytest.mark.parametrize(("pitch", "yaw", "penetration"), [(0.0, 0.0, 0.0), (-0.3, 0.4, 0.0), (0.2, -2.5, 3e-4)])
def test_robot_stands_on_the_slope(m4: Robot, m4_reduction: Reduction, pitch, yaw, penetration):
    q = configuration_on_slope(
        m4, m4_reduction, slope=SLOPE, position_along_slope=0.7, pitch=pitch, yaw=yaw, penetration=penetration
    )
    data = m4.model.createData()
    pin.forwardKinematics(m4.model, data, q)
    centres = [data.oMi[m4.joint_id(name)].translation.copy() for name in m4_reduction.frame.wheel_joints]
    for name, centre in zip(m4_reduction.frame.wheel_joints, centres, strict=True):
        axis = data.oMi[m4.joint_id(name)].rotation @ m4.wheel(name).axis_in_joint
        assert axis @ NORMAL == pytest.approx(0.0, abs=1e-12)
        assert centre @ NORMAL == pytest.approx(0.125 - penetration, abs=1e-12)
    np.testing.assert_allclose(0.5 * (centres[0] + centres[1]) @ AXES.T, [0.7, 0.0, 0.125 - penetration], atol=1e-12)
    found = m4_reduction.frame.pitch_and_yaw(SLOPE, pin.Quaternion(q[3:7]).toRotationMatrix())
    assert found == pytest.approx((pitch, yaw), abs=1e-12)
    parameters = m4_reduction.parameters
    forward, up = parameters.com_in_body
    lever = (up * math.cos(pitch + SLOPE) - forward * math.sin(pitch + SLOPE)) * parameters.mass_body / parameters.mass
    assert pin.centerOfMass(m4.model, data, q) @ NORMAL == pytest.approx(0.125 - penetration + lever, abs=1e-12)


def test_velocity_rolls_without_slip(m4: Robot, m4_reduction: Reduction):
    placement = {"slope": SLOPE, "pitch": -0.3, "yaw": 0.4}
    motion = {"speed": 0.8, "pitch_rate": 0.6, "yaw_rate": -0.9}
    q = configuration_on_slope(m4, m4_reduction, position_along_slope=0.3, **placement)
    v = velocity_on_slope(m4, m4_reduction, **placement, **motion)
    np.testing.assert_allclose(rim_jacobians(m4, m4_reduction, q) @ v, 0.0, atol=1e-12)
    data = m4.model.createData()
    pin.forwardKinematics(m4.model, data, q, v)
    base = pin.getVelocity(m4.model, data, 1, pin.LOCAL_WORLD_ALIGNED)
    assert base.angular @ NORMAL == pytest.approx(-0.9)
    lateral = pin.Quaternion(q[3:7]).toRotationMatrix() @ m4_reduction.frame.lateral_in_base
    assert base.angular @ lateral == pytest.approx(0.6)
    to_axle = pin.Quaternion(q[3:7]).toRotationMatrix() @ m4_reduction.frame.axle_in_base
    assert (base.linear + np.cross(base.angular, to_axle)) @ np.cross(lateral, NORMAL) == pytest.approx(0.8)


def test_placement_refuses_nan(m4: Robot, m4_reduction: Reduction):
    with pytest.raises(NonFiniteError, match="pitch"):
        configuration_on_slope(m4, m4_reduction, slope=SLOPE, pitch=math.nan)


def held_acceleration(robot: Robot, reduction: Reduction, q: np.ndarray, push: np.ndarray) -> np.ndarray:
    """Acceleration from rest with rims fixed to the ground where they touch and all joints but drive wheels held."""
    model, data = robot.model, robot.model.createData()
    mass = np.array(pin.crba(model, data, q))
    mass = np.triu(mass) + np.triu(mass, 1).T
    wheels = [robot.wheel(name).index_v for name in reduction.frame.wheel_joints]
    held = np.eye(model.nv)[[i for i in range(6, model.nv) if i not in wheels]]
    constraints = np.vstack([rim_jacobians(robot, reduction, q), held])
    system = np.block([[mass, constraints.T], [constraints, np.zeros((len(constraints), len(constraints)))]])
    right = np.concatenate(
        [push - pin.nonLinearEffects(model, data, q, np.zeros(model.nv)), np.zeros(len(constraints))]
    )
    # The lateral forces of coaxial wheels are redundant: least squares.
    return np.linalg.lstsq(system, right, rcond=1e-12)[0][: model.nv]


@pytest.mark.parametrize("thrust", [2.0, 12.0])
def test_heading_dynamics_match_the_constrained_full_model(m4: Robot, m4_reduction: Reduction, thrust: float):
    trim = select_trim(
        m4_reduction.parameters,
        SLOPE,
        criterion="thrust",
        thrust=thrust,
        limits=m4_reduction.trim_limits(friction_static=2.0),
    )
    heading = heading_dynamics(m4, m4_reduction, slope=SLOPE, pitch=trim.pitch)
    wheels = [m4.wheel(name).index_v for name in m4_reduction.frame.wheel_joints]

    def yaw_acceleration(yaw: float, differential_duty: float) -> float:
        q = configuration_on_slope(m4, m4_reduction, slope=SLOPE, pitch=trim.pitch, yaw=yaw)
        push = planar_input_map(m4, m4_reduction, q) @ [trim.torque, trim.thrust]
        for index, sign, offset in zip(
            wheels, m4_reduction.frame.wheel_signs, m4_reduction.frame.wheel_offsets, strict=True
        ):
            push[index] += -np.sign(offset) * sign * 0.5 * m4_reduction.parameters.torque_constant * differential_duty
        acceleration = held_acceleration(m4, m4_reduction, q, push)
        return float(pin.Quaternion(q[3:7]).toRotationMatrix() @ acceleration[3:6] @ NORMAL)

    yaw = 1e-4
    expected = heading.gravity_stiffness / heading.yaw_inertia
    assert (yaw_acceleration(yaw, 0.0) - yaw_acceleration(-yaw, 0.0)) / (2 * yaw) == pytest.approx(expected, rel=1e-5)
    assert yaw_acceleration(0.0, 0.1) == pytest.approx(0.1 * heading.duty_gain / heading.yaw_inertia, rel=1e-6)
    assert heading.growth_rate > 2.5


def test_heading_is_neutral_on_level_ground(m4: Robot, m4_reduction: Reduction):
    assert heading_dynamics(m4, m4_reduction, slope=0.0, pitch=-0.1).growth_rate == 0.0


def test_holding_torques_keep_the_full_model_still(m4: Robot, m4_reduction: Reduction):
    """With the servo torques and the contact forces applied, forward dynamics leaves everything at rest."""
    trim = select_trim(m4_reduction.parameters, SLOPE, limits=m4_reduction.trim_limits())
    loads = holding_torques(m4, m4_reduction, trim)
    q = configuration_on_slope(m4, m4_reduction, slope=SLOPE, pitch=trim.pitch)
    push = planar_input_map(m4, m4_reduction, q) @ [trim.torque, trim.thrust]
    push += rim_jacobians(m4, m4_reduction, q).T @ loads.contact_forces.ravel()
    for servo, torque in zip(m4.servos, loads.torques, strict=True):
        push[servo.index_v] += torque
    acceleration = pin.aba(m4.model, m4.model.createData(), q, np.zeros(m4.model.nv), push)
    # In units that weigh the tiny inertias of the hips fairly: what generalised force would it take?
    np.testing.assert_allclose(pin.crba(m4.model, m4.model.createData(), q) @ acceleration, 0.0, atol=1e-8)
    np.testing.assert_allclose(
        loads.contact_forces.sum(axis=0), [trim.friction_force, 0.0, trim.normal_force], atol=1e-9
    )


def test_loaded_legs_move_the_com_a_little(m4: Robot, m4_reduction: Reduction):
    trim = select_trim(m4_reduction.parameters, SLOPE, limits=m4_reduction.trim_limits())
    loads = holding_torques(m4, m4_reduction, trim)
    loaded = reduce_robot(m4, configuration=loaded_configuration(m4, m4_reduction, loads))
    shift = np.subtract(loaded.parameters.com_in_body, m4_reduction.parameters.com_in_body)
    assert 1e-4 < np.abs(shift).max() < 5e-3
    assert loaded.residual_in_plane < 1e-5
    # Half the stiffness, twice the sag.
    soft = dataclasses.replace(m4, servos=tuple(dataclasses.replace(s, stiffness=s.stiffness / 2) for s in m4.servos))
    np.testing.assert_allclose(holding_torques(soft, m4_reduction, trim).sag, 2.0 * loads.sag)


def test_servo_without_stiffness_cannot_hold(m4: Robot, m4_reduction: Reduction):
    trim = select_trim(m4_reduction.parameters, SLOPE, limits=m4_reduction.trim_limits())
    limp = dataclasses.replace(m4, servos=(dataclasses.replace(m4.servos[0], stiffness=0.0), *m4.servos[1:]))
    with pytest.raises(RobotDescriptionError, match="stiffness"):
        holding_torques(limp, m4_reduction, trim)


def test_heading_damping_matches_kanes_equations_at_speed(m4: Robot, m4_reduction: Reduction):
    """A CoM ahead of a rolling axle damps the heading: full model projected on forward, pitch and yaw rates."""
    trim = select_trim(m4_reduction.parameters, SLOPE, criterion="thrust", thrust=12.0)
    speed, yaw_rate, step = 0.7, 1e-3, 1e-5
    rates = np.array([speed, 0.0, yaw_rate])

    def basis(time: float) -> np.ndarray:
        motion = {"slope": SLOPE, "pitch": trim.pitch, "yaw": yaw_rate * time}
        names = ("speed", "pitch_rate", "yaw_rate")
        return np.column_stack([velocity_on_slope(m4, m4_reduction, **motion, **{name: 1.0}) for name in names])

    q = configuration_on_slope(m4, m4_reduction, slope=SLOPE, pitch=trim.pitch)
    data = m4.model.createData()
    mass = np.array(pin.crba(m4.model, data, q))
    mass = np.triu(mass) + np.triu(mass, 1).T
    n, n_dot = basis(0.0), (basis(step) - basis(-step)) / (2.0 * step)
    bias = pin.nonLinearEffects(m4.model, data, q, n @ rates)
    push = planar_input_map(m4, m4_reduction, q) @ [trim.torque, trim.thrust]
    acceleration = np.linalg.solve(n.T @ mass @ n, n.T @ (push - bias - mass @ n_dot @ rates))
    moving = heading_dynamics(m4, m4_reduction, slope=SLOPE, pitch=trim.pitch, speed=speed)
    still = heading_dynamics(m4, m4_reduction, slope=SLOPE, pitch=trim.pitch)
    of_speed = moving.damping - still.damping
    assert of_speed > 0.5
    assert acceleration[2] == pytest.approx(-of_speed * yaw_rate / moving.yaw_inertia, rel=1e-5)
    # Back-EMF on wheels that turn by d / 2r against each other.
    spread = 0.5 * moving.track / moving.wheel_radius
    assert still.damping == pytest.approx(m4_reduction.parameters.back_emf_constant * spread**2)
