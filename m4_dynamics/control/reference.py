"""Reference trajectories that the reduced model can follow exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError, NoTrimExists, require_finite, require_shape
from m4_dynamics.reduced.pendulum import MipParameters, inverse_dynamics
from m4_dynamics.reduced.trim import Trim

__all__ = ["ReferenceTrajectory", "climb_reference", "pitch_at_acceleration"]

_Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceTrajectory:
    """What a controller follows, sampled at its rate; N samples, at least 2, equally spaced.

    Attributes:
        time: Shape (N,) [s].
        state: (absolute wheel angle, pitch, and their rates), shape (N, 4) [rad, rad/s].
        inputs: (duty, thrust), shape (N, 2) [1, N].
        slope: Inclination under the wheels, shape (N,) [rad].
        acceleration: Of the axle along the slope, shape (N,) [m/s^2].
    """

    time: _Array
    state: _Array
    inputs: _Array
    slope: _Array
    acceleration: _Array

    def __post_init__(self) -> None:
        """Check shapes, finiteness and spacing.

        Raises:
            InvalidSettingError: Names what has the wrong shape, or the spacing.
            NonFiniteError: Names what holds NaN or infinity.
        """
        count = len(self.time)
        if count < 2:
            raise InvalidSettingError("samples of a reference", count, "at least 2")
        for name, shape in (
            ("time", (count,)),
            ("state", (count, 4)),
            ("inputs", (count, 2)),
            ("slope", (count,)),
            ("acceleration", (count,)),
        ):
            require_shape(f"reference {name}", getattr(self, name), shape)
            require_finite(f"reference {name}", getattr(self, name))
        steps = np.diff(self.time)
        if not (steps[0] > 0.0 and np.allclose(steps, steps[0], rtol=1e-6, atol=0.0)):
            raise InvalidSettingError("time of a reference", (steps.min(), steps.max()), "equal steps > 0")

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.time)

    @property
    def time_step(self) -> float:
        """Time between samples [s]."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    def sample_index(self, step: int) -> int:
        """Index of the sample for a control step: the last sample holds beyond the end.

        Raises:
            InvalidSettingError: If the step is negative.
        """
        if step < 0:
            raise InvalidSettingError("step", step, "an integer >= 0")
        return min(step, len(self.time) - 1)

    def steadiest_samples(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """For each distinct slope, the sample that is nearest to an equilibrium: where to linearise once per slope.

        Returns:
            Sample of least acceleration per distinct slope, shape (slopes,), and for each sample of the trajectory the
            position of its slope in that list, shape (N,).
        """
        slopes, slope_index = np.unique(self.slope, return_inverse=True)
        unrest = np.abs(self.acceleration) + np.abs(self.state[:, 3])
        samples = [int(np.argmin(np.where(slope_index == index, unrest, np.inf))) for index in range(len(slopes))]
        return np.array(samples, dtype=np.intp), slope_index.astype(np.intp)


def climb_reference(
    parameters: MipParameters,
    slope: float,
    trim: Trim,
    *,
    speed: float = 0.3,
    duration: float = 10.0,
    dt: float = 0.005,
    start_time: float = 0.5,
    ramp_time: float = 1.5,
    hold_time: float = 2.0,
    start_wheel_angle: float = 0.0,
) -> ReferenceTrajectory:
    """Rest, accelerate, cruise, stop and hold on one slope, as an exact solution of the reduced model.

    The speed follows 35 s^4 - 84 s^5 + 70 s^6 - 20 s^7 on each ramp: acceleration, jerk and snap start and end at zero, so
    the pitch that balances the acceleration at the trim's thrust has continuous rates and accelerations, and so have the
    inputs, which come from the inverse dynamics (paper, eq. eom_2d_v2).

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        trim: Equilibrium on that slope, gives the branch of the pitch and the thrust.
        speed: Cruising speed along the slope, negative drives backwards, 0 stays [m/s].
        duration: Of the whole trajectory [s].
        dt: Time between samples [s].
        start_time: Rest before the first ramp [s].
        ramp_time: Duration of each ramp [s].
        hold_time: Rest after the second ramp [s].
        start_wheel_angle: Absolute wheel angle at the start [rad].

    Returns:
        The trajectory, round(duration / dt) + 1 samples.

    Raises:
        InvalidSettingError: If the times do not fit into the duration or a number is not finite.
        NoTrimExists: If no pitch balances the acceleration of the ramps (limit "acceleration").
    """
    require_finite(
        "climb reference",
        (slope, speed, duration, dt, start_time, ramp_time, hold_time, start_wheel_angle),
        ("slope", "speed", "duration", "dt", "start_time", "ramp_time", "hold_time", "start_wheel_angle"),
    )
    if dt <= 0.0 or ramp_time <= 0.0 or start_time < 0.0 or hold_time < 0.0:
        received = f"dt {dt}, start_time {start_time}, ramp_time {ramp_time}, hold_time {hold_time}"
        raise InvalidSettingError("times of the climb", received, "dt and ramp_time > 0, the others >= 0")
    cruise_end = duration - hold_time - ramp_time
    if cruise_end < start_time + ramp_time:
        least = start_time + 2.0 * ramp_time + hold_time
        raise InvalidSettingError("duration", duration, f"at least {least:g} s for rest, two ramps and hold")

    time = dt * np.arange(round(duration / dt) + 1)
    position = np.zeros_like(time)
    derivatives = np.zeros((4, len(time)))  # speed, acceleration, jerk, snap along the slope
    for ramp_start, sign in ((start_time, 1.0), (cruise_end, -1.0)):
        ramp_position, ramp_derivatives = _ramp(time - ramp_start, ramp_time)
        position += sign * speed * ramp_position
        derivatives += sign * speed * ramp_derivatives
    derivatives[:, time >= duration - hold_time] = 0.0  # rest is rest, without the rounding of the difference
    velocity, acceleration, jerk, snap = derivatives

    radius = parameters.wheel_radius
    state = np.zeros((len(time), 4))
    inputs = np.zeros((len(time), 2))
    for k in range(len(time)):
        pitch, pitch_a, pitch_aa = pitch_at_acceleration(parameters, slope, trim, float(acceleration[k]))
        pitch_rate = pitch_a * jerk[k]
        pitch_acceleration = pitch_aa * jerk[k] ** 2 + pitch_a * snap[k]
        state[k] = start_wheel_angle + position[k] / radius, pitch, velocity[k] / radius, pitch_rate
        inputs[k] = inverse_dynamics(parameters, slope, state[k], (acceleration[k] / radius, pitch_acceleration))
    return ReferenceTrajectory(time, state, inputs, np.full(len(time), float(slope)), acceleration)


def pitch_at_acceleration(
    parameters: MipParameters, slope: float, trim: Trim, acceleration: float
) -> tuple[float, float, float]:
    """Pitch that balances a steady acceleration along the slope at the trim's thrust, and how it varies.

    Adding the two equations of motion (paper, eq. eom_2d_v2) removes the motor torque and leaves
    P sin(theta) + Q cos(theta) + K = 0, whose coefficients are affine in the acceleration.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        trim: Equilibrium on that slope; of the two solutions the one nearer to its pitch is taken.
        acceleration: Of the axle along the slope [m/s^2].

    Returns:
        theta [rad], d theta / da [rad s^2/m] and its derivative [rad s^4/m^2].

    Raises:
        NoTrimExists: If no pitch balances it (limit "acceleration").
    """
    com_forward, com_up = parameters.com_in_body
    body, gravity, radius, thrust = parameters.mass_body, parameters.gravity, parameters.wheel_radius, trim.thrust
    sin_b, cos_b = math.sin(slope), math.cos(slope)
    # Each coefficient: its part at rest, and its derivative with respect to the acceleration.
    p_rest, p_a = thrust * radius * sin_b - body * gravity * com_up, -body * (com_up * sin_b + com_forward * cos_b)
    q_rest, q_a = -thrust * radius * cos_b - body * gravity * com_forward, body * (com_up * cos_b - com_forward * sin_b)
    k_rest = parameters.mass * gravity * radius * sin_b - thrust * parameters.thrust_point_in_body[1]
    k_a = parameters.mass * radius + parameters.inertia_wheel / radius

    p, q, k = p_rest + p_a * acceleration, q_rest + q_a * acceleration, k_rest + k_a * acceleration
    amplitude, phase = math.hypot(p, q), math.atan2(q, p)
    if abs(k) >= amplitude:
        raise NoTrimExists(
            f"no pitch balances an acceleration of {acceleration:.2f} m/s^2 on {math.degrees(slope):.1f} deg with "
            f"{thrust:.1f} N of thrust: the moment to balance is {abs(k):.2f} N m, gravity and thrust give at most "
            f"{amplitude:.2f} N m",
            limit="acceleration",
        )
    # amplitude * sin(theta + phase) = -k
    angle = math.asin(-k / amplitude)
    candidates = (angle - phase, math.pi - angle - phase)
    offset = min((math.remainder(c - trim.pitch, 2.0 * math.pi) for c in candidates), key=abs)
    pitch = trim.pitch + offset

    sin_t, cos_t = math.sin(pitch), math.cos(pitch)
    f_t = p * cos_t - q * sin_t
    f_tt = -p * sin_t - q * cos_t
    f_a = p_a * sin_t + q_a * cos_t + k_a
    f_ta = p_a * cos_t - q_a * sin_t
    pitch_a = -f_a / f_t
    return pitch, pitch_a, -(2.0 * f_ta * pitch_a + f_tt * pitch_a**2) / f_t


def _ramp(time: _Array, duration: float) -> tuple[_Array, _Array]:
    """Integral (N,), value and first three derivatives (4, N) of the smooth step from 0 to 1 that starts at time 0."""
    s = np.clip(time / duration, 0.0, 1.0)
    integral = duration * s**5 * (7.0 + s * (-14.0 + s * (10.0 - 2.5 * s))) + np.maximum(time - duration, 0.0)
    value = s**4 * (35.0 + s * (-84.0 + s * (70.0 - 20.0 * s)))
    rest = 1.0 - s
    first = 140.0 * (s * rest) ** 3 / duration
    second = 420.0 * (s * rest) ** 2 * (1.0 - 2.0 * s) / duration**2
    third = 840.0 * s * rest * (1.0 - 5.0 * s * rest) / duration**3
    return integral, np.stack([value, first, second, third])
