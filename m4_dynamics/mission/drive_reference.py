"""Reference for driving along a terrain: travel with a smooth speed, pitch from trim to trim over the corners.

The reduced model has as many inputs as coordinates, so any smooth pitch and travel have inputs that realise them
exactly; the pitch is therefore blended between the trims of the slopes before and after a corner while the wheels cross
it, and from the robot's present pitch to the trim at the start. Rising corners are met slowly: the wheels run into the
second face, the blow unloads them for an instant, and what they need of the grip then grows with the speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from m4_dynamics.control.reference import ReferenceTrajectory, balancing_pitch, smooth_step
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.full.axle_path import AxlePath
from m4_dynamics.reduced.pendulum import MipParameters, inverse_dynamics
from m4_dynamics.reduced.trim import Trim

__all__ = ["DrivePlan", "drive_reference"]

Array = NDArray[np.float64]

#: On the arc over a convex corner the slope turns continuously; the reference takes it in steps of this size [rad].
ARC_STEP = math.radians(5.0)
#: Around a rising corner the slow part of the way, and that over which the speed changes, to either side [m].
CORNER_CORE, CORNER_TAPER = 0.04, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class DrivePlan:
    """How to drive from one place to another.

    Attributes:
        start: Arc length of the axle's path now [m].
        goal: Arc length to reach; the start itself to stand still [m].
        speed: Cruising speed > 0 [m/s].
        ramp_time: Of acceleration and braking [s].
        settle_time: Rest before driving, while the pitch goes from the present one to the trim's [s].
        hold_time: Rest after driving [s].
        corner_time: Over which the pitch changes from trim to trim at a corner [s].
        corner_impact: Speed towards the second face of a rising corner at which the wheels may meet it [m/s]; a 45 deg
            corner is crossed at 0.12 m/s.
    """

    start: float
    goal: float
    speed: float
    ramp_time: float = 1.5
    settle_time: float = 1.0
    hold_time: float = 1.0
    corner_time: float = 1.6
    corner_impact: float = 0.085


def drive_reference(
    parameters: MipParameters,
    path: AxlePath,
    plan: DrivePlan,
    trim_on: Callable[[float], Trim],
    *,
    pitch_now: float,
    thrust_now: float,
    dt: float,
    wheels_alone: bool = False,
) -> ReferenceTrajectory:
    """Plan a drive; wheel angles are the path's arc length over the wheel's radius.

    Args:
        parameters: The pendulum.
        path: The axle's path.
        plan: From where to where.
        trim_on: The trim to take on a slope [rad].
        pitch_now: Pitch at the start [rad].
        thrust_now: Total thrust at the start [N].
        dt: Time between samples [s].
        wheels_alone: Plan for a controller that does not move the thrust: it goes from the present one to the trim's
            while the robot settles, and the duty is the trim's.

    Returns:
        The reference.

    Raises:
        InvalidSettingError: A number of the plan is out of range.
        NoTrimExists: No trim on a slope of the path.
    """
    if not (math.isfinite(plan.speed) and plan.speed > 0.0):
        raise InvalidSettingError("speed [m/s]", plan.speed, "a speed > 0")
    distance = plan.goal - plan.start
    # A short way is driven more slowly, so that both ramps fit into it.
    speed = min(plan.speed, abs(distance) / plan.ramp_time)
    cruise = abs(distance) / speed - plan.ramp_time if distance else 0.0
    driving = 2.0 * plan.ramp_time + cruise if distance else 0.0

    def planned(time: Array) -> tuple[Array, Array, Array]:
        """Travel, speed and acceleration, corners left aside."""
        travel, motion = np.zeros(len(time)), np.zeros((4, len(time)))
        if distance:
            for begin, sign in ((plan.settle_time, 1.0), (plan.settle_time + plan.ramp_time + cruise, -1.0)):
                covered, derivatives = smooth_step(time - begin, plan.ramp_time)
                travel += sign * covered
                motion += sign * derivatives
            direction = math.copysign(speed, distance)
            travel, motion = direction * travel, direction * motion
            motion[:, time >= plan.settle_time + driving] = 0.0
        return travel, motion[0], motion[1]

    end = plan.settle_time + driving + plan.hold_time
    time, length, velocity, acceleration = _slowed_at_corners(path, plan, speed, planned, end, dt)
    count = len(time)
    slope = _stepped(path.slope_at(length))
    pitch = _pitch(parameters, slope, acceleration, trim_on, time, plan, pitch_now)
    spline = CubicSpline(time, pitch, bc_type="clamped")
    radius = parameters.wheel_radius
    state = np.column_stack((length / radius, pitch, velocity / radius, spline(time, 1)))
    pitch_acceleration = spline(time, 2)
    settled = smooth_step(time, plan.settle_time)[1][0] if plan.settle_time > 0.0 else np.ones(count)
    inputs = np.empty((count, 2))
    for k in range(count):
        if wheels_alone:
            trim = trim_on(float(slope[k]))
            # tau = k1 u - k2 phi' (the body is still): the duty grows with the speed.
            back_emf = parameters.back_emf_constant * state[k, 2]
            thrust = trim.thrust + (1.0 - settled[k]) * (thrust_now - trim.thrust)
            inputs[k] = (trim.torque + back_emf) / parameters.torque_constant, thrust
        else:
            accelerations = (acceleration[k] / radius, float(pitch_acceleration[k]))
            inputs[k] = inverse_dynamics(parameters, float(slope[k]), state[k], accelerations)
    return ReferenceTrajectory(time, state, inputs, slope, acceleration)


def _slowed_at_corners(
    path: AxlePath,
    plan: DrivePlan,
    speed: float,
    planned: Callable[[Array], tuple[Array, Array, Array]],
    end: float,
    dt: float,
) -> tuple[Array, Array, Array, Array]:
    """Time, place, speed and acceleration of a plan whose clock runs slower near rising corners."""
    rise = path.slopes[1:, 0] - path.slopes[:-1, 1]
    corners, rises = path.starts[1:][rise > 1e-9], rise[rise > 1e-9]
    towards = speed * np.sin(np.minimum(rises, 0.5 * math.pi))
    shares = np.minimum(1.0, plan.corner_impact / np.maximum(towards, 1e-9))
    corners, shares = corners[shares < 1.0], shares[shares < 1.0]

    def pace(place: Array) -> tuple[Array, Array]:
        """Pace of the plan's clock at a place, and its derivative with respect to the place."""
        total, slope = np.ones(len(place)), np.zeros(len(place))
        for corner, share in zip(corners, shares, strict=True):
            x = np.clip((np.abs(place - corner) - CORNER_CORE) / CORNER_TAPER, 0.0, 1.0)
            factor = share + (1.0 - share) * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
            change = (1.0 - share) * 30.0 * (x * (1.0 - x)) ** 2 * np.sign(place - corner) / CORNER_TAPER
            total, slope = total * factor, slope * factor + total * change
        return total, slope

    # The plan's clock tau runs at the pace g(s): dt = dtau / g, integrated on a finer grid and inverted.
    clock = np.linspace(0.0, end, 4 * round(end / dt) + 1)
    inverse = 1.0 / pace(plan.start + planned(clock)[0])[0]
    elapsed = np.concatenate(([0.0], np.cumsum(0.5 * (inverse[1:] + inverse[:-1]) * np.diff(clock))))
    time: Array = dt * np.arange(round(float(elapsed[-1]) / dt) + 1, dtype=np.float64)
    tau = time if len(corners) == 0 else np.minimum(CubicSpline(elapsed, clock)(time), end)
    travel, velocity, acceleration = planned(tau)
    place = plan.start + travel
    factor, change = pace(place)
    # ds/dt = v g, d2s/dt2 = a g^2 + v^2 g g'.
    return time, place, velocity * factor, acceleration * factor**2 + velocity**2 * factor * change


def _stepped(slope: Array) -> Array:
    """Slopes as they are where they stay, in steps where they turn (over convex corners)."""
    turning = np.zeros(len(slope), dtype=bool)
    turning[1:-1] = (slope[1:-1] != slope[:-2]) & (slope[1:-1] != slope[2:])
    return np.where(turning, ARC_STEP * np.round(slope / ARC_STEP), slope)


def _pitch(
    parameters: MipParameters,
    slope: Array,
    acceleration: Array,
    trim_on: Callable[[float], Trim],
    time: Array,
    plan: DrivePlan,
    pitch_now: float,
) -> Array:
    """Pitch that balances the acceleration on each slope, blended over corners and from the present pitch."""
    pitches = {
        value: balancing_pitch(parameters, value, trim_on(value), acceleration)[0]
        for value in np.unique(slope).tolist()
    }
    pitch = pitches[float(slope[0])].copy()
    for k in np.flatnonzero(np.diff(slope)) + 1:
        # The blend is centred on the crossing; overlapping blends (an arc in steps) follow each other.
        _, derivatives = smooth_step(time - (time[k] - 0.5 * plan.corner_time), plan.corner_time)
        before, after = pitches[float(slope[k - 1])], pitches[float(slope[k])]
        pitch += derivatives[0] * (after - before)
    if plan.settle_time > 0.0:
        _, derivatives = smooth_step(time, plan.settle_time)
        pitch += (1.0 - derivatives[0]) * (pitch_now - float(pitches[float(slope[0])][0]))
    return pitch
