"""Stand, drive and turn on two wheels under a balance controller."""

from __future__ import annotations

import math
from time import perf_counter

import numpy as np

from m4_dynamics.control.delay import DelayCompensator
from m4_dynamics.control.reference import ReferenceTrajectory, smooth_step
from m4_dynamics.control.slope_profile import SlopeProfile
from m4_dynamics.full.axle_path import AxlePath
from m4_dynamics.mission.drive_reference import ARC_STEP, DrivePlan, drive_reference
from m4_dynamics.mission.schema import BalancePhase
from m4_dynamics.mission.situation import MissionAborted, Situation
from m4_dynamics.reduced.trim import Trim
from m4_dynamics.simulation.controllers import make_controller

__all__ = ["run_balance_phase"]

#: Turning on the spot, mean rate [rad/s].
TURN_RATE = 0.5


def profile_of(path: AxlePath) -> SlopeProfile:
    """The ground by wheel angle, for the MPC's preview; the turn over a convex corner in steps of a few degrees.

    Args:
        path: The axle's way.

    Returns:
        Slopes over the absolute wheel angle.
    """
    starts, slopes = [], []
    ends = np.append(path.starts[1:], math.inf)
    for start, end, (before, after) in zip(path.starts, ends, path.slopes, strict=True):
        pieces = 1 if before == after else math.ceil(abs(after - before) / ARC_STEP)
        for piece in range(pieces):
            share = piece / pieces
            starts.append(start if piece == 0 else start + share * (end - start))
            slopes.append(before + (share + 0.5 / pieces) * (after - before))
    return SlopeProfile(np.array(starts) / path.radius, np.array(slopes))


def plan_reference(situation: Situation, phase: BalancePhase) -> ReferenceTrajectory:
    """What a phase's controller follows, from where the robot is now.

    Args:
        situation: The robot.
        phase: What to do.

    Returns:
        The reference.

    Raises:
        NoTrimExists: No trim on a slope of the way.
    """
    state = situation.estimator.state
    here = situation.travel
    turn_time = abs(phase.turn) / TURN_RATE
    plan = DrivePlan(
        start=here,
        goal=here if phase.goal is None else phase.goal,
        speed=phase.speed,
        settle_time=max(phase.settle_time, 0.5) + turn_time,
        hold_time=phase.hold_time,
    )
    thrust = 0.0 if phase.controller == "pid" and phase.thrust is None else phase.thrust
    return drive_reference(
        situation.reduction.parameters,
        situation.path,
        plan,
        lambda slope: situation.trim_on(slope, thrust),
        pitch_now=float(state[1]),
        thrust_now=float(situation.plant.command.thrust.sum()),
        dt=situation.plant.control_period,
        wheels_alone=phase.controller == "pid",
    )


def run_balance_phase(situation: Situation, phase: BalancePhase) -> str | None:
    """Run the phase to its end.

    Args:
        situation: The robot, balancing; left at the end of the phase.
        phase: What to do.

    Returns:
        None when done, else why the time-out was met.

    Raises:
        MissionAborted: The robot fell, or leaves its reference.
        NoTrimExists: No trim on a slope of the way.
    """
    plant, estimator = situation.plant, situation.estimator
    situation.sense()
    reference = plan_reference(situation, phase)
    controller = make_controller(
        phase.controller,
        situation.reduction,
        reference,
        friction_static=plant.model.ground.friction_static,
        profile=profile_of(situation.path),
    )
    if situation.fidelity.control_delay:
        controller = DelayCompensator(
            controller,
            situation.reduction.parameters,
            reference,
            delay=situation.fidelity.control_delay,
            rotor_time_constant=situation.reduction.parameters.thrust_time_constant,
        )
    controller.reset()
    thrust = 0.0 if phase.controller == "pid" and phase.thrust is None else phase.thrust
    turn_from = situation.heading
    turned = smooth_step(reference.time, max(abs(phase.turn) / TURN_RATE, plant.control_period))[1][0]
    situation.brake(drive_wheels=False)
    slopes = reference.slope.tolist()
    trim = situation.trim_on(slopes[0], thrust)
    hold = situation.heading_hold(trim)
    for k in range(len(reference)):
        state = situation.sense()
        if k and slopes[k] != slopes[k - 1]:
            trim = situation.trim_on(slopes[k], thrust)
            standing = hold.standing
            hold = situation.heading_hold(trim)
            hold.standing = standing
        situation.heading = turn_from + phase.turn * float(turned[k])
        started = perf_counter()
        duty, force = controller.control(k, state)
        seconds = perf_counter() - started
        differential = hold.control(estimator.heading - situation.heading, estimator.heading_rate)
        situation.command(float(duty), float(force), differential)
        situation.hold_legs(trim)
        situation.advance(
            state,
            (float(duty), float(force)),
            differential=differential,
            reference=(reference.state[k], reference.inputs[k]),
            diagnostics=controller.diagnostics,
            seconds=seconds,
        )
        _require_upright(situation, float(reference.state[k, 1]), trim)
        if k * plant.control_period > phase.timeout:
            return f"the drive is planned to take {reference.time[-1]:.1f} s, longer than its time-out"
    return None


def _require_upright(situation: Situation, pitch_reference: float, trim: Trim) -> None:
    rule, estimator = situation.abort, situation.estimator
    error = estimator.pitch - pitch_reference
    if abs(error) > rule.pitch_error:
        raise MissionAborted(
            f"the pitch is {math.degrees(abs(error)):.0f} deg from its reference on a slope of "
            f"{math.degrees(trim.slope):.0f} deg"
        )
    if abs(estimator.roll) > rule.roll:
        raise MissionAborted(f"the robot rolls by {math.degrees(abs(estimator.roll)):.0f} deg")
    if abs(estimator.heading - situation.heading) > rule.heading_error:
        error = math.degrees(abs(estimator.heading - situation.heading))
        raise MissionAborted(f"the heading is {error:.0f} deg off")
    if np.any(situation.plant.stepper.point_force_in_world) or situation.body_touches_ground():
        raise MissionAborted("the body touches the ground")
