"""The thruster-assisted mobile inverted pendulum (MIP) on an incline (paper, section III-B).

Coordinates q = (phi, theta): absolute wheel angle and body pitch, both positive about world +y (rolling uphill,
leaning forward); theta = 0 is upright in the world, whatever the slope. In the x-z plane the body's rotation is
R(theta) = [[cos, sin], [-sin, cos]]. Inputs u = (u_m, f_t): motor duty in [-1, 1] and thrust [N] along the body's
forward axis.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import M4Error, require_finite, require_shape
from m4_dynamics.reduced import kernels
from m4_dynamics.reduced.linear import Controllability, controllability, discretise_euler, discretise_zoh
from m4_dynamics.reduced.parameters import MipParameters

__all__ = [
    "INPUT_LABELS",
    "STATE_LABELS",
    "Controllability",
    "MipParameters",
    "acceleration",
    "bias",
    "checked_inputs",
    "checked_state",
    "com_position",
    "controllability",
    "discretise_euler",
    "discretise_zoh",
    "input_map",
    "inverse_dynamics",
    "kinetic_energy",
    "linearise",
    "mass_matrix",
    "motor_torque",
    "potential_energy",
    "rotation",
    "state_derivative",
    "thrust_position",
    "wheel_position",
]

STATE_LABELS = ("wheel_angle", "pitch", "wheel_rate", "pitch_rate")
INPUT_LABELS = ("duty", "thrust")

_Array = NDArray[np.float64]


def rotation(pitch: float) -> _Array:
    """Return the paper's 2D rotation matrix R(theta), shape (2, 2), from body (forward, up) to world (x, z)."""
    c, s = math.cos(pitch), math.sin(pitch)
    return np.array([[c, s], [-s, c]])


def wheel_position(parameters: MipParameters, slope: float, state: ArrayLike) -> _Array:
    """Position of the axle in world x-z, from where it was at phi = 0 (paper, eq. pos_vectors).

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad], positive uphill.
        state: (phi, theta, phi', theta'), shape (4,) [rad, rad/s].

    Returns:
        Position, shape (2,) [m].
    """
    x = checked_state(state)
    return np.array([math.cos(slope), math.sin(slope)]) * float(parameters.wheel_radius * x[0])


def com_position(parameters: MipParameters, slope: float, state: ArrayLike) -> _Array:
    """Position of the body's CoM in world x-z, shape (2,) [m] (paper, eq. pos_vectors); args as `wheel_position`."""
    x = checked_state(state)
    return np.asarray(wheel_position(parameters, slope, x) + rotation(x[1]) @ np.array(parameters.com_in_body))


def thrust_position(parameters: MipParameters, slope: float, state: ArrayLike) -> _Array:
    """Position of the thrust point in world x-z, shape (2,) [m] (paper, eq. pos_vectors); args as `wheel_position`."""
    x = checked_state(state)
    point = rotation(x[1]) @ np.array(parameters.thrust_point_in_body)
    return np.asarray(wheel_position(parameters, slope, x) + point)


def mass_matrix(parameters: MipParameters, slope: float, state: ArrayLike) -> _Array:
    """Mass matrix M(q) of paper eq. eom_2d_v2.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        state: (phi, theta, phi', theta'), shape (4,).

    Returns:
        M, shape (2, 2) [kg m^2].
    """
    x = checked_state(state)
    eta, _ = _com_along_slope(parameters, x[1] + slope)
    r, mb = parameters.wheel_radius, parameters.mass_body
    coupling = mb * r * eta
    return np.array(
        [
            [parameters.inertia_wheel + parameters.mass * r**2, coupling],
            [
                coupling,
                parameters.inertia_body + mb * (parameters.com_in_body[0] ** 2 + parameters.com_in_body[1] ** 2),
            ],
        ]
    )


def bias(parameters: MipParameters, slope: float, state: ArrayLike) -> _Array:
    """Bias h(q, q') of paper eq. eom_2d_v2: centrifugal terms, gravity, and the back-EMF part of the motor torque.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        state: (phi, theta, phi', theta'), shape (4,).

    Returns:
        h, shape (2,) [N m].
    """
    x = checked_state(state)
    _, eta_t = _com_along_slope(parameters, x[1] + slope)
    r, g, mb = parameters.wheel_radius, parameters.gravity, parameters.mass_body
    l_x, l_z = parameters.com_in_body
    h = np.array(
        [
            mb * r * eta_t * x[3] ** 2 + parameters.mass * g * r * math.sin(slope),
            -mb * g * (l_x * math.cos(x[1]) + l_z * math.sin(x[1])),
        ]
    )
    # B_tau = (1, -1) times the part of the torque that does not depend on the duty, moved to the left side.
    return h - np.array([1.0, -1.0]) * motor_torque(parameters, x, 0.0)


def motor_torque(parameters: MipParameters, state: ArrayLike, duty: float) -> float:
    """Torque of both motors on the wheels, tau [N m] (paper, eq. motor_model).

    Args:
        parameters: The pendulum; its `motor_model` says which rate the back-EMF sees.
        state: (phi, theta, phi', theta'), shape (4,).
        duty: u_m in [-1, 1].

    Returns:
        Torque [N m], positive driving uphill; its reaction acts on the body.
    """
    x = checked_state(state)
    rate = x[2] - x[3] if parameters.motor_model == "relative" else x[2]
    return float(parameters.torque_constant * duty - parameters.back_emf_constant * rate)


def input_map(parameters: MipParameters, slope: float, state: ArrayLike) -> _Array:
    """Input map B_q(q) of paper eq. eom_2d_v2, from (u_m, f_t) to generalised forces (eq. virtual_work).

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        state: (phi, theta, phi', theta'), shape (4,).

    Returns:
        B_q = [k1 B_tau, B_t], shape (2, 2).
    """
    x = checked_state(state)
    k1 = parameters.torque_constant
    cos_tb = math.cos(x[1] + slope)
    return np.array([[k1, parameters.wheel_radius * cos_tb], [-k1, parameters.thrust_point_in_body[1]]])


def acceleration(parameters: MipParameters, slope: float, state: ArrayLike, inputs: ArrayLike) -> _Array:
    """Accelerations q'' = M^-1 (B_q u - h) of paper eq. eom_2d_v2.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad], positive uphill.
        state: (phi, theta, phi', theta'), shape (4,) [rad, rad/s].
        inputs: (motor duty, thrust [N]), shape (2,).

    Returns:
        (phi'', theta''), shape (2,) [rad/s^2].

    Raises:
        NonFiniteError: If state or inputs hold NaN or infinity; names the entry.
    """
    x, u = checked_state(state), checked_inputs(inputs)
    generalised_force = input_map(parameters, slope, x) @ u - bias(parameters, slope, x)
    return np.asarray(np.linalg.solve(mass_matrix(parameters, slope, x), generalised_force), dtype=np.float64)


def state_derivative(parameters: MipParameters, slope: float, state: ArrayLike, inputs: ArrayLike) -> _Array:
    """State derivative x' = f(x) + g(x) u, shape (4,) (paper, eq. nonlinear_model_2d); args as `acceleration`."""
    x = checked_state(state)
    return np.concatenate([x[2:], acceleration(parameters, slope, x, inputs)])


def linearise(parameters: MipParameters, slope: float, state: ArrayLike, inputs: ArrayLike) -> tuple[_Array, _Array]:
    """Exact derivatives of x' with respect to state and inputs, at any state (not only at a trim).

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        state: (phi, theta, phi', theta'), shape (4,).
        inputs: (motor duty, thrust [N]), shape (2,).

    Returns:
        A (4, 4) and B (4, 2), continuous time.
    """
    x, u = checked_state(state), checked_inputs(inputs)
    a, b = np.empty((4, 4)), np.empty((4, 2))
    kernels.mip_linearise(parameters.as_array(), float(slope), x, u, a, b)
    return a, b


def inverse_dynamics(
    parameters: MipParameters, slope: float, state: ArrayLike, acceleration_wanted: ArrayLike
) -> _Array:
    """Inputs that give the wanted accelerations: B_q u = M q'' + h, two equations for two inputs.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        state: (phi, theta, phi', theta'), shape (4,).
        acceleration_wanted: (phi'', theta''), shape (2,) [rad/s^2].

    Returns:
        (motor duty, thrust [N]), shape (2,); not clipped to any bound.

    Raises:
        M4Error: At the pitch where thrust and motor act on the robot alike (l_t,z + r cos(theta + beta) = 0).
    """
    x = checked_state(state)
    wanted = np.asarray(acceleration_wanted, dtype=float)
    require_shape("acceleration_wanted", wanted, (2,))
    require_finite("acceleration_wanted", wanted, ("wheel", "pitch"))
    b = input_map(parameters, slope, x)
    leverage = b[1, 1] + b[0, 1]
    if abs(leverage) < 1e-9 * parameters.wheel_radius:
        raise M4Error(f"thrust and wheel torque act alike at pitch {math.degrees(x[1]):.1f} deg; no unique inputs")
    force = mass_matrix(parameters, slope, x) @ wanted + bias(parameters, slope, x)
    return np.asarray(np.linalg.solve(b, force), dtype=np.float64)


def kinetic_energy(parameters: MipParameters, slope: float, state: ArrayLike) -> float:
    """Kinetic energy of body and wheels [J] (paper, eq. lagrangian_2d)."""
    x = checked_state(state)
    return float(0.5 * x[2:] @ mass_matrix(parameters, slope, x) @ x[2:])


def potential_energy(parameters: MipParameters, slope: float, state: ArrayLike) -> float:
    """Potential energy in gravity [J], zero with the axle at phi = 0 and the CoM level with it (eq. lagrangian_2d)."""
    x = checked_state(state)
    height_wheel = wheel_position(parameters, slope, x)[1]
    height_body = com_position(parameters, slope, x)[1]
    return float(parameters.gravity * (parameters.mass_wheel * height_wheel + parameters.mass_body * height_body))


def _com_along_slope(parameters: MipParameters, pitch_to_normal: float) -> tuple[float, float]:
    """Return eta, the slope-tangential travel of the CoM per radian of pitch, and its derivative [m]."""
    l_x, l_z = parameters.com_in_body
    c, s = math.cos(pitch_to_normal), math.sin(pitch_to_normal)
    return l_z * c - l_x * s, -l_z * s - l_x * c


def checked_state(state: ArrayLike) -> _Array:
    """Return the state as an array (4,); raise if its shape is wrong or an entry is not finite."""
    x = np.asarray(state, dtype=float)
    require_shape("state", x, (4,))
    require_finite("state", x, STATE_LABELS)
    return x


def checked_inputs(inputs: ArrayLike) -> _Array:
    """Return the inputs as an array (2,); raise if the shape is wrong or an entry is not finite."""
    u = np.asarray(inputs, dtype=float)
    require_shape("inputs", u, (2,))
    require_finite("inputs", u, INPUT_LABELS)
    return u
