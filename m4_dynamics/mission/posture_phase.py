"""Phases on four wheels or on the skids: wait, or move the servos to a posture."""

from __future__ import annotations

import math

import numpy as np

from m4_dynamics.control.reference import smooth_step
from m4_dynamics.mission.schema import HoldPhase, MorphPhase
from m4_dynamics.mission.situation import Situation

__all__ = ["run_posture_phase"]

#: A morph has arrived when every servo is this near its target [rad] ...
ARRIVED_ANGLE = math.radians(2.0)
#: ... and the base moves more slowly than this [m/s, rad/s].
ARRIVED_SPEED = 0.02


def run_posture_phase(situation: Situation, phase: HoldPhase | MorphPhase) -> str | None:
    """Run the phase to its end.

    Args:
        situation: The robot; left at the end of the phase.
        phase: What to do.

    Returns:
        None when done, else why the time-out was met.
    """
    plant, robot = situation.plant, situation.robot
    servo_q = plant.model.servo_indices[:, 0]
    start = plant.command.servo_targets.copy()
    goal = start if isinstance(phase, HoldPhase) else robot.posture(phase.posture).configuration[servo_q]
    situation.brake(drive_wheels=True)
    plant.command.thrust[:] = 0.0
    steps = math.ceil(phase.timeout / plant.control_period)
    times = plant.control_period * np.arange(steps, dtype=np.float64)
    progress = smooth_step(times, phase.duration)[1][0]
    for k in range(steps):
        state = situation.sense()
        plant.command.servo_targets[:] = start + progress[k] * (goal - start)
        situation.advance(state, (0.0, 0.0))
        if times[k] >= phase.duration:
            error = float(np.abs(plant.configuration[servo_q] - goal).max())
            speed = float(np.abs(plant.velocity[:6]).max())
            if isinstance(phase, HoldPhase) or (error < ARRIVED_ANGLE and speed < ARRIVED_SPEED):
                return None
    return (
        f"after {phase.timeout:g} s a servo is still {math.degrees(error):.1f} deg from its target and the base moves "
        f"at {speed:.3f} m/s"
    )
