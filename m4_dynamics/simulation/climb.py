"""The main job: a robot that stands balanced on a slope climbs it, stops and holds, on the full model."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from m4_dynamics.control.controller import BalanceController
from m4_dynamics.control.delay import DelayCompensator
from m4_dynamics.control.heading import HeadingHold
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.control.reference import ReferenceTrajectory, climb_reference
from m4_dynamics.errors import M4Error, NonFiniteError, NoTrimExists
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.stepping import SimulationDivergedError
from m4_dynamics.full.terrain import ramp_terrain
from m4_dynamics.reduced.reduction import (
    Reduction,
    configuration_on_slope,
    holding_torques,
    reduce_robot,
)
from m4_dynamics.reduced.trim import Trim, select_trim
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.balance import BalanceLoop, balance_estimator, drive_wheels
from m4_dynamics.simulation.climb_settings import ClimbSettings
from m4_dynamics.simulation.controllers import make_controller, make_heading_hold, robot_with_rotor_lag
from m4_dynamics.simulation.plant import Plant
from m4_dynamics.simulation.plant_errors import perturbed_robot
from m4_dynamics.simulation.recorder import Recorder
from m4_dynamics.simulation.trajectory import build_trajectory
from m4_dynamics.simulation.verdict import ClimbSummary, StepTimes, Verdict, summarise_climb

if TYPE_CHECKING:
    import xarray

__all__ = ["Climb", "ClimbResult", "ClimbSettings", "prepare_climb", "run_climb"]

#: The idle wheels are shorted, so that they do not spin [N m s/rad].
IDLE_WHEEL_BRAKE = 10.0
#: Imperfect sensors are awake for this long before the robot is let go [s].
TIME_HELD_BEFORE = 2.0
#: The robot fell when its pitch is this far from the reference [rad].
FALL_ANGLE = math.radians(60.0)


@dataclass(frozen=True, slots=True, eq=False)
class Climb:
    """A climb made ready: everything derived from the robot and the settings, nothing simulated yet.

    Attributes:
        settings: What was asked for.
        reduction: The robot as a pendulum.
        trim: The equilibrium that it climbs at.
        reference: What the controller follows.
        controller: The balance controller.
        heading_hold: The heading controller.
        plant: The full model, reset to the start.
        recorder: Empty.
        loop: The closed loop, started.
    """

    settings: ClimbSettings
    reduction: Reduction
    trim: Trim
    reference: ReferenceTrajectory
    controller: BalanceController
    heading_hold: HeadingHold
    plant: Plant
    recorder: Recorder
    loop: BalanceLoop


@dataclass(frozen=True, slots=True, eq=False)
class ClimbResult:
    """A run and its judgement.

    Attributes:
        summary: Verdict and figures.
        dataset: The trajectory; None when no equilibrium exists and nothing was simulated.
    """

    summary: ClimbSummary
    dataset: xarray.Dataset | None


def prepare_climb(
    robot: Robot, settings: ClimbSettings, *, reduction: Reduction | None = None, trim: Trim | None = None
) -> Climb:
    """Reduce, trim, plan, build controllers and plant, and stand the robot on the slope.

    Args:
        robot: A robot that balances.
        settings: What to climb.
        reduction: The robot as a pendulum, if it is known already.
        trim: The equilibrium to climb at, within the limits or not; None chooses one within them.

    Returns:
        The climb, ready to run.

    Raises:
        NoTrimExists: No equilibrium satisfies the limits on this slope.
        RobotDescriptionError: The robot cannot balance.
        InvalidSettingError: The durations do not fit together.
    """
    if reduction is None:
        reduction = reduce_robot(robot_with_rotor_lag(robot, settings.fidelity))
    parameters = reduction.parameters
    friction = robot.ground.friction_static if settings.friction_static is None else settings.friction_static
    if trim is None:
        planned = MpcSettings(friction_static=friction).friction_fraction
        limits = reduction.trim_limits(friction_static=friction, friction_fraction=planned)
        trim = select_trim(
            parameters,
            settings.slope,
            limits=limits,
            criterion="automatic" if settings.thrust is None else "thrust",
            thrust=settings.thrust,
            speed=settings.speed,
        )
    reference = climb_reference(
        parameters,
        settings.slope,
        trim,
        speed=settings.speed,
        duration=settings.duration,
        dt=settings.control_period,
        start_time=settings.start_time,
        ramp_time=settings.ramp_time,
        hold_time=settings.hold_time,
    )
    controller = make_controller(settings.controller, reduction, reference, friction_static=friction)
    if settings.fidelity.control_delay:
        controller = DelayCompensator(
            controller,
            parameters,
            reference,
            delay=settings.fidelity.control_delay,
            rotor_time_constant=parameters.thrust_time_constant,
        )
    heading_hold = make_heading_hold(robot, reduction, trim)
    distance = abs(parameters.wheel_radius * float(np.ptp(reference.state[:, 0])))
    terrain = ramp_terrain(settings.slope, flat_before=1.5, length=settings.start_position + distance + 1.5)
    errors = settings.plant_errors
    ground = errors.applied_to(dataclasses.replace(robot.ground, friction_static=friction))
    plant = Plant(
        FullModel.build(perturbed_robot(robot, errors), errors.applied_to_terrain(terrain), ground=ground),
        control_period=settings.control_period,
        time_step=settings.time_step,
        thrust_scale=errors.thrust_given(robot),
        fidelity=settings.fidelity,
    )
    sinking = trim.normal_force / (2.0 * ground.stiffness)
    configuration = configuration_on_slope(
        robot,
        reduction,
        slope=settings.slope,
        position_along_slope=settings.start_position,
        pitch=float(reference.state[0, 1]) + settings.pitch_error,
        yaw=settings.yaw_error,
        penetration=sinking,
    )
    measurement = plant.reset(configuration)
    # It stands there balanced: its rotors turn already.
    plant.stepper.actuation.thrust[:] = errors.thrust_given(robot) * reference.inputs[0, 1] * reduction.thrust_shares
    if settings.posture_compensation:
        plant.command.servo_targets += holding_torques(robot, reduction, trim).sag
    wheels = drive_wheels(robot, reduction.frame)
    plant.command.wheel_brake[:] = IDLE_WHEEL_BRAKE
    plant.command.wheel_brake[[wheels.left, wheels.right]] = 0.0
    # Somebody holds the robot, rotors running and sensors awake, and lets it go.
    np.multiply(reduction.thrust_shares, reference.inputs[0, 1], out=plant.command.thrust)
    plant.command.wheel_duty[wheels.left] = wheels.sign_left * reference.inputs[0, 0]
    plant.command.wheel_duty[wheels.right] = wheels.sign_right * reference.inputs[0, 0]
    plant.settle_actuators()
    recorder = Recorder(plant, len(reference.time))
    loop = BalanceLoop(
        plant=plant,
        reduction=reduction,
        controller=controller,
        reference=reference,
        heading_hold=heading_hold,
        estimator=balance_estimator(
            robot,
            reduction,
            slope=settings.slope,
            fidelity=settings.fidelity,
            control_period=settings.control_period,
        ),
        recorder=recorder,
    )
    loop.start(
        measurement, heading=settings.yaw_error, held=0.0 if settings.fidelity.senses_exactly else TIME_HELD_BEFORE
    )
    return Climb(settings, reduction, trim, reference, controller, heading_hold, plant, recorder, loop)


def run_climb(
    robot: Robot,
    settings: ClimbSettings,
    *,
    reduction: Reduction | None = None,
    trim: Trim | None = None,
    warm_up: bool = True,
    attributes: Mapping[str, str] | None = None,
    on_progress: Callable[[float], None] | None = None,
    observer: Callable[[Recorder], None] | None = None,
) -> ClimbResult:
    """Climb a slope on the full model.

    An interrupt (Ctrl-C) ends the run early and keeps what is done, with the verdict "aborted".

    Args:
        robot: A robot that balances.
        settings: What to climb.
        reduction: The robot as a pendulum, if it is known already.
        trim: The equilibrium to climb at, within the limits or not; None chooses one within them.
        warm_up: Whether to compile the kernels first, so that the times measured are those of the run alone.
        attributes: Further attributes of the dataset (the command, say).
        on_progress: Called now and then with the simulated time [s].
        observer: Called with the recorder after every control period; the times measured are those without it.

    Returns:
        Summary and trajectory; where no equilibrium exists, the summary alone, with the verdict "infeasible".

    Raises:
        M4Error: The robot or the settings cannot be used.
    """
    friction = robot.ground.friction_static if settings.friction_static is None else settings.friction_static
    context: dict[str, Any] = {
        "controller": settings.controller,
        "fidelity": settings.fidelity.switches,
        "speed_m_s": settings.speed,
        "duration_s": settings.duration,
        "pitch_error_deg": math.degrees(settings.pitch_error),
        "yaw_error_deg": math.degrees(settings.yaw_error),
        "provenance": {**{f"sha256_{k}": v for k, v in robot.file_hashes.items()}, **(attributes or {})},
    }
    try:
        climb = prepare_climb(robot, settings, reduction=reduction, trim=trim)
    except NoTrimExists as error:
        summary = ClimbSummary(
            verdict=Verdict.INFEASIBLE.value,
            reason=str(error),
            slope_deg=round(math.degrees(settings.slope), 9),
            friction_static=friction,
            **context,
        )
        return ClimbResult(summary, None)
    warm_up_time = _warm_up(robot, settings) if warm_up else None
    climb.recorder.observer = observer
    started = time.perf_counter()
    ended = _simulate(climb, on_progress)
    elapsed = time.perf_counter() - started - climb.recorder.observer_seconds
    if climb.recorder.count == 0:
        raise M4Error("the run was interrupted before its first sample; nothing to keep")
    trim, counters = climb.trim, climb.plant.stepper.counters
    dataset = build_trajectory(
        climb.recorder,
        climb.reduction,
        attributes={
            "slope_deg": round(math.degrees(settings.slope), 9),
            "controller": settings.controller,
            "thrust_limit_N": climb.reduction.thrust_max,
            **(attributes or {}),
        },
    )
    summary = summarise_climb(
        dataset,
        ended=ended,
        trim_pitch_deg=math.degrees(trim.pitch),
        trim_thrust_N=trim.thrust,
        trim_friction_needed=trim.friction_needed,
        newton_failures=counters.newton_failures,
        servo_saturations=counters.servo_saturations,
        mpc_step_us=StepTimes.from_seconds(climb.recorder.control_seconds[: climb.recorder.count]),
        real_time_factor=climb.recorder.count * settings.control_period / elapsed,
        warm_up_s=warm_up_time,
        **context,
    )
    dataset.attrs["verdict"] = summary.verdict
    return ClimbResult(summary, dataset)


def _warm_up(robot: Robot, settings: ClimbSettings) -> float:
    """Compile the kernels, or load them from the cache, on a climb of a few samples; returns the time it took [s]."""
    started = time.perf_counter()
    scratch = prepare_climb(robot, settings)
    for _ in range(3):
        scratch.loop.advance()
    return time.perf_counter() - started


def _simulate(climb: Climb, on_progress: Callable[[float], None] | None) -> str | None:
    """Run the loop to its end; returns "verdict: reason" if it ended before its time."""
    loop, plant, reference = climb.loop, climb.plant, climb.reference
    stepper = plant.stepper
    wheels = drive_wheels(plant.model.robot, climb.reduction.frame)
    idle = [i for i in range(len(plant.model.robot.wheels)) if i not in (wheels.left, wheels.right)]
    pitch_reference = reference.state[:, 1].tolist()
    count = len(reference.time)
    try:
        for k in range(count):
            loop.advance()
            if abs(loop.estimator.pitch - pitch_reference[k]) > FALL_ANGLE:
                return (
                    f"fell: it leaned {math.degrees(FALL_ANGLE):.0f} deg away from its reference at {plant.time:.2f} s"
                )
            if k % 20 == 0:
                if stepper.point_force_in_world.any() or stepper.wheel_force_in_world[idle].any():
                    return f"fell: the body touched the ground at {plant.time:.2f} s"
                if on_progress is not None:
                    on_progress(plant.time)
    except KeyboardInterrupt:
        return f"aborted: interrupted at {plant.time:.2f} s"
    except (SimulationDivergedError, NonFiniteError) as error:
        return f"aborted: {error}"
    return None
