"""One start of a region of attraction: does the robot come back to its equilibrium from there, and how."""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.reference import ReferenceTrajectory
from m4_dynamics.errors import NonFiniteError
from m4_dynamics.feasibility.cell import PlantName
from m4_dynamics.feasibility.job import Field
from m4_dynamics.feasibility.reduced_rollout import came_down, grip_missing, run_reduced
from m4_dynamics.feasibility.rollout import largest, saturation_times
from m4_dynamics.full.stepping import SimulationDivergedError
from m4_dynamics.reduced.reduction import Reduction, velocity_on_slope
from m4_dynamics.reduced.trim import Trim
from m4_dynamics.reduced.trim_limits import ground_clearance
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.balance import drive_wheels
from m4_dynamics.simulation.climb import FALL_ANGLE, Climb, ClimbSettings, prepare_climb
from m4_dynamics.simulation.controllers import make_controller
from m4_dynamics.simulation.trajectory import build_trajectory
from m4_dynamics.simulation.verdict import SLIP_TIME_ALLOWED

__all__ = [
    "ATTRACTION_FIELDS",
    "OUTCOMES",
    "OUTCOME_FIELDS",
    "Outcome",
    "Stand",
    "Start",
    "outcome_code",
    "prepare_start",
    "run_start",
]

_Array = NDArray[np.float64]

#: The robot is back when pitch, pitch rate, place and speed stay within these to the end [rad, rad/s, m, m/s].
BACK_WITHIN = (math.radians(1.0), math.radians(5.0), 0.05, 0.05)
#: Least time that it has to stay there [s].
BACK_FOR = 0.25
#: Control steps between two looks for a body on the ground.
_LOOK_EVERY = 20


class Outcome(StrEnum):
    """What became of a start.

    Attributes:
        RETURNED: Back at the equilibrium and at its place, without sliding for long.
        SLID: Back, but a wheel slid for longer than 0.1 s in all. On the reduced model, whose wheels cannot slide:
            rolling needed more grip than there is for as long, so that it says nothing.
        ASTRAY: Still up at the end, but not back.
        FELL: The body touched the ground, or leaned 60 deg away from the equilibrium.
        ABORTED: The simulation diverged, or the controller gave up.
    """

    RETURNED = "returned"
    SLID = "slid"
    ASTRAY = "astray"
    FELL = "fell"
    ABORTED = "aborted"


#: Outcomes in the order of their codes in a map.
OUTCOMES: tuple[Outcome, ...] = tuple(Outcome)
#: Figures that are outcomes.
OUTCOME_FIELDS = ("outcome", "outcome_reduced")

#: Figures of a start, in the order of a record. NaN: not known for this plant, or nothing was simulated.
ATTRACTION_FIELDS: dict[str, Field] = {
    "outcome": Field("1", "what became of the start"),
    "outcome_reduced": Field("1", "what becomes of the same start on the reduced model"),
    "settling_time": Field("s", "time until the robot was back for good"),
    "slip_time": Field("s", "time that a wheel slid (reduced model: would need more grip than there is)"),
    "air_time": Field("s", "time that a drive wheel was off the ground"),
    "duty_saturated": Field("s", "time at full duty"),
    "thrust_saturated": Field("s", "time at a bound of the thrust"),
    "solver_failures": Field("1", "control steps answered by the fallback"),
    "pitch_excursion": Field("rad", "largest pitch off the equilibrium"),
    "axle_excursion": Field("m", "largest travel of the axle off its place"),
    "yaw_error": Field("rad", "initial heading"),
    "simulated_time": Field("s", "simulated until the end or the fall"),
    "elapsed": Field("s", "time that the computation took"),
}


def outcome_code(outcome: Outcome) -> float:
    """Code of an outcome in a map."""
    return float(OUTCOMES.index(outcome))


class Start(NamedTuple):
    """Where a rollout starts, off the equilibrium.

    Attributes:
        wheel_speed: Of the axle along the slope, the wheels rolling [m/s].
        pitch_error: [rad].
        pitch_rate: [rad/s].
        yaw_error: Heading, positive left of uphill; the reduced model has none [rad].
    """

    wheel_speed: float
    pitch_error: float
    pitch_rate: float
    yaw_error: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Stand:
    """A robot that stands at an equilibrium under a controller; all that is needed to run a start.

    Attributes:
        robot: The robot.
        reduction: The robot as a pendulum.
        trim: The equilibrium.
        reference: Rest at it.
        climb: Slope, friction, controller, duration; a climb at no speed.
        plant: "full" simulates the full model, and the reduced one beside it; "mip" the reduced one alone.
    """

    robot: Robot
    reduction: Reduction
    trim: Trim
    reference: ReferenceTrajectory
    climb: ClimbSettings
    plant: PlantName


class _Course(NamedTuple):
    """A simulated start.

    Attributes:
        error: True state less the equilibrium's, shape (n, 4).
        inputs: Shape (n, 2).
        fell: Whether the robot came down.
        slip_time: [s].
        air_time: [s]; NaN where it is not known.
        failures: Control steps answered by the fallback.
    """

    error: _Array
    inputs: _Array
    fell: bool
    slip_time: float
    air_time: float
    failures: int


def run_start(stand: Stand, start: Start) -> _Array:
    """Run one start.

    Args:
        stand: What stands where.
        start: Where it starts.

    Returns:
        Its record, shape (fields,); see `ATTRACTION_FIELDS`.
    """
    started = time.perf_counter()
    record = dict.fromkeys(ATTRACTION_FIELDS, math.nan)
    record.update(yaw_error=start.yaw_error, simulated_time=0.0)
    pitch = stand.trim.pitch + start.pitch_error
    reduction = stand.reduction
    radius = reduction.parameters.wheel_radius
    clearance = ground_clearance(stand.climb.slope, np.array([pitch]), reduction.outline_in_body, radius)
    if float(clearance[0]) < 0.0 or abs(start.pitch_error) > FALL_ANGLE:
        record.update(dict.fromkeys(OUTCOME_FIELDS, outcome_code(Outcome.FELL)))
    else:
        outcome, figures = _judged(stand, _roll_reduced, start)
        record.update(figures, outcome=outcome_code(outcome), outcome_reduced=outcome_code(outcome))
        if stand.plant == "full":
            outcome, figures = _judged(stand, _roll_full, start)
            record.update(figures, outcome=outcome_code(outcome))
    record["elapsed"] = time.perf_counter() - started
    return np.array(list(record.values()))


def _judged(stand: Stand, roll: Any, start: Start) -> tuple[Outcome, dict[str, float]]:
    """Simulate and judge; the figures of a start that was not simulated to its end are those up to there."""
    try:
        course: _Course = roll(stand, start)
    except (SimulationDivergedError, NonFiniteError):
        return Outcome.ABORTED, {"simulated_time": 0.0}
    period, radius = stand.reference.time_step, stand.reduction.parameters.wheel_radius
    error = course.error
    scaled = np.abs(error[:, [1, 3, 0, 2]] * np.array([1.0, 1.0, radius, radius]))
    outside = np.flatnonzero((scaled > np.array(BACK_WITHIN)).any(axis=1))
    settling = period * (outside[-1] + 1) if len(outside) else 0.0
    back = not course.fell and settling <= period * len(error) - BACK_FOR
    figures = {
        "settling_time": settling if back else math.nan,
        "slip_time": course.slip_time,
        "air_time": course.air_time,
        **saturation_times(course.inputs, stand.reduction.thrust_max),
        "solver_failures": float(course.failures),
        "pitch_excursion": largest(error[:, 1]),
        "axle_excursion": radius * largest(error[:, 0]),
        "simulated_time": period * len(error),
    }
    if course.fell:
        return Outcome.FELL, figures
    if not back:
        return Outcome.ASTRAY, figures
    return Outcome.SLID if course.slip_time > SLIP_TIME_ALLOWED else Outcome.RETURNED, figures


def _roll_reduced(stand: Stand, start: Start) -> _Course:
    reduction, reference = stand.reduction, stand.reference
    friction = float(stand.climb.friction_static or 0.0)
    controller = make_controller(stand.climb.controller, reduction, reference, friction_static=friction)
    run = run_reduced(
        reduction,
        reference,
        controller,
        pitch_error=start.pitch_error,
        pitch_rate=start.pitch_rate,
        wheel_rate=start.wheel_speed / reduction.parameters.wheel_radius,
    )
    count = len(run.time)
    return _Course(
        error=run.state - reference.state[:count],
        inputs=run.inputs,
        fell=came_down(run, reduction, stand.climb.slope),
        slip_time=float(np.count_nonzero(grip_missing(run, friction)) * reference.time_step),
        air_time=math.nan,
        failures=run.fallbacks,
    )


def prepare_start(stand: Stand, start: Start) -> Climb:
    """Put the full model at a start, in motion, its wheels rolling; nothing is simulated yet.

    Args:
        stand: What stands where.
        start: Where it starts.

    Returns:
        The closed loop, ready to run.
    """
    settings = dataclasses.replace(stand.climb, pitch_error=start.pitch_error, yaw_error=start.yaw_error)
    climb = prepare_climb(stand.robot, settings, reduction=stand.reduction, trim=stand.trim)
    climb.plant.velocity[:] = velocity_on_slope(
        stand.robot,
        stand.reduction,
        slope=settings.slope,
        pitch=stand.trim.pitch + start.pitch_error,
        yaw=start.yaw_error,
        speed=start.wheel_speed,
        pitch_rate=start.pitch_rate,
    )
    climb.loop.start(climb.plant.measure_held(), heading=start.yaw_error)
    return climb


def _roll_full(stand: Stand, start: Start) -> _Course:
    climb = prepare_start(stand, start)
    fell = _advance(climb)
    attributes = {"slope_deg": math.degrees(stand.climb.slope)}
    dataset = build_trajectory(climb.recorder, climb.reduction, attributes=attributes)
    on_wheels = dataset.sel(wheel=list(dataset.attrs["drive_wheels"]))
    return _Course(
        error=(dataset["state"] - dataset["state_reference"]).to_numpy(),
        inputs=dataset["inputs"].to_numpy(),
        fell=fell,
        slip_time=float(on_wheels["slip_time"].sum("time").max()),
        air_time=float(on_wheels["air_time"].sum("time").max()),
        failures=int(dataset["fallback"].sum()),
    )


def _advance(climb: Climb) -> bool:
    """Run the loop to its end or to the fall; returns whether the robot fell."""
    loop, stepper = climb.loop, climb.plant.stepper
    wheels = drive_wheels(climb.plant.model.robot, climb.reduction.frame)
    idle = [i for i in range(len(climb.plant.model.robot.wheels)) if i not in (wheels.left, wheels.right)]
    for k in range(len(climb.reference)):
        loop.advance()
        if not abs(loop.estimator.pitch - climb.trim.pitch) <= FALL_ANGLE:
            return True
        if k % _LOOK_EVERY == 0 and (stepper.point_force_in_world.any() or stepper.wheel_force_in_world[idle].any()):
            return True
    return False
