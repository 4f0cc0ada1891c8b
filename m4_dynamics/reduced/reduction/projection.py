"""The full model projected onto the pendulum's two velocities, and what the projection leaves over.

With the legs held and the drive wheels rolling without slip in a plane, v = N(q) (phi', theta'). The projected model
M_r = N^T M N, h_r = N^T (h + M N' q'), B_r = N^T B must equal the pendulum. The planar energy alone cannot see
asymmetry (a CoM moved sideways leaves M_r unchanged), so the residual has a second part: the lateral force and the roll
and yaw moments at the midpoint of the contacts that M (N q'' + N' q') + h - B u leaves for the contacts to carry.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.reduced import pendulum
from m4_dynamics.reduced.pendulum import MipParameters, checked_inputs, checked_state
from m4_dynamics.reduced.reduction.frame import PlanarPosture, slope_normal, slope_tangent
from m4_dynamics.reduced.reduction.placement import configuration_on_slope
from m4_dynamics.robot.robot import Robot

__all__ = [
    "ContactWrench",
    "ProjectedModel",
    "Residual",
    "contact_wrench",
    "planar_configuration",
    "planar_input_map",
    "project",
    "residual",
    "velocity_map",
]

_Array = NDArray[np.float64]


class ProjectedModel(NamedTuple):
    """The full model in the pendulum's coordinates.

    Attributes:
        mass_matrix: N^T M N, shape (2, 2).
        bias: N^T (h + M N' q'), without the motors' back-EMF, shape (2,).
        input_map: N^T B for wheel torque and thrust, shape (2, 2).
    """

    mass_matrix: _Array
    bias: _Array
    input_map: _Array


class ContactWrench(NamedTuple):
    """What the ground must give at the midpoint of the contacts.

    Attributes:
        force_in_slope: Along the slope, to the left, along the normal, shape (3,) [N].
        moment_in_slope: About the same axes, shape (3,) [N m].
        generalised: The same as a generalised force, M (N q'' + N' q') + h - B u, shape (nv,).
    """

    force_in_slope: _Array
    moment_in_slope: _Array
    generalised: _Array


class Residual(NamedTuple):
    """Worst relative disagreement between projected full model and pendulum over random states.

    Attributes:
        in_plane: Of mass matrix, bias and input map.
        out_of_plane: Lateral force over the weight, roll and yaw moment over weight times half the track.
    """

    in_plane: float
    out_of_plane: float


def velocity_map(robot: Robot, planar: PlanarPosture, slope: float, state: ArrayLike) -> tuple[_Array, _Array]:
    """N(q) and N'(q, q') from (phi', theta') to the full velocity, for planar rolling without slip, legs held.

    The axle moves with r phi' along the slope, the base turns with theta' about the lateral axis, a drive wheel's joint
    with its sign times (phi' - theta').

    Args:
        robot: The robot.
        planar: The reduction, or what it knows of the axes.
        slope: Inclination of the ground [rad].
        state: (phi, theta, phi', theta'), shape (4,).

    Returns:
        N and its time derivative, both of shape (nv, 2).
    """
    x = checked_state(state)
    frame = planar.frame
    rotation = frame.base_rotation_in_world(slope, float(x[1]))
    tangent_in_base = rotation.T @ slope_tangent(slope)
    n, n_dot = np.zeros((robot.model.nv, 2)), np.zeros((robot.model.nv, 2))
    n[0:3, 0] = frame.wheel_radius * tangent_in_base
    n[0:3, 1] = np.cross(frame.lateral_in_base, -frame.axle_in_base)
    n[3:6, 1] = frame.lateral_in_base
    for name, sign in zip(frame.wheel_joints, frame.wheel_signs, strict=True):
        n[robot.wheel(name).index_v] = sign, -sign
    # The base twist is expressed in base axes, in which the slope's direction turns backwards.
    n_dot[0:3, 0] = -frame.wheel_radius * x[3] * np.cross(frame.lateral_in_base, tangent_in_base)
    return n, n_dot


def planar_configuration(robot: Robot, planar: PlanarPosture, slope: float, state: ArrayLike) -> _Array:
    """Full configuration of a pendulum state on a slope through the world's origin, heading uphill, shape (nq,)."""
    x = checked_state(state)
    position = float(planar.frame.wheel_radius * x[0])
    return configuration_on_slope(robot, planar, slope=slope, position_along_slope=position, pitch=float(x[1]))


def planar_input_map(robot: Robot, planar: PlanarPosture, q: _Array) -> _Array:
    """Generalised force of wheel torque tau (half on each drive wheel) and of total thrust, shape (nv, 2)."""
    model, data = robot.model, robot.model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    b = np.zeros((model.nv, 2))
    for name, sign in zip(planar.frame.wheel_joints, planar.frame.wheel_signs, strict=True):
        b[robot.wheel(name).index_v, 0] = 0.5 * sign
    for thruster, share in zip(robot.thrusters, planar.thrust_shares, strict=True):
        jacobian = pin.getFrameJacobian(model, data, thruster.frame_id, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        direction = data.oMi[thruster.joint_id].rotation @ thruster.direction_in_joint
        b[:, 1] += share * (jacobian[:3].T @ direction + thruster.moment_ratio * jacobian[3:].T @ direction)
    return b


def project(robot: Robot, planar: PlanarPosture, slope: float, state: ArrayLike) -> ProjectedModel:
    """Project the full model at a pendulum state.

    Args:
        robot: The robot.
        planar: The reduction, or what it knows of the axes.
        slope: Inclination of the ground [rad].
        state: (phi, theta, phi', theta'), shape (4,).

    Returns:
        M_r, h_r and B_r.
    """
    x = checked_state(state)
    q = planar_configuration(robot, planar, slope, x)
    n, n_dot = velocity_map(robot, planar, slope, x)
    mass, bias = _mass_and_bias(robot, q, n @ x[2:])
    b = planar_input_map(robot, planar, q)
    return ProjectedModel(n.T @ mass @ n, n.T @ (bias + mass @ n_dot @ x[2:]), n.T @ b)


def contact_wrench(
    robot: Robot,
    planar: PlanarPosture,
    slope: float,
    state: ArrayLike,
    acceleration: ArrayLike,
    torque_and_thrust: ArrayLike,
) -> ContactWrench:
    """Wrench of the ground on the robot in a planar motion, from M (N q'' + N' q') + h - B u.

    Args:
        robot: The robot.
        planar: The reduction, or what it knows of the axes.
        slope: Inclination of the ground [rad].
        state: (phi, theta, phi', theta'), shape (4,).
        acceleration: (phi'', theta''), shape (2,).
        torque_and_thrust: Torque of both motors [N m] and total thrust [N], shape (2,).

    Returns:
        Force and moment at the midpoint of the contacts, and the generalised force they come from.
    """
    x, a = checked_state(state), np.asarray(acceleration, dtype=float)
    u = checked_inputs(torque_and_thrust)
    q = planar_configuration(robot, planar, slope, x)
    n, n_dot = velocity_map(robot, planar, slope, x)
    mass, bias = _mass_and_bias(robot, q, n @ x[2:])
    left = mass @ (n @ a + n_dot @ x[2:]) + bias - planar_input_map(robot, planar, q) @ u

    rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
    force = rotation @ left[0:3]
    contact = planar.frame.wheel_radius * x[0] * slope_tangent(slope)
    moment = rotation @ left[3:6] + np.cross(q[0:3] - contact, force)
    axes = np.stack([slope_tangent(slope), np.array([0.0, 1.0, 0.0]), slope_normal(slope)])
    return ContactWrench(axes @ force, axes @ moment, left)


def residual(
    robot: Robot,
    planar: PlanarPosture,
    parameters: MipParameters,
    *,
    thrust_max: float,
    samples: int = 20,
    seed: int = 0,
) -> Residual:
    """Compare full model and pendulum at random slopes, states and inputs.

    Args:
        robot: The robot.
        planar: The reduction, or what it knows of the axes.
        parameters: The pendulum.
        thrust_max: Greatest total thrust [N]; 0 leaves the thrust out.
        samples: Number of random states.
        seed: Of the random numbers.

    Returns:
        The worst in-plane and out-of-plane disagreement.
    """
    rng = np.random.default_rng(seed)
    without_motor = parameters.with_(back_emf_constant=0.0)
    columns = slice(0, 2 if thrust_max > 0.0 else 1)
    in_plane = out_of_plane = 0.0
    for _ in range(samples):
        slope = rng.uniform(-0.3, 1.2)
        x = rng.uniform((-10.0, -1.5, -10.0, -5.0), (10.0, 1.5, 10.0, 5.0))
        u = rng.uniform((-1.0, 0.0), (1.0, thrust_max))
        projected = project(robot, planar, slope, x)
        mass = pendulum.mass_matrix(parameters, slope, x)
        bias = pendulum.bias(without_motor, slope, x)
        b = pendulum.input_map(parameters, slope, x) / np.array([parameters.torque_constant, 1.0])
        scale = max(float(np.linalg.norm(bias)), parameters.weight * parameters.wheel_radius)
        in_plane = max(
            in_plane,
            float(np.linalg.norm(projected.mass_matrix - mass) / np.linalg.norm(mass)),
            float(np.linalg.norm(projected.bias - bias) / scale),
            float(np.linalg.norm((projected.input_map - b)[:, columns]) / np.linalg.norm(b[:, columns])),
        )
        torque = pendulum.motor_torque(parameters, x, u[0])
        acceleration = pendulum.acceleration(parameters, slope, x, u)
        wrench = contact_wrench(robot, planar, slope, x, acceleration, (torque, u[1]))
        lever = parameters.weight * 0.5 * planar.frame.track
        out_of_plane = max(
            out_of_plane,
            abs(float(wrench.force_in_slope[1])) / parameters.weight,
            abs(float(wrench.moment_in_slope[0])) / lever,
            abs(float(wrench.moment_in_slope[2])) / lever,
        )
    return Residual(in_plane, out_of_plane)


def _mass_and_bias(robot: Robot, q: _Array, v: _Array) -> tuple[_Array, _Array]:
    """M(q), both triangles filled, and h(q, v)."""
    data = robot.model.createData()
    upper = np.triu(pin.crba(robot.model, data, q))
    return upper + np.triu(upper, 1).T, np.array(pin.nonLinearEffects(robot.model, data, q, v))
