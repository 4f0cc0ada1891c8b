"""Run a mission: one simulation from the first phase to the last, nothing reset on the way."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.errors import ConvergenceError, NonFiniteError, NoTrimExists
from m4_dynamics.full.axle_path import AxlePath
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.standing import standing_configuration
from m4_dynamics.full.stepping import SimulationDivergedError
from m4_dynamics.full.terrain import Terrain, flat_terrain, plateau_terrain, ramp_terrain
from m4_dynamics.mission.balance_phase import run_balance_phase
from m4_dynamics.mission.posture_phase import run_posture_phase
from m4_dynamics.mission.schema import (
    BalancePhase,
    HoldPhase,
    Mission,
    MorphPhase,
    Phase,
    RaisePhase,
    SitPhase,
    TerrainPlan,
)
from m4_dynamics.mission.situation import MissionAborted, Situation
from m4_dynamics.mission.summary import MissionSummary, PhaseOutcome, summarise_mission
from m4_dynamics.mission.tilt_phase import run_tilt_phase
from m4_dynamics.reduced.reduction import reduce_robot
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.balance import balance_estimator, drive_wheels
from m4_dynamics.simulation.controllers import robot_with_rotor_lag
from m4_dynamics.simulation.fidelity import Fidelity
from m4_dynamics.simulation.plant import Plant
from m4_dynamics.simulation.plant_errors import PlantErrors, perturbed_robot
from m4_dynamics.simulation.recorder import Recorder
from m4_dynamics.simulation.trajectory import build_trajectory

if TYPE_CHECKING:
    import xarray

__all__ = ["MissionResult", "prepare_mission", "run_mission"]

#: After an abort the robot is watched for this long [s].
AFTERMATH = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class MissionResult:
    """A mission's run.

    Attributes:
        summary: Verdict, phases, figures.
        dataset: The trajectory, up to where it ended.
    """

    summary: MissionSummary
    dataset: xarray.Dataset


def terrain_of(plan: TerrainPlan, *, flat_before: float) -> Terrain:
    """The terrain of a mission; the foot of its slope lies at the world's origin."""
    if plan.profile == "flat":
        return flat_terrain()
    if plan.profile == "ramp":
        return ramp_terrain(plan.slope, flat_before=flat_before, length=plan.length)
    return plateau_terrain(plan.slope, flat_before=flat_before, length=plan.length)


def prepare_mission(
    robot: Robot, mission: Mission, *, fidelity: Fidelity | None = None, plant_errors: PlantErrors | None = None
) -> Situation:
    """Put the robot at a mission's start.

    Args:
        robot: The robot.
        mission: The mission.
        fidelity: What sets actuators and sensors apart from ideal ones; None is nothing.
        plant_errors: How the simulated robot differs from the one that the controllers know; None is not at all.

    Returns:
        The situation, at rest.

    Raises:
        InvalidMissionError: The mission names what the robot does not have.
        RobotDescriptionError: The robot cannot balance.
    """
    mission.check_against(robot)
    fidelity = Fidelity() if fidelity is None else fidelity
    reduction = reduce_robot(robot_with_rotor_lag(robot, fidelity))
    start = mission.start
    terrain = terrain_of(mission.terrain, flat_before=max(start.distance_to_foot, 0.0) + 1.5)
    friction = mission.terrain.friction_static
    ground = robot.ground if friction is None else dataclasses.replace(robot.ground, friction_static=friction)
    errors = PlantErrors() if plant_errors is None else plant_errors
    model = FullModel.build(
        perturbed_robot(robot, errors), errors.applied_to_terrain(terrain), ground=errors.applied_to(ground)
    )
    plant = Plant(model, fidelity=fidelity, thrust_scale=errors.thrust_given(robot))
    configuration = standing_configuration(robot, start.posture)
    turn = pin.AngleAxis(start.heading, np.array([0.0, 0.0, 1.0])).toRotationMatrix()
    configuration[0] = -start.distance_to_foot
    configuration[3:7] = pin.Quaternion(turn).coeffs()
    plant.reset(configuration)
    capacity = math.ceil((sum(phase.timeout for phase in mission.phases) + AFTERMATH + 5.0) / plant.control_period)
    limits = reduction.trim_limits(
        friction_static=ground.friction_static, friction_fraction=MpcSettings().friction_fraction
    )
    situation = Situation(
        robot=robot,
        reduction=reduction,
        plant=plant,
        path=AxlePath.over(terrain, reduction.parameters.wheel_radius),
        estimator=balance_estimator(robot, reduction, slope=0.0, fidelity=fidelity),
        recorder=Recorder(plant, capacity, origin=0.0),
        wheels=drive_wheels(robot, reduction.frame),
        abort=mission.abort,
        limits=limits,
        fidelity=fidelity,
    )
    situation.estimator.reset(plant.measurement)
    situation.localise()
    situation.heading = situation.estimator.heading
    return situation


def run_mission(
    robot: Robot,
    mission: Mission,
    *,
    fidelity: Fidelity | None = None,
    plant_errors: PlantErrors | None = None,
    attributes: Mapping[str, str] | None = None,
    on_progress: Callable[[str, float], None] | None = None,
    observer: Callable[[Recorder], None] | None = None,
) -> MissionResult:
    """Run a mission on the full model.

    If a phase fails, the robot is made safe (thrust to zero, wheels braked, legs held), and the trajectory up to there
    is kept. An interrupt (Ctrl-C) does the same.

    Args:
        robot: The robot.
        mission: The mission.
        fidelity: What sets actuators and sensors apart from ideal ones; None is nothing.
        plant_errors: How the simulated robot differs from the one that the controllers know; None is not at all.
        attributes: Further attributes of the dataset.
        on_progress: Called before each phase with its name and the simulated time [s].
        observer: Called with the recorder after every control period; the times measured are those without it.

    Returns:
        Summary and trajectory.

    Raises:
        InvalidMissionError: The mission names what the robot does not have.
        M4Error: The robot cannot be used.
    """
    situation = prepare_mission(robot, mission, fidelity=fidelity, plant_errors=plant_errors)
    recorder = situation.recorder
    recorder.observer = observer
    outcomes: list[PhaseOutcome] = []
    failure: str | None = None
    started = perf_counter()
    for index, phase in enumerate(mission.phases):
        if on_progress is not None:
            on_progress(phase.name, situation.plant.time)
        recorder.current_phase, recorder.phase_name = index, phase.name
        recorder.balancing = isinstance(phase, BalancePhase)
        first = recorder.count
        failure = _run_phase(situation, phase)
        outcomes.append(PhaseOutcome(phase.name, phase.kind, first, recorder.count, failure))
        if failure is not None:
            break
    if failure is not None and "interrupted" not in failure:
        recorder.current_phase, recorder.phase_name = len(mission.phases), "made safe"
        recorder.balancing = False
        _make_safe(situation)
    elapsed = perf_counter() - started - recorder.observer_seconds
    controllers = {phase.controller for phase in mission.phases if isinstance(phase, BalancePhase)}
    dataset = build_trajectory(
        recorder,
        situation.reduction,
        attributes={
            "mission": mission.name,
            "phases": [phase.name for phase in mission.phases] + (["made safe"] if failure is not None else []),
            "phase_kinds": [phase.kind for phase in mission.phases] + (["safe"] if failure is not None else []),
            "phase_controllers": [
                phase.controller if isinstance(phase, BalancePhase) else "none" for phase in mission.phases
            ]
            + (["none"] if failure is not None else []),
            "slope_deg": round(math.degrees(mission.terrain.slope), 9),
            "controller": ", ".join(sorted(controllers)),
            "thrust_limit_N": situation.reduction.thrust_max,
            **(attributes or {}),
        },
    )
    summary = summarise_mission(
        dataset,
        mission,
        tuple(outcomes),
        real_time_factor=recorder.count * situation.plant.control_period / elapsed,
        newton_failures=situation.plant.stepper.counters.newton_failures,
        thrust_max=situation.reduction.thrust_max,
    )
    dataset.attrs["verdict"] = summary.verdict
    return MissionResult(summary, dataset)


def _run_phase(situation: Situation, phase: Phase) -> str | None:
    """Run one phase; returns None, or why it failed."""
    try:
        if isinstance(phase, HoldPhase | MorphPhase):
            return _timed_out(run_posture_phase(situation, phase))
        if isinstance(phase, RaisePhase | SitPhase):
            return _timed_out(run_tilt_phase(situation, phase))
        return _timed_out(run_balance_phase(situation, phase))
    except MissionAborted as abort:
        return f"aborted at {situation.plant.time:.2f} s: {abort}"
    except (NoTrimExists, ConvergenceError) as error:
        return f"infeasible: {error}"
    except (SimulationDivergedError, NonFiniteError) as error:
        return f"diverged: {error}"
    except KeyboardInterrupt:
        return f"interrupted at {situation.plant.time:.2f} s"


def _timed_out(reason: str | None) -> str | None:
    return None if reason is None else f"timed out: {reason}"


def _make_safe(situation: Situation) -> None:
    """Thrust to zero, wheels braked, legs held, and a look at what becomes of it."""
    plant = situation.plant
    if not np.isfinite(plant.velocity).all():
        return
    situation.brake(drive_wheels=True)
    plant.command.thrust[:] = 0.0
    for _ in range(round(AFTERMATH / plant.control_period)):
        state = situation.sense()
        try:
            situation.advance(state, (0.0, 0.0))
        except SimulationDivergedError:
            return
