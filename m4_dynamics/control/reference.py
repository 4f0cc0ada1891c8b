"""Reference trajectories that the reduced model can follow exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import InvalidSettingError, NoTrimExists, require_finite, require_shape
from m4_dynamics.reduced.equilibrium import equilibrium_pitches
from m4_dynamics.reduced.pendulum import MipParameters, inverse_dynamics
from m4_dynamics.reduced.trim import Trim

__all__ = ["ReferenceTrajectory", "balancing_pitch", "climb_reference", "smooth_step"]

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

    The speed follows 35 s^4 - 84 s^5 + 70 s^6 - 20 s^7 on each ramp: acceleration, jerk and snap start and end at zero,
    so the pitch that balances the acceleration at the trim's thrust has continuous rates and accelerations, and so have
    the inputs, which come from the inverse dynamics (paper, eq. eom_2d_v2).

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

    time: _Array = dt * np.arange(round(duration / dt) + 1, dtype=np.float64)
    position = np.zeros_like(time)
    derivatives = np.zeros((4, len(time)))  # speed, acceleration, jerk, snap along the slope
    for ramp_start, sign in ((start_time, 1.0), (cruise_end, -1.0)):
        ramp_position, ramp_derivatives = smooth_step(time - ramp_start, ramp_time)
        position += sign * speed * ramp_position
        derivatives += sign * speed * ramp_derivatives
    derivatives[:, time >= duration - hold_time] = 0.0  # rest is rest, without the rounding of the difference
    velocity, acceleration, jerk, snap = derivatives

    pitch, pitch_a, pitch_aa = balancing_pitch(parameters, slope, trim, acceleration)
    radius = parameters.wheel_radius
    state = np.column_stack([start_wheel_angle + position / radius, pitch, velocity / radius, pitch_a * jerk])
    accelerations = np.column_stack([acceleration / radius, pitch_aa * jerk**2 + pitch_a * snap])
    inputs = np.array(
        [inverse_dynamics(parameters, slope, *sample) for sample in zip(state, accelerations, strict=True)]
    )
    return ReferenceTrajectory(time, state, inputs, np.full(len(time), float(slope)), acceleration)


def balancing_pitch(
    parameters: MipParameters, slope: float, trim: Trim, acceleration: ArrayLike
) -> tuple[_Array, _Array, _Array]:
    """Pitch that balances a steady acceleration along the slope at the trim's thrust, and how it varies.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        trim: Equilibrium on that slope; of the two solutions the one nearer to its pitch is taken.
        acceleration: Of the axle along the slope, any shape [m/s^2].

    Returns:
        theta [rad], d theta / da [rad s^2/m] and its derivative [rad s^4/m^2], each of that shape.

    Raises:
        NoTrimExists: If no pitch balances one of the accelerations (limit "acceleration").
    """
    a = np.asarray(acceleration, dtype=np.float64)
    pitches = equilibrium_pitches(parameters, slope, trim.thrust, acceleration=a)
    unbalanced = a[np.isnan(pitches).any(axis=0)]
    if unbalanced.size > 0:
        worst = unbalanced[np.argmax(np.abs(unbalanced))]
        raise NoTrimExists(
            f"no pitch balances an acceleration of {worst:.2f} m/s^2 on {math.degrees(slope):.1f} deg with "
            f"{trim.thrust:.1f} N of thrust; lower the speed or lengthen the ramps",
            limit="acceleration",
        )
    offsets = np.mod(pitches - trim.pitch + np.pi, 2.0 * np.pi) - np.pi
    pitch = trim.pitch + np.take_along_axis(offsets, np.abs(offsets).argmin(axis=0)[np.newaxis], axis=0)[0]

    # The sum of both equations of motion, free of the motor torque, is an implicit function g(theta, a) = 0.
    l_x, l_z = parameters.com_in_body
    m_b, r = parameters.mass_body, parameters.wheel_radius
    sin_t, cos_t, sin_tb, cos_tb = np.sin(pitch), np.cos(pitch), np.sin(pitch + slope), np.cos(pitch + slope)
    eta = l_z * cos_tb - l_x * sin_tb
    eta_t = -l_z * sin_tb - l_x * cos_tb
    weight_body = m_b * parameters.gravity
    g_a = parameters.inertia_wheel / r + parameters.mass * r + m_b * eta
    g_t = m_b * eta_t * a - weight_body * (l_z * cos_t - l_x * sin_t) + trim.thrust * r * sin_tb
    g_ta = m_b * eta_t
    g_tt = -m_b * eta * a + weight_body * (l_x * cos_t + l_z * sin_t) + trim.thrust * r * cos_tb
    pitch_a = -g_a / g_t
    return pitch, pitch_a, -(2.0 * g_ta * pitch_a + g_tt * pitch_a**2) / g_t


def smooth_step(time: _Array, duration: float) -> tuple[_Array, _Array]:
    """The smooth step 35 s^4 - 84 s^5 + 70 s^6 - 20 s^7 from 0 to 1, s = t / duration.

    Args:
        time: Since the step's start, shape (N,) [s].
        duration: Of the step [s].

    Returns:
        Its integral, shape (N,) [s], and its value and first three derivatives, shape (4, N).
    """
    s = np.clip(time / duration, 0.0, 1.0)
    integral = duration * s**5 * (7.0 + s * (-14.0 + s * (10.0 - 2.5 * s))) + np.maximum(time - duration, 0.0)
    value = s**4 * (35.0 + s * (-84.0 + s * (70.0 - 20.0 * s)))
    rest = 1.0 - s
    first = 140.0 * (s * rest) ** 3 / duration
    second = 420.0 * (s * rest) ** 2 * (1.0 - 2.0 * s) / duration**2
    third = 840.0 * s * rest * (1.0 - 5.0 * s * rest) / duration**3
    return integral, np.stack([value, first, second, third])
