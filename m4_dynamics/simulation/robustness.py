"""Many climbs of a robot that is not what its controller believes: how often it arrives, and why not.

Every run draws mass, centre of mass, thrust, grip, initial errors and sensor noise from its own seed, so that a table
is the same whatever the number of processes.
"""

from __future__ import annotations

import dataclasses
import math
import multiprocessing
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.simulation.climb import ClimbResult, ClimbSettings, run_climb
from m4_dynamics.simulation.fidelity import Fidelity
from m4_dynamics.simulation.plant_errors import PlantErrors
from m4_dynamics.simulation.verdict import Verdict

__all__ = ["Case", "CaseOutcome", "Spread", "classify", "draw_cases", "run_cases"]

#: What happened just before the end of a run that failed is its cause [s].
CAUSE_WINDOW = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """How far the plant may be from the model.

    Attributes:
        mass: Largest relative error of the mass.
        com: Largest displacement of the robot's CoM, in any direction [m].
        thrust_scale: Thrust given over thrust commanded, in every run.
        friction: Least and greatest mu_s of the ground; the controllers assume the robot's own figure.
        pitch_error: Largest initial pitch error [rad].
        yaw_error: Largest initial heading error [rad].
    """

    mass: float = 0.10
    com: float = 0.02
    thrust_scale: float = 0.85
    friction: tuple[float, float] = (0.7, 0.9)
    pitch_error: float = math.radians(8.0)
    yaw_error: float = math.radians(1.0)


@dataclass(frozen=True, slots=True)
class Case:
    """One run.

    Attributes:
        index: Its number.
        settings: What is climbed.
    """

    index: int
    settings: ClimbSettings


@dataclass(frozen=True, slots=True)
class CaseOutcome:
    """What became of a run.

    Attributes:
        index: Its number.
        cause: "climbed", or why not: "slip", "fall", "saturation", "solver", "short".
        reason: The verdict's sentence.
        slip_time: Of the worst wheel after the first half second [s].
        wheel_error_at_end: [m].
        pitch_rms_deg: After the first second.
        friction_use: Along the slope.
    """

    index: int
    cause: str
    reason: str
    slip_time: float
    wheel_error_at_end: float
    pitch_rms_deg: float
    friction_use: float


def draw_cases(nominal: ClimbSettings, spread: Spread, *, count: int, seed: int, friction_nominal: float) -> list[Case]:
    """Draw runs.

    Args:
        nominal: The climb; its plant errors and initial errors are replaced.
        spread: How far to go.
        count: Number of runs.
        seed: Of the whole table; each run has a stream of its own.
        friction_nominal: mu_s that the controllers assume.

    Returns:
        The runs.

    Raises:
        InvalidSettingError: The count is not positive.
    """
    if count < 1:
        raise InvalidSettingError("count", count, "at least 1 run")
    cases = []
    for index, stream in enumerate(np.random.SeedSequence(seed).spawn(count)):
        generator = np.random.default_rng(stream)
        direction = generator.standard_normal(3)
        distance = spread.com * generator.random() ** (1.0 / 3.0)
        offset = distance * direction / np.linalg.norm(direction)
        errors = PlantErrors(
            mass_scale=1.0 + spread.mass * generator.uniform(-1.0, 1.0),
            com_offset_in_base=(float(offset[0]), float(offset[1]), float(offset[2])),
            thrust_scale=spread.thrust_scale,
            friction_scale=generator.uniform(*spread.friction) / friction_nominal,
        )
        settings = dataclasses.replace(
            nominal,
            plant_errors=errors,
            pitch_error=spread.pitch_error * generator.uniform(-1.0, 1.0),
            yaw_error=spread.yaw_error * generator.uniform(-1.0, 1.0),
            fidelity=_reseeded(nominal.fidelity, int(generator.integers(2**31))),
        )
        cases.append(Case(index, settings))
    return cases


def _reseeded(fidelity: Fidelity, seed: int) -> Fidelity:
    return dataclasses.replace(fidelity, seed=seed)


def classify(result: ClimbResult) -> str:
    """Why a run failed, from what happened in its last half second; "climbed" if it did not.

    Args:
        result: The run.

    Returns:
        "climbed"; "solver" if the optimiser had given up; "saturation" if duty or thrust stood at a limit for most of
        the time; "slip" if a wheel slid; "fall" otherwise; "short" if it stayed up but ended short of its goal.
    """
    summary, dataset = result.summary, result.dataset
    if summary.verdict == Verdict.CLIMBED:
        return "climbed"
    if dataset is None:
        return "infeasible"
    if summary.verdict == Verdict.LAGGED:
        return "short"
    if summary.verdict == Verdict.SLIPPED:
        return "slip"
    last = dataset.sel(time=slice(float(dataset.time[-1]) - CAUSE_WINDOW, None))
    if float(last.fallback.mean()) > 0.1:
        return "solver"
    duty, thrust = np.abs(last.inputs.to_numpy()).T
    limit = float(dataset.attrs["thrust_limit_N"])
    if np.mean((duty >= 0.999) | (thrust <= 1e-3) | (thrust >= limit - 1e-3)) > 0.5:
        return "saturation"
    sliding = last.slip_time.sel(wheel=list(dataset.attrs["drive_wheels"])).to_numpy().sum(axis=0).max()
    return "slip" if sliding > 0.1 else "fall"


def run_cases(
    cases: Iterable[Case],
    *,
    robot: Path | str | None = None,
    workers: int = 1,
    on_progress: Callable[[float], None] | None = None,
) -> list[CaseOutcome]:
    """Run cases, in parallel on this machine.

    Args:
        cases: The runs.
        robot: A robot's description; None takes the bundled M4.
        workers: Processes.
        on_progress: Called with the number of runs done.

    Returns:
        The outcomes, in the order of the cases.
    """
    wanted = list(cases)
    outcomes: list[CaseOutcome] = []
    if workers <= 1:
        loaded = load_robot(robot)
        for case in wanted:
            outcomes.append(_outcome(case, run_climb(loaded, case.settings)))
            if on_progress is not None:
                on_progress(len(outcomes))
        return outcomes
    # Forking a process that runs threads is not safe, and those of the linear algebra are running already.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=workers, mp_context=context) as pool:
        for outcome in pool.map(_run_case, [(case, robot) for case in wanted], chunksize=4):
            outcomes.append(outcome)
            if on_progress is not None:
                on_progress(len(outcomes))
    return outcomes


def _run_case(job: tuple[Case, Path | str | None]) -> CaseOutcome:
    case, robot = job
    return _outcome(case, run_climb(load_robot(robot), case.settings))


def _outcome(case: Case, result: ClimbResult) -> CaseOutcome:
    summary = result.summary
    shortfall = math.nan
    if summary.goal_m is not None and summary.climbed_m is not None:
        shortfall = abs(summary.goal_m - summary.climbed_m)
    return CaseOutcome(
        index=case.index,
        cause=classify(result),
        reason=summary.reason,
        slip_time=_number(summary.slip_time_s),
        wheel_error_at_end=shortfall,
        pitch_rms_deg=_number(summary.pitch_rms_deg),
        friction_use=_number(summary.max_friction_use_along_slope),
    )


def _number(value: float | None) -> float:
    return math.nan if value is None else value
