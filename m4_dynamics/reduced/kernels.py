"""Compiled twins of `pendulum` and `ground_force`: plain arrays in, results written in place, no allocation.

The readable functions are the definition; a test holds these equal to them. All kernels that call each other live in
this one file, because Numba's cache does not notice a change in a callee of another file.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "BACK_EMF_CONSTANT",
    "BACK_EMF_PITCH",
    "COM_FORWARD",
    "COM_UP",
    "DISTURBANCE_PITCH",
    "DISTURBANCE_WHEEL",
    "GRAVITY",
    "INERTIA_BODY",
    "INERTIA_WHEEL",
    "MASS_BODY",
    "MASS_WHEEL",
    "PARAMETER_COUNT",
    "THRUST_FORWARD",
    "THRUST_TIME_CONSTANT",
    "THRUST_UP",
    "TORQUE_CONSTANT",
    "WHEEL_RADIUS",
    "ground_force",
    "ground_force_linearised",
    "inputs_along",
    "mip_acceleration",
    "mip_linearise",
    "mip_step",
    "pitch_shift_within_limits",
    "rollout_and_linearise",
    "rollout_over_profile",
    "thrust_share",
]

# Layout of the parameter vector p.
MASS_BODY = 0
MASS_WHEEL = 1
INERTIA_BODY = 2
INERTIA_WHEEL = 3
COM_FORWARD = 4
COM_UP = 5
THRUST_FORWARD = 6
THRUST_UP = 7
WHEEL_RADIUS = 8
TORQUE_CONSTANT = 9
BACK_EMF_CONSTANT = 10
#: Coefficient of the pitch rate in the motor torque: k2 if the back-EMF sees the wheel relative to the body, else 0.
BACK_EMF_PITCH = 11
GRAVITY = 12
#: Generalised forces beside the model's own, on wheel angle and pitch [N m]; zero for the pendulum itself.
DISTURBANCE_WHEEL = 13
DISTURBANCE_PITCH = 14
#: Of the rotors' first-order lag [s]; it matters where the thrust is a fifth state.
THRUST_TIME_CONSTANT = 15
PARAMETER_COUNT = 16

#: Step of the search for a pitch [rad], and how many to either side.
SHIFT_STEP = math.radians(0.5)
SHIFT_COUNT = 40

_Array = NDArray[np.float64]
_IndexArray = NDArray[np.int64]


@njit(cache=True, error_model="numpy")
def _accelerate(
    p: _Array,
    sin_b: float,
    cos_b: float,
    pitch: float,
    wheel_rate: float,
    pitch_rate: float,
    duty: float,
    thrust: float,
) -> tuple[float, ...]:
    """Accelerations and the terms that the derivatives need again.

    Returns:
        phi'', theta'', sin theta, cos theta, sin(theta + beta), cos(theta + beta), eta, d eta / d theta, and the
        entries (0, 0), (0, 1), (1, 1) of M^-1.
    """
    mass = p[MASS_BODY] + p[MASS_WHEEL]
    r = p[WHEEL_RADIUS]
    sin_t = math.sin(pitch)
    cos_t = math.cos(pitch)
    sin_tb = sin_t * cos_b + cos_t * sin_b
    cos_tb = cos_t * cos_b - sin_t * sin_b
    eta = p[COM_UP] * cos_tb - p[COM_FORWARD] * sin_tb
    eta_t = -p[COM_UP] * sin_tb - p[COM_FORWARD] * cos_tb

    m11 = p[INERTIA_WHEEL] + mass * r * r
    m12 = p[MASS_BODY] * r * eta
    m22 = p[INERTIA_BODY] + p[MASS_BODY] * (p[COM_FORWARD] * p[COM_FORWARD] + p[COM_UP] * p[COM_UP])
    scale = 1.0 / (m11 * m22 - m12 * m12)

    torque = p[TORQUE_CONSTANT] * duty - p[BACK_EMF_CONSTANT] * wheel_rate + p[BACK_EMF_PITCH] * pitch_rate
    rhs1 = torque + r * cos_tb * thrust
    rhs1 -= p[MASS_BODY] * r * eta_t * pitch_rate * pitch_rate + mass * p[GRAVITY] * r * sin_b
    rhs1 += p[DISTURBANCE_WHEEL]
    rhs2 = -torque + p[THRUST_UP] * thrust + p[DISTURBANCE_PITCH]
    rhs2 += p[MASS_BODY] * p[GRAVITY] * (p[COM_FORWARD] * cos_t + p[COM_UP] * sin_t)
    n11 = m22 * scale
    n12 = -m12 * scale
    n22 = m11 * scale
    return (
        n11 * rhs1 + n12 * rhs2,
        n12 * rhs1 + n22 * rhs2,
        sin_t,
        cos_t,
        sin_tb,
        cos_tb,
        eta,
        eta_t,
        n11,
        n12,
        n22,
    )


@njit(cache=True, error_model="numpy", inline="always")
def _force(
    p: _Array,
    sin_b: float,
    cos_b: float,
    sin_tb: float,
    cos_tb: float,
    eta: float,
    eta_t: float,
    pitch_rate: float,
    ddphi: float,
    ddtheta: float,
    thrust: float,
) -> tuple[float, float]:
    """(f_x, f_n) by Newton's law for the whole robot, along the slope and along its normal.

    A disturbance of the wheel angle counts as a force d_1 / r along the slope: then r f_x is what the motors give less
    what spins the wheels, whatever is wrong with mass, CoM or thrust. What it may do along the normal cannot be seen in
    the motion and is left out.
    """
    mb = p[MASS_BODY]
    mass = mb + p[MASS_WHEEL]
    r = p[WHEEL_RADIUS]
    rate2 = pitch_rate * pitch_rate
    along = mass * (r * ddphi + p[GRAVITY] * sin_b) + mb * (eta * ddtheta + eta_t * rate2) - thrust * cos_tb
    along -= p[DISTURBANCE_WHEEL] / r
    return along, mb * (eta_t * ddtheta - eta * rate2) + mass * p[GRAVITY] * cos_b + thrust * sin_tb


@njit(cache=True, error_model="numpy")
def _linearise(
    p: _Array,
    sin_b: float,
    cos_b: float,
    x: _Array,
    u: _Array,
    acceleration: _Array,
    jacobian_x: _Array,
    jacobian_u: _Array,
    force: _Array,
    force_x: _Array,
    force_u: _Array,
) -> None:
    """Accelerations (2,), ground force (2,) and their derivatives with respect to x (2, 4) and u (2, 2), in place."""
    mb = p[MASS_BODY]
    mass = mb + p[MASS_WHEEL]
    r = p[WHEEL_RADIUS]
    g = p[GRAVITY]
    rate = x[3]
    thrust = u[1]
    ddphi, ddtheta, sin_t, cos_t, sin_tb, cos_tb, eta, eta_t, n11, n12, n22 = _accelerate(
        p, sin_b, cos_b, x[1], x[2], rate, u[0], thrust
    )
    acceleration[0] = ddphi
    acceleration[1] = ddtheta

    # d(rhs)/dy - (dM/dy) q'' for y = theta, phi', theta', u_m, f_t; M depends on theta only, and eta'' = -eta.
    y1 = -r * sin_tb * thrust + mb * r * eta * rate * rate - mb * r * eta_t * ddtheta
    y2 = mb * g * (p[COM_UP] * cos_t - p[COM_FORWARD] * sin_t) - mb * r * eta_t * ddphi
    jacobian_x[0, 0] = 0.0
    jacobian_x[1, 0] = 0.0
    jacobian_x[0, 1] = n11 * y1 + n12 * y2
    jacobian_x[1, 1] = n12 * y1 + n22 * y2
    k2 = p[BACK_EMF_CONSTANT]
    jacobian_x[0, 2] = (n12 - n11) * k2
    jacobian_x[1, 2] = (n22 - n12) * k2
    k2_pitch = p[BACK_EMF_PITCH]
    centrifugal = 2.0 * mb * r * eta_t * rate
    jacobian_x[0, 3] = n11 * (k2_pitch - centrifugal) - n12 * k2_pitch
    jacobian_x[1, 3] = n12 * (k2_pitch - centrifugal) - n22 * k2_pitch
    k1 = p[TORQUE_CONSTANT]
    jacobian_u[0, 0] = (n11 - n12) * k1
    jacobian_u[1, 0] = (n12 - n22) * k1
    jacobian_u[0, 1] = n11 * r * cos_tb + n12 * p[THRUST_UP]
    jacobian_u[1, 1] = n12 * r * cos_tb + n22 * p[THRUST_UP]

    # Newton's law for the whole robot, along the slope and along its normal.
    force[0], force[1] = _force(p, sin_b, cos_b, sin_tb, cos_tb, eta, eta_t, rate, ddphi, ddtheta, thrust)
    for j in range(4):
        force_x[0, j] = mass * r * jacobian_x[0, j] + mb * eta * jacobian_x[1, j]
        force_x[1, j] = mb * eta_t * jacobian_x[1, j]
    force_x[0, 1] += mb * (eta_t * ddtheta - eta * rate * rate) + thrust * sin_tb
    force_x[1, 1] += -mb * (eta * ddtheta + eta_t * rate * rate) + thrust * cos_tb
    force_x[0, 3] += 2.0 * mb * eta_t * rate
    force_x[1, 3] -= 2.0 * mb * eta * rate
    for j in range(2):
        force_u[0, j] = mass * r * jacobian_u[0, j] + mb * eta * jacobian_u[1, j]
        force_u[1, j] = mb * eta_t * jacobian_u[1, j]
    force_u[0, 1] -= cos_tb
    force_u[1, 1] += sin_tb


@njit(cache=True, error_model="numpy")
def mip_acceleration(p: _Array, slope: float, x: _Array, u: _Array, out: _Array) -> None:
    """Write (phi'', theta'') into out (2,); twin of `pendulum.acceleration`."""
    terms = _accelerate(p, math.sin(slope), math.cos(slope), x[1], x[2], x[3], u[0], u[1])
    out[0] = terms[0]
    out[1] = terms[1]


@njit(cache=True, error_model="numpy")
def mip_linearise(p: _Array, slope: float, x: _Array, u: _Array, a: _Array, b: _Array) -> None:
    """Write the continuous-time a (4, 4) and b (4, 2) in place; twin of `pendulum.linearise`."""
    acceleration = np.empty(2)
    force = np.empty(2)
    force_x = np.empty((2, 4))
    force_u = np.empty((2, 2))
    a[:2] = 0.0
    b[:2] = 0.0
    a[0, 2] = 1.0
    a[1, 3] = 1.0
    _linearise(p, math.sin(slope), math.cos(slope), x, u, acceleration, a[2:], b[2:], force, force_x, force_u)


@njit(cache=True, error_model="numpy")
def ground_force(p: _Array, slope: float, x: _Array, u: _Array, out: _Array) -> None:
    """Write (f_x, f_n) into out (2,); twin of `ground_force.ground_force_in_slope`."""
    sin_b = math.sin(slope)
    cos_b = math.cos(slope)
    ddphi, ddtheta, _, _, sin_tb, cos_tb, eta, eta_t, _, _, _ = _accelerate(
        p, sin_b, cos_b, x[1], x[2], x[3], u[0], u[1]
    )
    out[0], out[1] = _force(p, sin_b, cos_b, sin_tb, cos_tb, eta, eta_t, x[3], ddphi, ddtheta, u[1])


@njit(cache=True, error_model="numpy")
def ground_force_linearised(
    p: _Array, slope: float, x: _Array, u: _Array, force: _Array, force_x: _Array, force_u: _Array
) -> None:
    """Write the force (2,) and its derivatives (2, 4), (2, 2); twin of `ground_force.ground_force_linearised`."""
    acceleration = np.empty(2)
    jacobian_x = np.empty((2, 4))
    jacobian_u = np.empty((2, 2))
    sin_b = math.sin(slope)
    cos_b = math.cos(slope)
    _linearise(p, sin_b, cos_b, x, u, acceleration, jacobian_x, jacobian_u, force, force_x, force_u)


@njit(cache=True, error_model="numpy")
def thrust_share(p: _Array, dt: float) -> float:
    """Part of the way to its command that the thrust goes in a time step: f' = (command - f) / T, command held."""
    if p[THRUST_TIME_CONSTANT] <= 0.0:
        return 1.0
    return -math.expm1(-dt / p[THRUST_TIME_CONSTANT])


@njit(cache=True, error_model="numpy", inline="always")
def _advance_and_linearise(
    p: _Array,
    slope: float,
    dt: float,
    share: float,
    x: _Array,
    u: _Array,
    x_next: _Array,
    a: _Array,
    b: _Array,
    force: _Array,
    force_x: _Array,
    force_u: _Array,
    acceleration: _Array,
    jacobian_x: _Array,
    jacobian_u: _Array,
    applied: _Array,
) -> None:
    """One step of a rollout; a fifth state is the thrust, which then follows its command."""
    lagging = x.shape[0] == 5
    applied[0] = u[0]
    applied[1] = x[4] if lagging else u[1]
    _linearise(
        p, math.sin(slope), math.cos(slope), x, applied, acceleration, jacobian_x, jacobian_u, force, force_x, force_u
    )
    for i in range(2):
        x_next[i] = x[i] + dt * x[i + 2]
        x_next[i + 2] = x[i + 2] + dt * acceleration[i]
        for j in range(4):
            a[i, j] = 0.0
            a[i + 2, j] = dt * jacobian_x[i, j]
        a[i, i] = 1.0
        a[i, i + 2] = dt
        a[i + 2, i + 2] += 1.0
        for j in range(2):
            b[i, j] = 0.0
            b[i + 2, j] = dt * jacobian_u[i, j]
    if lagging:
        # What the thrust did as an input it does as a state; the command moves the state alone.
        x_next[4] = x[4] + share * (u[1] - x[4])
        for i in range(4):
            a[i, 4] = b[i, 1]
            b[i, 1] = 0.0
            a[4, i] = 0.0
        a[4, 4] = 1.0 - share
        b[4, 0] = 0.0
        b[4, 1] = share
        for i in range(2):
            force_x[i, 4] = force_u[i, 1]
            force_u[i, 1] = 0.0


@njit(cache=True, error_model="numpy")
def rollout_and_linearise(
    p: _Array,
    slopes: _Array,
    x0: _Array,
    inputs: _Array,
    dt: float,
    states: _Array,
    a: _Array,
    b: _Array,
    force: _Array,
    force_x: _Array,
    force_u: _Array,
) -> None:
    """Roll the explicit-Euler model out (paper, eq. discrete_model) and linearise every step, all in place.

    With nx = 4 states the thrust is an input. With nx = 5 the last state is the thrust itself, the second input its
    command, and the thrust follows with the time constant in p.

    Args:
        p: Parameter vector.
        slopes: Inclination under the robot at each step, shape (n,) [rad].
        x0: Initial state, shape (nx,).
        inputs: Duty and thrust (or its command) at each step, shape (n, 2).
        dt: Time step [s].
        states: Out: x_0 .. x_n, shape (n + 1, nx).
        a: Out: d x_{k+1} / d x_k, shape (n, nx, nx).
        b: Out: d x_{k+1} / d u_k, shape (n, nx, 2).
        force: Out: (f_x, f_n) at (x_k, u_k), shape (n, 2) [N].
        force_x: Out: its derivative with respect to x_k, shape (n, 2, nx).
        force_u: Out: its derivative with respect to u_k, shape (n, 2, 2).
    """
    acceleration, jacobian_x, jacobian_u, applied = np.empty(2), np.empty((2, 4)), np.empty((2, 2)), np.empty(2)
    share = thrust_share(p, dt)
    for j in range(states.shape[1]):
        states[0, j] = x0[j]
    for k in range(inputs.shape[0]):
        _advance_and_linearise(
            p, slopes[k], dt, share, states[k], inputs[k], states[k + 1], a[k], b[k], force[k], force_x[k],
            force_u[k], acceleration, jacobian_x, jacobian_u, applied,
        )  # fmt: skip


@njit(cache=True, error_model="numpy")
def rollout_over_profile(
    p: _Array,
    starts: _Array,
    profile: _Array,
    x0: _Array,
    inputs: _Array,
    dt: float,
    slopes: _Array,
    pieces: _IndexArray,
    states: _Array,
    a: _Array,
    b: _Array,
    force: _Array,
    force_x: _Array,
    force_u: _Array,
) -> None:
    """`rollout_and_linearise` over ground whose slope depends on where the wheels are.

    Each step takes the slope at its own wheel angle; the derivatives do not count that it would be another elsewhere.

    Args:
        p: Parameter vector.
        starts: Wheel angle at which each piece of the ground starts, ascending, shape (m,) [rad]; the first is not
            read, its piece reaches back for ever.
        profile: Inclination of each piece, shape (m,) [rad].
        x0: Initial state, shape (nx,).
        inputs: Duty and thrust (or its command) at each step, shape (n, 2).
        dt: Time step [s].
        slopes: Out: inclination at x_0 .. x_n, shape (n + 1,) [rad].
        pieces: Out: piece that x_0 .. x_n are on, shape (n + 1,).
        states: Out, as the others: see `rollout_and_linearise`.
        a: Out.
        b: Out.
        force: Out.
        force_x: Out.
        force_u: Out.
    """
    acceleration, jacobian_x, jacobian_u, applied = np.empty(2), np.empty((2, 4)), np.empty((2, 2)), np.empty(2)
    share = thrust_share(p, dt)
    n = inputs.shape[0]
    for j in range(states.shape[1]):
        states[0, j] = x0[j]
    for k in range(n + 1):
        piece = 0
        while piece + 1 < starts.shape[0] and states[k, 0] >= starts[piece + 1]:
            piece += 1
        pieces[k] = piece
        slopes[k] = profile[piece]
        if k < n:
            _advance_and_linearise(
                p, slopes[k], dt, share, states[k], inputs[k], states[k + 1], a[k], b[k], force[k], force_x[k],
                force_u[k], acceleration, jacobian_x, jacobian_u, applied,
            )  # fmt: skip


@njit(cache=True, error_model="numpy", inline="always")
def _inputs_for(
    p: _Array,
    sin_b: float,
    cos_b: float,
    pitch: float,
    wheel_rate: float,
    pitch_rate: float,
    ddphi: float,
    ddtheta: float,
) -> tuple[float, float]:
    """Duty and thrust for given accelerations; the thrust from both equations' sum, which is free of the motor."""
    mb = p[MASS_BODY]
    mass = mb + p[MASS_WHEEL]
    r = p[WHEEL_RADIUS]
    sin_t = math.sin(pitch)
    cos_t = math.cos(pitch)
    sin_tb = sin_t * cos_b + cos_t * sin_b
    cos_tb = cos_t * cos_b - sin_t * sin_b
    m12 = mb * r * (p[COM_UP] * cos_tb - p[COM_FORWARD] * sin_tb)
    eta_t = -p[COM_UP] * sin_tb - p[COM_FORWARD] * cos_tb
    m22 = p[INERTIA_BODY] + mb * (p[COM_FORWARD] * p[COM_FORWARD] + p[COM_UP] * p[COM_UP])
    # What motor and thrust must give on the wheel angle and on the pitch: M q'' + h (without back-EMF) - d.
    on_wheel = (p[INERTIA_WHEEL] + mass * r * r) * ddphi + m12 * ddtheta - p[DISTURBANCE_WHEEL]
    on_wheel += mb * r * eta_t * pitch_rate * pitch_rate + mass * p[GRAVITY] * r * sin_b
    on_pitch = m12 * ddphi + m22 * ddtheta - p[DISTURBANCE_PITCH]
    on_pitch -= mb * p[GRAVITY] * (p[COM_FORWARD] * cos_t + p[COM_UP] * sin_t)
    thrust = (on_wheel + on_pitch) / (p[THRUST_UP] + r * cos_tb)
    torque = on_wheel - r * cos_tb * thrust
    duty = (torque + p[BACK_EMF_CONSTANT] * wheel_rate - p[BACK_EMF_PITCH] * pitch_rate) / p[TORQUE_CONSTANT]
    return duty, thrust


@njit(cache=True, error_model="numpy")
def inputs_along(
    nominal: _Array,
    actual: _Array,
    slopes_nominal: _Array,
    slopes: _Array,
    states: _Array,
    inputs: _Array,
    pitch_shift: float,
    lower: _Array,
    upper: _Array,
    out: _Array,
) -> None:
    """Inputs with which another pendulum, on other ground, moves as a nominal one does: inverse dynamics, in place.

    Args:
        nominal: Parameter vector of the pendulum that the inputs are known for.
        actual: Parameter vector of the other one (of the same pendulum with disturbances, say).
        slopes_nominal: Inclination that the inputs are known for, shape (n,) [rad].
        slopes: Inclination that they are wanted for, shape (n,) [rad].
        states: Nominal states, shape (n, 4) or more columns.
        inputs: Nominal duty and thrust, shape (n, 2).
        pitch_shift: The other one's pitch less the nominal one's [rad].
        lower: Least duty and thrust, shape (2,).
        upper: Greatest duty and thrust, shape (2,).
        out: Out: duty and thrust, shape (n, 2), cut at the bounds.
    """
    for k in range(inputs.shape[0]):
        pitch = states[k, 1]
        wheel_rate = states[k, 2]
        pitch_rate = states[k, 3]
        sin_b = math.sin(slopes_nominal[k])
        cos_b = math.cos(slopes_nominal[k])
        motion = _accelerate(nominal, sin_b, cos_b, pitch, wheel_rate, pitch_rate, inputs[k, 0], inputs[k, 1])
        if slopes[k] != slopes_nominal[k]:
            sin_b = math.sin(slopes[k])
            cos_b = math.cos(slopes[k])
        duty, thrust = _inputs_for(
            actual, sin_b, cos_b, pitch + pitch_shift, wheel_rate, pitch_rate, motion[0], motion[1]
        )
        out[k, 0] = min(max(duty, lower[0]), upper[0])
        out[k, 1] = min(max(thrust, lower[1]), upper[1])


@njit(cache=True, error_model="numpy", inline="always")
def _demand(
    p: _Array,
    sin_b: float,
    cos_b: float,
    pitch: float,
    wheel_rate: float,
    pitch_rate: float,
    ddphi: float,
    ddtheta: float,
) -> tuple[float, float, float]:
    """What a motion takes: thrust, friction and normal force [N]."""
    _, thrust = _inputs_for(p, sin_b, cos_b, pitch, wheel_rate, pitch_rate, ddphi, ddtheta)
    sin_t = math.sin(pitch)
    cos_t = math.cos(pitch)
    sin_tb = sin_t * cos_b + cos_t * sin_b
    cos_tb = cos_t * cos_b - sin_t * sin_b
    eta = p[COM_UP] * cos_tb - p[COM_FORWARD] * sin_tb
    eta_t = -p[COM_UP] * sin_tb - p[COM_FORWARD] * cos_tb
    friction, normal = _force(p, sin_b, cos_b, sin_tb, cos_tb, eta, eta_t, pitch_rate, ddphi, ddtheta, thrust)
    return thrust, friction, normal


@njit(cache=True, error_model="numpy", inline="always")
def _excess(demand: tuple[float, float, float], limits: _Array) -> float:
    """By how much a demand leaves the limits on thrust, friction and normal force [N]; negative inside.

    Where the limits leave one thrust only, it is the signed distance from that thrust.
    """
    thrust, friction, normal = demand
    if limits[0] == limits[1]:
        return float(thrust - limits[0])
    excess = max(limits[0] - thrust, thrust - limits[1])
    if limits[2] < math.inf:
        excess = max(excess, abs(friction) - limits[2] * normal)
    return float(max(excess, limits[3] - normal))


@njit(cache=True, error_model="numpy")
def pitch_shift_within_limits(
    nominal: _Array, actual: _Array, slope_nominal: float, slope: float, x: _Array, u: _Array, limits: _Array
) -> tuple[float, float]:
    """Least change of pitch with which another pendulum makes a nominal motion within limits.

    Args:
        nominal: Parameter vector of the nominal pendulum.
        actual: Parameter vector of the other one.
        slope_nominal: Inclination under the nominal one [rad].
        slope: Inclination under the other one [rad].
        x: Nominal state, shape (4,) or more.
        u: Nominal duty and thrust, shape (2,).
        limits: Least and greatest thrust [N], greatest friction over normal force, least normal force [N], shape (4,);
            what the nominal motion itself exceeds them by is allowed. Where both thrusts are equal, the pitch is that
            which needs the nominal motion's thrust, and the other limits do not count: there is no choice.

    Returns:
        The change [rad], 0 if none is needed, and the best there is if none within 20 deg suffices; and the friction
        over normal force that the motion then needs.
    """
    pitch, wheel_rate, pitch_rate = x[1], x[2], x[3]
    sin_n = math.sin(slope_nominal)
    cos_n = math.cos(slope_nominal)
    motion = _accelerate(nominal, sin_n, cos_n, pitch, wheel_rate, pitch_rate, u[0], u[1])
    ddphi, ddtheta = motion[0], motion[1]
    sin_b = math.sin(slope)
    cos_b = math.cos(slope)
    allowed = _excess(_demand(nominal, sin_n, cos_n, pitch, wheel_rate, pitch_rate, ddphi, ddtheta), limits)
    demand = _demand(actual, sin_b, cos_b, pitch, wheel_rate, pitch_rate, ddphi, ddtheta)
    best = _excess(demand, limits)
    side = 1.0
    if limits[0] == limits[1]:
        if best < allowed:
            side = -1.0
    else:
        allowed = max(allowed, 0.0)
    shift = 0.0
    found = side * (best - allowed) <= 0.0
    i = 0
    while not found and i < SHIFT_COUNT:
        i += 1
        for sign in (-1.0, 1.0):
            outer = sign * i * SHIFT_STEP
            trial = _demand(actual, sin_b, cos_b, pitch + outer, wheel_rate, pitch_rate, ddphi, ddtheta)
            excess = _excess(trial, limits)
            if not found and side * (excess - best) < 0.0:
                best, shift, demand = excess, outer, trial
                found = side * (excess - allowed) <= 0.0
    if found and i > 0:
        # The limit lies between this pitch and the one before: bisect.
        inner = shift - math.copysign(SHIFT_STEP, shift)
        for _ in range(20):
            middle = 0.5 * (inner + shift)
            trial = _demand(actual, sin_b, cos_b, pitch + middle, wheel_rate, pitch_rate, ddphi, ddtheta)
            if side * (_excess(trial, limits) - allowed) <= 0.0:
                shift, demand = middle, trial
            else:
                inner = middle
    return shift, abs(demand[1]) / demand[2] if demand[2] > 0.0 else math.inf


@njit(cache=True, error_model="numpy")
def mip_step(p: _Array, slope: float, x: _Array, u: _Array, dt: float, substeps: int, out: _Array) -> None:
    """Advance the pendulum by dt with the inputs held: classical Runge-Kutta of fourth order in equal substeps.

    Args:
        p: Parameter vector.
        slope: Inclination of the ground [rad].
        x: State, shape (4,).
        u: Duty and thrust, held over the step, shape (2,).
        dt: Time to advance [s].
        substeps: Number of Runge-Kutta steps, at least 1.
        out: Out: the new state, shape (4,); may be x itself.
    """
    sin_b = math.sin(slope)
    cos_b = math.cos(slope)
    h = dt / substeps
    phi, theta, dphi, dtheta = x[0], x[1], x[2], x[3]
    for _ in range(substeps):
        k1 = _accelerate(p, sin_b, cos_b, theta, dphi, dtheta, u[0], u[1])
        v2, w2 = dphi + 0.5 * h * k1[0], dtheta + 0.5 * h * k1[1]
        k2 = _accelerate(p, sin_b, cos_b, theta + 0.5 * h * dtheta, v2, w2, u[0], u[1])
        v3, w3 = dphi + 0.5 * h * k2[0], dtheta + 0.5 * h * k2[1]
        k3 = _accelerate(p, sin_b, cos_b, theta + 0.5 * h * w2, v3, w3, u[0], u[1])
        v4, w4 = dphi + h * k3[0], dtheta + h * k3[1]
        k4 = _accelerate(p, sin_b, cos_b, theta + h * w3, v4, w4, u[0], u[1])
        phi += h / 6.0 * (dphi + 2.0 * v2 + 2.0 * v3 + v4)
        theta += h / 6.0 * (dtheta + 2.0 * w2 + 2.0 * w3 + w4)
        dphi += h / 6.0 * (k1[0] + 2.0 * k2[0] + 2.0 * k3[0] + k4[0])
        dtheta += h / 6.0 * (k1[1] + 2.0 * k2[1] + 2.0 * k3[1] + k4[1])
    out[0] = phi
    out[1] = theta
    out[2] = dphi
    out[3] = dtheta
