"""Force of the ground on the wheels, from the reduced model's state and inputs (paper, section III-C).

Three forms of the same force, as (f_x, f_n): friction along the slope (positive uphill) and normal force.

- `ground_force_in_slope`: Newton's law for the whole robot. Never singular; the one to use.
- `ground_force_constraint_system`: the paper's 4 x 4 system A_c z = b_c with its two slips corrected. It agrees with
  the first to rounding, except near the pitch where A_c is singular; there the paper's averaging bridges it.
- `ground_force_paper_uncorrected`: the equations as printed, for comparison only.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import M4Error
from m4_dynamics.reduced import kernels
from m4_dynamics.reduced.pendulum import (
    MipParameters,
    acceleration,
    checked_inputs,
    checked_state,
    motor_torque,
    rotation,
)

__all__ = [
    "ground_force_constraint_system",
    "ground_force_in_slope",
    "ground_force_linearised",
    "ground_force_paper_uncorrected",
    "singular_pitch",
]

_Array = NDArray[np.float64]


def ground_force_in_slope(parameters: MipParameters, slope: float, state: ArrayLike, inputs: ArrayLike) -> _Array:
    """Contact force of the ground on the wheels, from Newton's law for the whole robot.

    R(-beta) f_g = m_b p_b'' + m_w p_w'' - (m_b + m_w) g - d f_t, which has no singular pitch, unlike the paper's 4 x 4
    system (eqs. fbd_equations_1 to 3).

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad], positive uphill.
        state: (wheel angle, body pitch, and their rates), shape (4,) [rad, rad/s].
        inputs: (motor duty in [-1, 1], thrust [N]), shape (2,).

    Returns:
        (friction along the slope, normal force), shape (2,) [N].

    Raises:
        NonFiniteError: If state or inputs hold NaN or infinity; names the entry.
    """
    x, u = checked_state(state), checked_inputs(inputs)
    acceleration_wheel, acceleration_com = _accelerations_in_world(parameters, slope, x, u)
    gravity = np.array([0.0, -parameters.gravity])
    thrust = u[1] * rotation(x[1]) @ np.array([1.0, 0.0])  # d f_t
    force_in_world = (
        parameters.mass_body * (acceleration_com - gravity)
        + parameters.mass_wheel * (acceleration_wheel - gravity)
        - thrust
    )
    return np.asarray(rotation(slope) @ force_in_world)  # R(-beta)^-1 = R(beta)


def ground_force_linearised(
    parameters: MipParameters, slope: float, state: ArrayLike, inputs: ArrayLike
) -> tuple[_Array, _Array, _Array]:
    """Ground force and its exact derivatives; the force is affine in the inputs for a given state.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        state: (phi, theta, phi', theta'), shape (4,).
        inputs: (motor duty, thrust [N]), shape (2,).

    Returns:
        Force (2,) [N], its derivative with respect to the state (2, 4), and to the inputs (2, 2).
    """
    x, u = checked_state(state), checked_inputs(inputs)
    force, force_x, force_u = np.empty(2), np.empty((2, 4)), np.empty((2, 2))
    kernels.ground_force_linearised(parameters.as_array(), float(slope), x, u, force, force_x, force_u)
    return force, force_x, force_u


def singular_pitch(parameters: MipParameters, slope: float) -> float:
    """Pitch at which the paper's A_c is singular: the CoM lies on the slope normal through the axle.

    With l_b,x = 0 this is theta = -beta; a CoM off the body's axis shifts it. It recurs every half turn.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].

    Returns:
        The singular pitch nearest to -slope [rad].
    """
    forward, up = parameters.com_in_body
    return -slope - math.atan(forward / up) if up != 0.0 else -slope - math.pi / 2


def ground_force_constraint_system(
    parameters: MipParameters, slope: float, state: ArrayLike, inputs: ArrayLike, *, averaging_step: float = 1e-3
) -> _Array:
    """The paper's system A_c z = b_c for z = (c, f_x, f_n) (eqs. fbd_equations_1 to 3, ground_friction), corrected.

    Two corrections: the wheel's weight stands in eq. fbd_equations_1, and the arm of the thrust about the body's CoM in
    eq. fbd_equations_3 is l_t,z - l_b,z. Within half of `averaging_step` of the singular pitch the force is the mean of
    those at pitch + and - `averaging_step`, the paper's own way around; its error is of second order in the step.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        state: (phi, theta, phi', theta'), shape (4,).
        inputs: (motor duty, thrust [N]), shape (2,).
        averaging_step: Delta theta [rad]; 0 switches the averaging off.

    Returns:
        (f_x, f_n), shape (2,) [N].

    Raises:
        M4Error: At the singular pitch when averaging is off.
    """
    x, u = checked_state(state), checked_inputs(inputs)
    distance = math.remainder(x[1] - singular_pitch(parameters, slope), math.pi)
    arm = parameters.thrust_point_in_body[1] - parameters.com_in_body[1]
    pitches = [x[1] - averaging_step, x[1] + averaging_step] if abs(distance) < averaging_step / 2 else [x[1]]
    return _average_over_pitch(parameters, slope, x, u, pitches, parameters.mass_wheel, arm)


def ground_force_paper_uncorrected(
    parameters: MipParameters, slope: float, state: ArrayLike, inputs: ArrayLike, *, averaging_step: float = 1e-3
) -> _Array:
    """The paper's system exactly as printed: no wheel weight, thrust arm l_t,z, averaging around theta = +beta.

    For comparison only: its normal force lacks the wheels' weight and carries the moment of the thrust about the axle
    instead of the CoM, and its averaging sits at a pitch where nothing is singular.

    Args:
        parameters: The pendulum; `motor_model="paper"` gives the paper's back-EMF too.
        slope: Inclination of the ground [rad].
        state: (phi, theta, phi', theta'), shape (4,).
        inputs: (motor duty, thrust [N]), shape (2,).
        averaging_step: Delta theta [rad]; 0 switches the averaging off.

    Returns:
        (f_x, f_n), shape (2,) [N].

    Raises:
        M4Error: At the pitch where the system is singular.
    """
    x, u = checked_state(state), checked_inputs(inputs)
    averaged = abs(math.remainder(x[1] - slope, math.pi)) < averaging_step / 2
    pitches = [x[1] - averaging_step, x[1] + averaging_step] if averaged else [x[1]]
    return _average_over_pitch(parameters, slope, x, u, pitches, 0.0, parameters.thrust_point_in_body[1])


def _average_over_pitch(
    parameters: MipParameters,
    slope: float,
    x: _Array,
    u: _Array,
    pitches: list[float],
    weighing_wheel_mass: float,
    thrust_arm: float,
) -> _Array:
    """Mean of the 4 x 4 system's (f_x, f_n) over some pitches, everything else in the state kept."""
    forces = []
    for pitch in pitches:
        shifted = x.copy()
        shifted[1] = pitch
        forces.append(_solve_constraint_system(parameters, slope, shifted, u, weighing_wheel_mass, thrust_arm))
    return np.asarray(np.mean(forces, axis=0))


def _solve_constraint_system(
    parameters: MipParameters, slope: float, x: _Array, u: _Array, weighing_wheel_mass: float, thrust_arm: float
) -> _Array:
    """Solve the 4 x 4 system with the given wheel mass in the weight term and the given thrust arm."""
    accelerations = acceleration(parameters, slope, x, u)
    acceleration_wheel, _ = _accelerations_in_world(parameters, slope, x, u)
    torque = motor_torque(parameters, x, float(u[0]))
    axle_from_com = -rotation(x[1]) @ np.array(parameters.com_in_body)  # p_w - p_b
    gravity = np.array([0.0, -parameters.gravity])

    a_c, b_c = np.zeros((4, 4)), np.zeros(4)
    # Wheel, translation: m_w p_w'' = c + R(-beta) f_g + m_w g
    a_c[:2, :2], a_c[:2, 2:] = np.eye(2), rotation(-slope)
    b_c[:2] = parameters.mass_wheel * acceleration_wheel - weighing_wheel_mass * gravity
    # Wheel, rotation: I_w phi'' = tau - r f_x
    a_c[2, 2] = parameters.wheel_radius
    b_c[2] = torque - parameters.inertia_wheel * accelerations[0]
    # Body, rotation: I_b theta'' = -tau - (p_w - p_b) x c + arm f_t, with a x b = a_z b_x - a_x b_z
    a_c[3, :2] = -axle_from_com[1], axle_from_com[0]
    b_c[3] = parameters.inertia_body * accelerations[1] + torque - thrust_arm * u[1]
    try:
        z = np.asarray(np.linalg.solve(a_c, b_c), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise M4Error(f"A_c is singular at pitch {math.degrees(x[1]):.3f} deg; use ground_force_in_slope") from error
    return z[2:]


def _accelerations_in_world(parameters: MipParameters, slope: float, x: _Array, u: _Array) -> tuple[_Array, _Array]:
    """Accelerations of the axle and of the body's CoM in world x-z, (2,) and (2,) [m/s^2]."""
    wheel, pitch = acceleration(parameters, slope, x, u)
    acceleration_wheel = parameters.wheel_radius * wheel * np.array([math.cos(slope), math.sin(slope)])
    com = rotation(x[1]) @ np.array(parameters.com_in_body)
    com_per_pitch = np.array([com[1], -com[0]])  # d (R(theta) l_b) / d theta
    return acceleration_wheel, acceleration_wheel + pitch * com_per_pitch - x[3] ** 2 * com
