"""Full-body dynamics (paper, section III-A): M(q) v' + h(q, v) = B(q) u + sum J_c(q)^T f_c, as functions.

Configurations q are Pinocchio's (free-flyer: position in the world, quaternion xyzw; continuous wheels: cosine and
sine). Velocities v start with the base twist in base axes. Every Jacobian is LOCAL_WORLD_ALIGNED at the named point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import InvalidSettingError, require_finite
from m4_dynamics.full import kernels
from m4_dynamics.full.contact import find_contacts
from m4_dynamics.full.model import FullModel

__all__ = [
    "Energies",
    "bias_forces",
    "centre_of_mass",
    "check_state",
    "energies",
    "forward_dynamics",
    "frame_jacobian",
    "generalised_force",
    "gravity_forces",
    "ground_generalised_force",
    "input_map",
    "mass_matrix",
    "state_derivative",
    "thrust_map",
]

Array = NDArray[np.float64]


class Energies(NamedTuple):
    """Energy of the robot [J]; the potential is zero at the world's origin."""

    kinetic: float
    potential: float

    @property
    def total(self) -> float:
        """Kinetic plus potential energy [J]."""
        return self.kinetic + self.potential


def check_state(model: FullModel, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
    """Return q and v as arrays of the model's sizes.

    Args:
        model: The full model.
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).

    Returns:
        (q, v) as float arrays.

    Raises:
        InvalidSettingError: A shape is wrong.
        NonFiniteError: An entry is NaN or infinite.
    """
    configuration, velocity = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
    pinocchio_model = model.robot.model
    for name, array, size in (
        ("configuration q", configuration, pinocchio_model.nq),
        ("velocity v", velocity, pinocchio_model.nv),
    ):
        if array.shape != (size,):
            raise InvalidSettingError(f"shape of {name}", array.shape, f"({size},) for robot '{model.robot.name}'")
        require_finite(name, array)
    return configuration, velocity


def mass_matrix(model: FullModel, q: ArrayLike) -> Array:
    """Joint-space inertia M(q), shape (nv, nv), symmetric (composite rigid body algorithm)."""
    configuration, _ = check_state(model, q, np.zeros(model.robot.model.nv))
    upper: Array = np.triu(pin.crba(model.robot.model, model.data, configuration))
    return upper + np.triu(upper, 1).T


def bias_forces(model: FullModel, q: ArrayLike, v: ArrayLike) -> Array:
    """Coriolis, centrifugal and gravity forces h(q, v), shape (nv,) (recursive Newton-Euler algorithm)."""
    configuration, velocity = check_state(model, q, v)
    return np.array(pin.nonLinearEffects(model.robot.model, model.data, configuration, velocity))


def gravity_forces(model: FullModel, q: ArrayLike) -> Array:
    """Gravity part of the bias, h(q, 0), shape (nv,)."""
    configuration, _ = check_state(model, q, np.zeros(model.robot.model.nv))
    return np.array(pin.computeGeneralizedGravity(model.robot.model, model.data, configuration))


def energies(model: FullModel, q: ArrayLike, v: ArrayLike) -> Energies:
    """Kinetic and potential energy (paper, eq. energy: the Lagrangian is their difference).

    Args:
        model: The full model.
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).

    Returns:
        The energies [J].
    """
    configuration, velocity = check_state(model, q, v)
    kinetic = pin.computeKineticEnergy(model.robot.model, model.data, configuration, velocity)
    potential = pin.computePotentialEnergy(model.robot.model, model.data, configuration)
    return Energies(float(kinetic), float(potential))


def centre_of_mass(model: FullModel, q: ArrayLike) -> Array:
    """Centre of mass in the world, shape (3,) [m]."""
    configuration, _ = check_state(model, q, np.zeros(model.robot.model.nv))
    return np.array(pin.centerOfMass(model.robot.model, model.data, configuration))


def frame_jacobian(model: FullModel, q: ArrayLike, frame: str) -> Array:
    """Jacobian of a frame, LOCAL_WORLD_ALIGNED, shape (6, nv): linear rows first.

    Raises:
        UnknownNameError: The robot has no such frame.
    """
    configuration, _ = check_state(model, q, np.zeros(model.robot.model.nv))
    frame_id = model.robot.frame_id(frame)
    return np.array(
        pin.computeFrameJacobian(
            model.robot.model, model.data, configuration, frame_id, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
    )


def thrust_map(model: FullModel, q: ArrayLike) -> Array:
    """Generalised force per newton of each thruster, J_t(q)^T d, shape (nv, thrusters)."""
    configuration, _ = check_state(model, q, np.zeros(model.robot.model.nv))
    pin.computeJointJacobians(model.robot.model, model.data, configuration)
    columns = np.zeros((model.robot.model.nv, len(model.robot.thrusters)))
    for index in range(columns.shape[1]):
        unit = np.zeros(columns.shape[1])
        unit[index] = 1.0
        column = np.zeros(columns.shape[0])
        _add_thrust(model, unit, column)
        columns[:, index] = column
    return columns


def input_map(model: FullModel, q: ArrayLike) -> Array:
    """The paper's B(q): generalised force of each input, shape (nv, inputs), columns as `model.layout`."""
    layout = model.layout
    columns = np.zeros((model.robot.model.nv, layout.size))
    columns[:, layout.thrusters] = thrust_map(model, q)
    for i, servo in enumerate(model.robot.servos):
        columns[servo.index_v, layout.servos.start + i] = 1.0
    for i, wheel in enumerate(model.robot.wheels):
        columns[wheel.index_v, layout.wheels.start + i] = 1.0
    return columns


def ground_generalised_force(model: FullModel, q: ArrayLike, v: ArrayLike) -> Array:
    """Generalised force of the compliant ground at a state, sum of J_c^T f_c, shape (nv,) [N, N m]."""
    configuration, velocity = check_state(model, q, v)
    pin.computeJointJacobians(model.robot.model, model.data, configuration)
    total = np.zeros(model.robot.model.nv)
    contacts, joints, _, count = find_contacts(model, margin=0.0)
    forces = np.empty((count, 3))
    kernels.ground_force(
        model.data.J, model.support, contacts, joints, count, velocity, model.ground_packed, forces, total
    )
    return total


def generalised_force(model: FullModel, q: ArrayLike, v: ArrayLike, inputs: ArrayLike) -> Array:
    """All non-conservative forces B(q) u + J_c^T f_c, shape (nv,) (right-hand side of the paper's eq. eom_full)."""
    layout = model.layout
    u = np.asarray(inputs, dtype=float)
    if u.shape != (layout.size,):
        raise InvalidSettingError("shape of inputs u", u.shape, f"({layout.size},): {', '.join(layout.labels)}")
    require_finite("inputs u", u, layout.labels)
    total = ground_generalised_force(model, q, v)
    _add_thrust(model, np.ascontiguousarray(u[layout.thrusters]), total)
    for i, servo in enumerate(model.robot.servos):
        total[servo.index_v] += u[layout.servos.start + i]
    total[model.wheel_velocity_indices] += u[layout.wheels]
    return total


def forward_dynamics(model: FullModel, q: ArrayLike, v: ArrayLike, inputs: ArrayLike) -> Array:
    """Acceleration v' of the robot on its compliant ground, shape (nv,) (articulated body algorithm).

    Args:
        model: The full model.
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,) [m/s, rad/s].
        inputs: Servo torques, wheel torques [N m], thrusts [N], see `model.layout`.

    Returns:
        v', in the same axes as v [m/s^2, rad/s^2].

    Raises:
        InvalidSettingError: A shape is wrong.
        NonFiniteError: An entry is NaN or infinite.
    """
    configuration, velocity = check_state(model, q, v)
    force = generalised_force(model, configuration, velocity, inputs)
    return np.array(pin.aba(model.robot.model, model.data, configuration, velocity, force))


def state_derivative(model: FullModel, q: ArrayLike, v: ArrayLike, inputs: ArrayLike) -> Array:
    """The paper's x' = f(x, u) (eq. eom_full_ss), with q' as a tangent vector: (v, v'), shape (2 nv,).

    Integrate the first half with `pinocchio.integrate`, since q lives on a manifold.

    Args:
        model: The full model.
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,) [m/s, rad/s].
        inputs: Servo torques, wheel torques [N m], thrusts [N], see `model.layout`.

    Returns:
        (v, v'), shape (2 nv,).

    Raises:
        InvalidSettingError: A shape is wrong.
        NonFiniteError: An entry is NaN or infinite.
    """
    return np.concatenate((np.asarray(v, dtype=float), forward_dynamics(model, q, v, inputs)))


def _add_thrust(model: FullModel, thrust: Array, total: Array) -> None:
    """Add the thrusters' generalised force at the configuration whose Jacobians `model.data` holds."""
    kernels.thrust_force(
        model.poses, model.data.J, model.support, model.thruster_joints, model.thruster_positions,
        model.thruster_directions, model.moment_ratios, thrust, total,
    )  # fmt: skip
