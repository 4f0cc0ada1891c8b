"""Closed-form equilibria of the pendulum on a slope; every function broadcasts over NumPy arrays.

A steady climb (constant speed or constant acceleration a along the slope, constant pitch) satisfies, per row of
M q'' + h = B_q u with q'' = (a / r, 0):

    (I_w / r + m r) a + m g r sin b                           = tau + r f_t cos(theta + b)
    m_b a eta - m_b g (l_b,x cos theta + l_b,z sin theta)     = -tau + l_t,z f_t

Their sum eliminates the torque: A sin theta + B cos theta = C, with coefficients that depend on thrust, slope and a.
For a given pitch the same sum is linear in the thrust.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.reduced.pendulum import MipParameters

__all__ = ["BRANCHES", "EquilibriumLoads", "equilibrium_loads", "equilibrium_pitches", "equilibrium_thrust"]

_Array = NDArray[np.float64]

#: The two solutions of the pitch condition: CoM above the axle (an unstable balance), or hanging below it.
BRANCHES = ("upright", "hanging")


class EquilibriumLoads(NamedTuple):
    """What an equilibrium asks of motors and ground; arrays of one shape.

    Attributes:
        torque: tau, of both motors on the wheels [N m].
        duty: u_m that gives it at the climbing speed, not clipped.
        friction_force: f_x along the slope, positive uphill [N].
        normal_force: f_n [N].
        friction_needed: |f_x| / f_n; infinite where the ground would have to pull.
    """

    torque: _Array
    duty: _Array
    friction_force: _Array
    normal_force: _Array
    friction_needed: _Array


def equilibrium_pitches(
    parameters: MipParameters, slope: ArrayLike, thrust: ArrayLike, *, acceleration: ArrayLike = 0.0
) -> _Array:
    """Both pitches at which the pendulum is in equilibrium.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad]; any shape that broadcasts with the others.
        thrust: f_t [N].
        acceleration: Along the slope, positive uphill [m/s^2].

    Returns:
        Pitches in the order of `BRANCHES`, shape (2, ...) [rad], with theta + slope in (-pi, pi]. NaN marks places
        where no pitch balances the robot.
    """
    b, f, a = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (slope, thrust, acceleration)))
    mb, m, g, r = parameters.mass_body, parameters.mass, parameters.gravity, parameters.wheel_radius
    l_x, l_z = parameters.com_in_body
    sin_b, cos_b = np.sin(b), np.cos(b)
    coefficient_sin = mb * g * l_z + mb * a * (l_z * sin_b + l_x * cos_b) - r * f * sin_b
    coefficient_cos = mb * g * l_x - mb * a * (l_z * cos_b - l_x * sin_b) + r * f * cos_b
    right_side = (parameters.inertia_wheel / r + m * r) * a + m * g * r * sin_b
    right_side = right_side - parameters.thrust_point_in_body[1] * f

    amplitude = np.hypot(coefficient_sin, coefficient_cos)
    with np.errstate(invalid="ignore", divide="ignore"):
        half_angle = np.arccos(right_side / amplitude)
    middle = np.arctan2(coefficient_sin, coefficient_cos)
    pitch_to_normal = np.stack([middle - half_angle, middle + half_angle]) + b
    return np.asarray(np.pi - np.mod(np.pi - pitch_to_normal, 2.0 * np.pi) - b)


def equilibrium_thrust(
    parameters: MipParameters, slope: ArrayLike, pitch: ArrayLike, *, acceleration: ArrayLike = 0.0
) -> _Array:
    """Thrust that holds a given pitch; unique, because the condition is linear in it.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad]; any shape that broadcasts with the others.
        pitch: theta [rad].
        acceleration: Along the slope [m/s^2].

    Returns:
        f_t [N], not limited to what the thrusters can do (it may be negative or infinite), broadcast shape.
    """
    b, theta, a = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (slope, pitch, acceleration)))
    r = parameters.wheel_radius
    without_thrust = _torque(parameters, b, theta, a, np.zeros_like(b))
    missing = (parameters.inertia_wheel / r + parameters.mass * r) * a
    missing = missing + parameters.weight * r * np.sin(b) - without_thrust
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(missing / (parameters.thrust_point_in_body[1] + r * np.cos(theta + b)))


def equilibrium_loads(
    parameters: MipParameters,
    slope: ArrayLike,
    thrust: ArrayLike,
    pitch: ArrayLike,
    *,
    speed: ArrayLike = 0.0,
    acceleration: ArrayLike = 0.0,
) -> EquilibriumLoads:
    """Torque, duty and ground force at an equilibrium; they are meaningful only where thrust and pitch balance.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad]; any shape that broadcasts with the others.
        thrust: f_t [N].
        pitch: theta [rad].
        speed: Climbing speed along the slope [m/s].
        acceleration: Along the slope [m/s^2].

    Returns:
        The loads, each of the broadcast shape.
    """
    b, f, theta, v, a = np.broadcast_arrays(
        *(np.asarray(value, dtype=float) for value in (slope, thrust, pitch, speed, acceleration))
    )
    r, m, g = parameters.wheel_radius, parameters.mass, parameters.gravity
    torque = _torque(parameters, b, theta, a, f)
    duty = (torque + parameters.back_emf_constant * v / r) / parameters.torque_constant
    # Newton's law for the whole robot; nothing rotates steadily but the wheels, so the CoM accelerates with the axle.
    friction_force = m * a + m * g * np.sin(b) - f * np.cos(theta + b)
    normal_force = m * g * np.cos(b) + f * np.sin(theta + b)
    with np.errstate(divide="ignore", invalid="ignore"):
        friction_needed = np.where(normal_force > 0.0, np.abs(friction_force) / normal_force, np.inf)
    friction_needed = np.where(np.isnan(theta), np.nan, friction_needed)
    return EquilibriumLoads(torque, duty, friction_force, normal_force, friction_needed)


def _torque(parameters: MipParameters, b: Any, theta: Any, a: Any, f: Any) -> _Array:
    """Motor torque from the body's row: it carries the body's gravity and inertia moments and the thrust's [N m]."""
    l_x, l_z = parameters.com_in_body
    gravity_moment = parameters.mass_body * parameters.gravity * (l_x * np.cos(theta) + l_z * np.sin(theta))
    eta = l_z * np.cos(theta + b) - l_x * np.sin(theta + b)
    return np.asarray(gravity_moment + parameters.thrust_point_in_body[1] * f - parameters.mass_body * a * eta)
