"""A mission as data: a start, a terrain, abort rules and phases.

Kinds of phases: `hold` (wait), `morph` (servos to a posture), `raise` (thrusters lift the body from its skids about the
rear axle until it balances), `balance` (stand, drive, turn under a balance controller), `sit` (the reverse of raise).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from m4_dynamics.errors import M4Error
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.controllers import ControllerName

__all__ = [
    "AbortRule",
    "BalancePhase",
    "HoldPhase",
    "InvalidMissionError",
    "Mission",
    "MorphPhase",
    "Phase",
    "Profile",
    "RaisePhase",
    "SitPhase",
    "Start",
    "TerrainPlan",
]

Profile = Literal["flat", "ramp", "plateau"]


class InvalidMissionError(M4Error):
    """A mission file is missing, malformed or asks for what the robot does not have; names phase and key."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """Where the robot begins, at rest.

    Attributes:
        posture: Joint angles at the start.
        distance_to_foot: Of the base, from the foot of the slope [m], positive before it.
        heading: Of the base about the vertical [rad]; 180 deg has the nose away from the slope, so that the robot,
            raised, faces it.
    """

    posture: str
    distance_to_foot: float
    heading: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TerrainPlan:
    """The ground.

    Attributes:
        profile: "flat", "ramp" (level, then a slope) or "plateau" (level, slope, level).
        slope: Of the face [rad].
        length: Of the face, along it [m].
        friction_static: mu_s; None takes the robot's own.
    """

    profile: Profile
    slope: float
    length: float
    friction_static: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AbortRule:
    """When to give up: thrust to zero, wheels braked, legs held.

    Attributes:
        pitch_error: Largest deviation from the reference [rad].
        heading_error: Largest deviation from the wanted heading [rad].
        roll: Largest roll [rad].
    """

    pitch_error: float = math.radians(30.0)
    heading_error: float = math.radians(20.0)
    roll: float = math.radians(20.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class _PhaseBase:
    """What every phase has.

    Attributes:
        name: For messages, tables and plots.
        timeout: The mission aborts if the phase has not ended by then [s].
    """

    kind: ClassVar[str]
    name: str
    timeout: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldPhase(_PhaseBase):
    """Wait, legs held, wheels braked.

    Attributes:
        duration: [s].
    """

    kind: ClassVar[str] = "hold"
    duration: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MorphPhase(_PhaseBase):
    """Move the servos to a posture along a smooth path.

    Attributes:
        posture: Where to.
        duration: Of the servos' motion [s].
    """

    kind: ClassVar[str] = "morph"
    posture: str
    duration: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RaisePhase(_PhaseBase):
    """Lift the body with the thrusters, from its skids about the rear axle, until it balances.

    Attributes:
        duration: Of the pitch reference [s].
        thrust: Of the trim that it ends in [N].
    """

    kind: ClassVar[str] = "raise"
    duration: float
    thrust: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SitPhase(_PhaseBase):
    """Lower the body onto its skids, the reverse of raise.

    Attributes:
        duration: Of the pitch reference [s].
    """

    kind: ClassVar[str] = "sit"
    duration: float


@dataclass(frozen=True, slots=True, kw_only=True)
class BalancePhase(_PhaseBase):
    """Stand, drive and turn under a balance controller.

    Attributes:
        controller: "pid" (wheels alone), "default" (MPC), "paper", "lqr".
        goal: Where to drive, along the way of the axle from the foot of the slope [m]; None stays.
        speed: [m/s].
        turn: Change of heading, to the left [rad].
        settle_time: Rest before driving [s].
        hold_time: Rest after driving [s].
        thrust: Total thrust of the trims [N]; None chooses (0 for "pid").
    """

    kind: ClassVar[str] = "balance"
    controller: ControllerName
    goal: float | None
    speed: float
    turn: float
    settle_time: float
    hold_time: float
    thrust: float | None


Phase = HoldPhase | MorphPhase | RaisePhase | SitPhase | BalancePhase


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission:
    """A whole mission.

    Attributes:
        name: Its name.
        title: What it shows, one line.
        source: The file it came from.
        start: Where it begins.
        terrain: The ground.
        abort: When to give up.
        phases: What happens, in order.
    """

    name: str
    title: str
    source: str
    start: Start
    terrain: TerrainPlan
    abort: AbortRule
    phases: tuple[Phase, ...]

    def check_against(self, robot: Robot) -> None:
        """Raise if the mission names what the robot does not have.

        Raises:
            InvalidMissionError: Names phase, key and what would be valid.
        """
        valid = tuple(robot.postures)
        named = [("start", self.start.posture)]
        named += [(f"phase '{phase.name}'", phase.posture) for phase in self.phases if isinstance(phase, MorphPhase)]
        for place, posture in named:
            if posture not in valid:
                raise InvalidMissionError(
                    f"{self.source}: {place}: posture '{posture}' is unknown to robot '{robot.name}'; "
                    f"valid: {', '.join(valid)}"
                )
        if robot.balance is None and any(isinstance(p, RaisePhase | SitPhase | BalancePhase) for p in self.phases):
            raise InvalidMissionError(f"{self.source}: robot '{robot.name}' does not balance (no [balance] table)")
