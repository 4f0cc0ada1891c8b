"""Rollouts of one cell: the controller on the full and on the reduced model from a perturbed start."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray

from m4_dynamics.control.mpc.controller import MpcController
from m4_dynamics.control.reference import ReferenceTrajectory, climb_reference
from m4_dynamics.errors import InvalidSettingError, M4Error, NoTrimExists
from m4_dynamics.feasibility.cell import FIELDS, CellIndex, RolloutSettings, start_errors, verdict_code
from m4_dynamics.feasibility.grid import AXIS_UNITS, MapGrid
from m4_dynamics.feasibility.job import Axis, Field, Place, Record, start_axis
from m4_dynamics.feasibility.provenance import sweep_identity
from m4_dynamics.feasibility.reduced_rollout import ReducedRun, grip_missing, judge_reduced, run_reduced
from m4_dynamics.reduced.reduction import Reduction
from m4_dynamics.reduced.trim import Trim, trim_branches
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import ClimbResult, ClimbSettings, run_climb
from m4_dynamics.simulation.controllers import make_controller
from m4_dynamics.simulation.verdict import SETTLING_TIME, SLIP_GRACE, ClimbSummary, Verdict

__all__ = [
    "BATCHES",
    "RolloutJob",
    "cell_settings",
    "cell_trim",
    "largest",
    "nearest_cell",
    "replay_cell",
    "run_cell",
    "saturation_times",
]

_Array = NDArray[np.float64]

#: Plant -> rollouts in a task.
BATCHES = {"full": 1, "mip": 8}
_SATURATED = 1e-6
_CONTROL_PERIOD = 5e-3


@dataclass(frozen=True, slots=True, eq=False)
class RolloutJob:
    """All that a worker needs; it travels once.

    Attributes:
        robot: The robot.
        reduction: The robot as a pendulum.
        grid: The map's axes.
        settings: What the cells have in common.
    """

    robot: Robot
    reduction: Reduction
    grid: MapGrid
    settings: RolloutSettings

    @property
    def kind(self) -> str:
        """See `SweepJob`."""
        return "closed-loop"

    @property
    def store_axes(self) -> dict[str, Axis]:
        """Friction, slope, thrust and start."""
        axes = {name: Axis(self.grid.axes[name], *AXIS_UNITS[name]) for name in ("friction", "slope", "thrust")}
        return {**axes, "start": start_axis(self.settings.starts)}

    @property
    def fields(self) -> dict[str, Field]:
        """See `FIELDS`."""
        return FIELDS

    @property
    def batch(self) -> int:
        """A rollout on the full model takes a hundred times as long as a task costs."""
        return BATCHES[self.settings.plant]

    @property
    def adaptive(self) -> bool:
        """See `RolloutSettings`."""
        return self.settings.adaptive

    def identity(self) -> dict[str, Any]:
        """Robot, version, axes and settings."""
        return sweep_identity(self.robot, self.grid, self.settings)

    def run(self, places: Sequence[Place]) -> list[Record]:
        """Run some cells; their records hold `FIELDS`."""
        return [(place, run_cell(self, CellIndex(*place))) for place in places]

    def succeeded(self, records: _Array) -> NDArray[np.bool_]:
        """Whether the robot climbed."""
        return np.asarray(records[..., 0] == verdict_code(Verdict.CLIMBED))


def cell_trim(job: RolloutJob, index: CellIndex) -> Trim | None:
    """The equilibrium that a cell climbs at, within its limits or not.

    Args:
        job: The job.
        index: The cell.

    Returns:
        Of the branches within all limits the one that needs less friction, else the upright one; None if there is no
        equilibrium, or if it takes more thrust than there is.
    """
    axes = job.grid.axes
    limits = job.reduction.trim_limits(friction_static=float(axes["friction"][index.friction]))
    thrust = float(axes["thrust"][index.thrust])
    if thrust > limits.thrust_range[1]:
        return None
    slope = float(axes["slope"][index.slope])
    members = trim_branches(job.reduction.parameters, slope, thrust, speed=job.settings.speed, limits=limits)
    allowed = [member for member in members if member.within_limits]
    if allowed:
        return min(allowed, key=lambda member: member.friction_needed)
    return members[0] if members else None


def cell_settings(job: RolloutJob, index: CellIndex) -> ClimbSettings:
    """The climb of a cell: what reproduces one rollout of a map on its own.

    Args:
        job: The job.
        index: The cell and the number of the start.

    Returns:
        The settings.
    """
    axes, settings = job.grid.axes, job.settings
    errors = start_errors(settings, index)
    return ClimbSettings(
        slope=float(axes["slope"][index.slope]),
        friction_static=float(axes["friction"][index.friction]),
        speed=settings.speed,
        thrust=float(axes["thrust"][index.thrust]),
        controller=settings.controller,
        duration=settings.duration,
        start_time=settings.start_time,
        ramp_time=settings.ramp_time,
        hold_time=settings.hold_time,
        pitch_error=errors.pitch,
        yaw_error=errors.yaw,
        control_period=_CONTROL_PERIOD,
    )


def nearest_cell(
    job: RolloutJob, *, slope: float, thrust: float, friction: float | None = None, start: int = 0
) -> CellIndex:
    """The cell nearest to a place on the axes.

    Args:
        job: The job.
        slope: [rad].
        thrust: [N].
        friction: mu_s; None takes the first.
        start: Number of the start.

    Returns:
        The cell.

    Raises:
        InvalidSettingError: The place lies more than a cell outside the axes, or there is no such start.
    """
    axes = job.grid.axes
    found = {"friction": 0}
    for name, wanted in (("slope", slope), ("thrust", thrust), ("friction", friction)):
        if wanted is None:
            continue
        values = axes[name]
        spacing = float(np.diff(values).max()) if len(values) > 1 else 1e-9 + 0.01 * abs(float(values[0]))
        if not values[0] - spacing <= wanted <= values[-1] + spacing:
            shown, low, high = (math.degrees(v) if name == "slope" else v for v in (wanted, values[0], values[-1]))
            unit = " [deg]" if name == "slope" else ""
            raise InvalidSettingError(f"{name}{unit}", round(float(shown), 6), f"on the map, {low:g} to {high:g}")
        found[name] = int(np.argmin(np.abs(values - wanted)))
    if not 0 <= start < job.settings.starts:
        raise InvalidSettingError("start", start, f"0 to {job.settings.starts - 1}")
    return CellIndex(found["friction"], found["slope"], found["thrust"], start)


def replay_cell(job: RolloutJob, index: CellIndex, *, attributes: Mapping[str, str] | None = None) -> ClimbResult:
    """Simulate one cell again on the full model, and keep the trajectory.

    Args:
        job: The job.
        index: The cell.
        attributes: Further attributes of the trajectory.

    Returns:
        Summary and trajectory.

    Raises:
        NoTrimExists: There is no equilibrium to start from.
    """
    climb, trim = cell_settings(job, index), cell_trim(job, index)
    if trim is None:
        raise NoTrimExists(
            f"nothing to replay: no equilibrium on {math.degrees(climb.slope):g} deg with {climb.thrust:g} N of thrust",
            "equilibrium",
        )
    return run_climb(job.robot, climb, reduction=job.reduction, trim=trim, warm_up=False, attributes=attributes)


def run_cell(job: RolloutJob, index: CellIndex) -> _Array:
    """Run one cell from one start.

    Args:
        job: The job.
        index: The cell and the number of the start.

    Returns:
        Its record, shape (fields,); see `FIELDS`.
    """
    started = time.perf_counter()
    record = dict.fromkeys(FIELDS, math.nan)
    climb = cell_settings(job, index)
    record.update(pitch_error=climb.pitch_error, yaw_error=climb.yaw_error, goal=0.0, climbed=0.0, simulated_time=0.0)
    trim = cell_trim(job, index)
    if trim is None:
        nothing = verdict_code(Verdict.INFEASIBLE)
        record.update(verdict=nothing, verdict_reduced=nothing)
    else:
        record["trim_pitch"] = trim.pitch
        try:
            _run_trim(job, climb, trim, record)
        except NoTrimExists:
            # The equilibrium has no room to move off: no pitch balances the acceleration of the ramps.
            record.update(verdict=verdict_code(Verdict.INFEASIBLE))
        except M4Error:
            # No gain exists, or the simulation diverged.
            record.update(verdict=verdict_code(Verdict.ABORTED))
    record["elapsed"] = time.perf_counter() - started
    return np.array(list(record.values()))


def _run_trim(job: RolloutJob, climb: ClimbSettings, trim: Trim, record: dict[str, float]) -> None:
    parameters, friction = job.reduction.parameters, float(climb.friction_static or 0.0)
    reference = climb_reference(
        parameters,
        climb.slope,
        trim,
        speed=climb.speed,
        duration=climb.duration,
        dt=climb.control_period,
        start_time=climb.start_time,
        ramp_time=climb.ramp_time,
        hold_time=climb.hold_time,
    )
    record["goal"] = parameters.wheel_radius * float(reference.state[-1, 0])
    controller = make_controller(climb.controller, job.reduction, reference, friction_static=friction)
    run = run_reduced(job.reduction, reference, controller, pitch_error=climb.pitch_error)
    verdict, slip_time = judge_reduced(run, job.reduction, reference, friction)
    record["verdict_reduced"] = verdict_code(verdict)
    if verdict != Verdict.CLIMBED and trim.within_limits:
        record.update(_what_would_help(job, climb, reference))
    if job.settings.plant == "mip":
        record["verdict"] = record["verdict_reduced"]
        record.update(_reduced_figures(run, job.reduction, reference, friction, slip_time))
        return
    result = run_climb(job.robot, climb, reduction=job.reduction, trim=trim, warm_up=False)
    if result.summary.verdict == Verdict.ABORTED and "interrupted" in result.summary.reason:
        raise KeyboardInterrupt
    record["verdict"] = verdict_code(result.summary.verdict)
    if result.dataset is not None:
        record.update(_full_figures(result.summary, result.dataset, job.reduction))


def _what_would_help(job: RolloutJob, climb: ClimbSettings, reference: ReferenceTrajectory) -> dict[str, float]:
    """Take away the controller's friction margin, the error of the start, and both: an effect is what makes it fail."""
    friction = float(climb.friction_static or 0.0)
    found = {}
    for name, margin, error in (
        ("without_margin", False, climb.pitch_error),
        ("without_error", True, 0.0),
        ("without_both", False, 0.0),
    ):
        controller = make_controller(climb.controller, job.reduction, reference, friction_static=friction)
        if not margin and isinstance(controller, MpcController):
            # The controller plans with a share of the friction that it is told.
            share = controller.problem.settings.friction_fraction
            told = friction / share
            controller = make_controller(climb.controller, job.reduction, reference, friction_static=told)
        run = run_reduced(job.reduction, reference, controller, pitch_error=error)
        found[name] = verdict_code(judge_reduced(run, job.reduction, reference, friction)[0])
    return found


def saturation_times(inputs: _Array, thrust_max: float) -> dict[str, float]:
    """Time at the inputs' bounds; a robot without thrusters has no bound to be at."""
    at_bound = (inputs[:, 1] <= _SATURATED) | (inputs[:, 1] >= thrust_max - _SATURATED)
    return {
        "duty_saturated": _CONTROL_PERIOD * float(np.count_nonzero(np.abs(inputs[:, 0]) >= 1.0 - _SATURATED)),
        "thrust_saturated": _CONTROL_PERIOD * float(np.count_nonzero(at_bound)) if thrust_max > 0.0 else 0.0,
    }


def _reduced_figures(
    run: ReducedRun, reduction: Reduction, reference: ReferenceTrajectory, friction: float, slip_time: float
) -> dict[str, float]:
    settled, graced = run.time >= SETTLING_TIME, run.time >= SLIP_GRACE
    wanting = np.count_nonzero(grip_missing(run, friction)[~graced])
    error = run.state - reference.state[: len(run.time)]
    radius = reduction.parameters.wheel_radius
    along, normal = run.ground_force[graced, 0], run.ground_force[graced, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        used = np.where(normal > 0.0, np.abs(along) / normal, np.inf)
    return {
        **saturation_times(run.inputs, reduction.thrust_max),
        "slip_time": slip_time,
        "slip_time_start": _CONTROL_PERIOD * float(wanting),
        "solver_failures": float(run.fallbacks),
        "friction_used": largest(used),
        "normal_force_min": float(normal.min()) if normal.size else math.nan,
        "duty_max": largest(run.inputs[graced, 0]),
        "wheel_rms": radius * _rms(error[settled, 0]),
        "pitch_rms": _rms(error[settled, 1]),
        "climbed": radius * float(run.state[-1, 0]) if len(run.time) else 0.0,
        "simulated_time": _CONTROL_PERIOD * len(run.time),
    }


def _full_figures(summary: ClimbSummary, dataset: xarray.Dataset, reduction: Reduction) -> dict[str, float]:
    graced = dataset["time"].to_numpy() >= SLIP_GRACE
    inputs = dataset["inputs"].to_numpy()
    force = dataset["ground_force_simulated"].to_numpy()[graced]
    sliding = dataset["slip_time"].sel(wheel=list(dataset.attrs["drive_wheels"])).to_numpy()
    pressed = force[:, 1] > 1e-6
    figures = {
        "slip_time": summary.slip_time_s,
        "slip_time_start": float(sliding[~graced].sum(axis=0).max()),
        "slip_distance": summary.slip_distance_m,
        "air_time": summary.air_time_s,
        "solver_failures": summary.fallbacks,
        "wheel_rms": summary.wheel_rms_m,
        "pitch_rms": None if summary.pitch_rms_deg is None else math.radians(summary.pitch_rms_deg),
        "yaw_max": None if summary.yaw_max_deg is None else math.radians(summary.yaw_max_deg),
        "climbed": summary.climbed_m,
    }
    return {
        **{name: math.nan if value is None else float(value) for name, value in figures.items()},
        **saturation_times(inputs, reduction.thrust_max),
        "friction_used": largest(force[pressed, 0] / force[pressed, 1]),
        "normal_force_min": float(force[:, 1].min()) if len(force) else math.nan,
        "duty_max": largest(inputs[graced, 0]),
        "simulated_time": _CONTROL_PERIOD * len(inputs),
    }


def largest(values: _Array) -> float:
    """Largest absolute value; NaN of nothing."""
    return float(np.max(np.abs(values))) if values.size else math.nan


def _rms(values: _Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan
