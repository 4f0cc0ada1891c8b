"""Raise and sit: the thrusters turn the body about the rear axle, from its skids to its balance and back.

The pendulum on its wheels has as many inputs as coordinates, so its inverse dynamics give duty and thrust for any
wanted acceleration: a smooth pitch reference with both error poles placed, and the wheels held where they are. While
the robot still rolls over the tips of its skids the wheels hang and are braked; the same law then asks for more thrust
than is needed, and the reference is simply left behind.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.reference import smooth_step
from m4_dynamics.mission.schema import RaisePhase, SitPhase
from m4_dynamics.mission.situation import MissionAborted, Situation
from m4_dynamics.reduced.pendulum import inverse_dynamics
from m4_dynamics.reduced.trim import Trim

__all__ = ["run_tilt_phase"]

Array = NDArray[np.float64]

#: Natural frequencies of the error dynamics, critically damped [rad/s].
PITCH_FREQUENCY = 5.0
WHEEL_FREQUENCY = 3.0
#: The body is raised when pitch and rates are this near the trim's [rad, rad/s].
RAISED_ANGLE, RAISED_RATE = math.radians(2.0), 0.1
#: Thrust runs down over this time once the robot sits [s].
RUN_DOWN_TIME = 0.5


def run_tilt_phase(situation: Situation, phase: RaisePhase | SitPhase) -> str | None:
    """Run the phase to its end.

    Args:
        situation: The robot; left at the end of the phase.
        phase: What to do.

    Returns:
        None when done, else why the time-out was met.

    Raises:
        MissionAborted: The robot leaves its reference.
    """
    plant, parameters = situation.plant, situation.reduction.parameters
    raising = isinstance(phase, RaisePhase)
    touch = situation.touch_pitch()
    on_wheels = not raising
    state = situation.sense()
    start = float(state[1])
    trim = situation.trim_on(0.0, phase.thrust if isinstance(phase, RaisePhase) else None)
    goal = trim.pitch if raising else -0.5 * math.pi
    heading_hold = situation.heading_hold(trim)
    rest = float(state[0])
    steps = math.ceil(phase.timeout / plant.control_period)
    times = plant.control_period * np.arange(steps, dtype=np.float64)
    step, rate, acceleration = smooth_step(times, phase.duration)[1][:3]
    worst = 0.0
    for k in range(steps):
        state = situation.sense()
        if raising and not on_wheels and state[1] > touch:
            situation.localise()
            state = situation.sense()
            on_wheels, rest = True, float(state[0])
        elif not raising and on_wheels and state[1] < touch:
            on_wheels = False
        if not raising and not on_wheels and times[k] >= phase.duration and abs(state[3]) < RAISED_RATE:
            _run_down(situation)
            return None
        reference = np.array([rest, start + (goal - start) * step[k], 0.0, (goal - start) * rate[k]], dtype=np.float64)
        error = reference - state
        wanted_pitch = (
            (goal - start) * acceleration[k]
            + PITCH_FREQUENCY**2 * error[1]
            + 2.0 * PITCH_FREQUENCY * error[3]
        )  # fmt: skip
        wanted_wheel = WHEEL_FREQUENCY**2 * error[0] + 2.0 * WHEEL_FREQUENCY * error[2] if on_wheels else 0.0
        duty, thrust = inverse_dynamics(parameters, 0.0, state, (wanted_wheel, wanted_pitch))
        thrust = min(max(float(thrust), 0.0), situation.reduction.thrust_max)
        duty = min(max(float(duty), -1.0), 1.0) if on_wheels else 0.0
        situation.brake(drive_wheels=not on_wheels)
        differential = 0.0
        if on_wheels:
            differential = heading_hold.control(
                situation.estimator.heading - situation.heading, situation.estimator.heading_rate
            )
        situation.command(duty, thrust, differential)
        situation.hold_legs(trim)
        _require_on_track(situation, error, on_wheels)
        wanted = reference, np.array([duty, thrust])
        situation.advance(state, (duty, thrust), differential=differential, reference=wanted)
        worst = abs(float(error[1]))
        if raising and times[k] >= phase.duration and _raised(state, trim):
            return None
    return f"after {phase.timeout:g} s the pitch is still {math.degrees(worst):.1f} deg from its reference"


def _raised(state: Array, trim: Trim) -> bool:
    near = abs(state[1] - trim.pitch) < RAISED_ANGLE
    return bool(near and abs(state[3]) < RAISED_RATE and abs(state[2]) < 2.0 * RAISED_RATE)


def _require_on_track(situation: Situation, error: Array, on_wheels: bool) -> None:
    rule, estimator = situation.abort, situation.estimator
    if abs(error[1]) > rule.pitch_error:
        raise MissionAborted(f"the pitch is {math.degrees(abs(error[1])):.0f} deg from its reference")
    if abs(estimator.roll) > rule.roll:
        raise MissionAborted(f"the robot rolls by {math.degrees(abs(estimator.roll)):.0f} deg")
    if on_wheels and abs(estimator.heading - situation.heading) > rule.heading_error:
        raise MissionAborted(f"the heading is {math.degrees(abs(estimator.heading - situation.heading)):.0f} deg off")


def _run_down(situation: Situation) -> None:
    """On the skids: thrust runs down, wheels braked."""
    situation.brake(drive_wheels=True)
    start = situation.plant.command.thrust.copy()
    steps = round(RUN_DOWN_TIME / situation.plant.control_period)
    for k in range(steps):
        state = situation.sense()
        situation.plant.command.thrust[:] = start * (1.0 - (k + 1) / steps)
        situation.advance(state, (0.0, float(situation.plant.command.thrust.sum())))
