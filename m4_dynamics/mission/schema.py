"""A mission as data: a TOML file with a start, a terrain, abort rules and phases, checked before anything runs.

    name = "wair45"
    [start]    posture, distance_to_foot_m, heading_deg
    [terrain]  profile, slope_deg, length_m, friction
    [abort]    pitch_error_deg, heading_error_deg, roll_deg
    [[phase]]  name, kind, and the keys of that kind

Kinds of phases: `hold` (wait), `morph` (servos to a posture), `raise` (thrusters lift the body from its skids about the
rear axle until it balances), `balance` (stand, drive, turn under a balance controller), `sit` (the reverse of raise).
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import ClassVar, Literal, get_args

from m4_dynamics.errors import M4Error
from m4_dynamics.robot.robot import Robot
from m4_dynamics.robot.toml_table import TomlTable
from m4_dynamics.simulation.climb import CONTROLLERS, ControllerName

__all__ = [
    "AbortRule",
    "BalancePhase",
    "HoldPhase",
    "InvalidMissionError",
    "Mission",
    "MorphPhase",
    "Phase",
    "RaisePhase",
    "SitPhase",
    "Start",
    "TerrainPlan",
    "load_mission",
    "shipped_missions",
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


class _MissionTable(TomlTable):
    """A table of a mission file."""

    error_type = InvalidMissionError


def shipped_missions() -> tuple[str, ...]:
    """Names of the missions that come with the package."""
    folder = resources.files("m4_dynamics.mission") / "library"
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def load_mission(name_or_file: str | Path) -> Mission:
    """Read and check a mission.

    Args:
        name_or_file: A shipped mission's name, or the path of a TOML file.

    Returns:
        The mission.

    Raises:
        InvalidMissionError: There is no such file, or a key is missing, unknown or out of range.
    """
    if str(name_or_file) in shipped_missions():
        text = (resources.files("m4_dynamics.mission") / "library" / f"{name_or_file}.toml").read_text("utf-8")
        return parse_mission(text, Path(f"{name_or_file}.toml"))
    path = Path(name_or_file)
    if not path.is_file():
        raise InvalidMissionError(
            f"no mission '{name_or_file}': neither a file nor one of the shipped {', '.join(shipped_missions())}"
        )
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidMissionError(f"{path} cannot be read: {error}") from error
    return parse_mission(text, path)


def parse_mission(text: str, source: Path) -> Mission:
    """Parse a mission's TOML text; see `load_mission`."""
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InvalidMissionError(f"{source}: not valid TOML: {error}") from error
    top = _MissionTable(source, "", values)
    start = _MissionTable(source, "start", top.take("start") or {})
    terrain = _MissionTable(source, "terrain", top.take("terrain") or {})
    abort = _MissionTable(source, "abort", top.take("abort") or {})
    phases = top.take("phase")
    if not isinstance(phases, list) or not phases:
        raise InvalidMissionError(f"{source}: there is no [[phase]]; a mission needs at least one")
    mission = Mission(
        name=top.text("name", default=source.stem),
        title=top.text("title", default=""),
        source=str(source),
        start=Start(
            posture=start.text("posture", default="ugv"),
            distance_to_foot=start.number("distance_to_foot_m", default=1.5, least=-100.0, most=100.0),
            heading=math.radians(start.number("heading_deg", default=180.0, least=-360.0, most=360.0)),
        ),
        terrain=_parse_terrain(terrain),
        abort=AbortRule(
            pitch_error=math.radians(abort.number("pitch_error_deg", default=30.0, above=0.0, most=180.0)),
            heading_error=math.radians(abort.number("heading_error_deg", default=20.0, above=0.0, most=180.0)),
            roll=math.radians(abort.number("roll_deg", default=20.0, above=0.0, most=90.0)),
        ),
        phases=tuple(_parse_phase(source, index, entry) for index, entry in enumerate(phases)),
    )
    for table in (top, start, terrain, abort):
        table.finish()
    names = [phase.name for phase in mission.phases]
    for name in names:
        if names.count(name) > 1:
            raise InvalidMissionError(f"{source}: two phases are called '{name}'")
    return mission


def _parse_terrain(table: _MissionTable) -> TerrainPlan:
    profile = table.text("profile", default="flat")
    if profile not in get_args(Profile):
        raise table.error("profile", f"must be one of {', '.join(get_args(Profile))}, got '{profile}'")
    flat = profile == "flat"
    friction = table.take("friction")
    return TerrainPlan(
        profile=profile,  # type: ignore[arg-type]
        slope=math.radians(table.number("slope_deg", default=0.0 if flat else None, least=0.0, most=85.0)),
        length=table.number("length_m", default=4.0, above=0.3, most=1000.0),
        friction_static=None if friction is None else table.number("friction", above=0.0, most=10.0),
    )


def _parse_phase(source: Path, index: int, values: object) -> Phase:
    anonymous = _MissionTable(source, f"phase {index + 1}", values)
    name = anonymous.text("name")
    table = _MissionTable(source, f"phase '{name}'", values)
    table.take("name")
    kind = table.text("kind")
    parsers: dict[str, Callable[[str, _MissionTable], Phase]] = {
        "hold": _parse_hold, "morph": _parse_morph, "raise": _parse_raise, "sit": _parse_sit, "balance": _parse_balance
    }  # fmt: skip
    if kind not in parsers:
        raise table.error("kind", f"must be one of {', '.join(parsers)}, got '{kind}'")
    phase = parsers[kind](name, table)
    table.finish()
    return phase


def _timeout(table: _MissionTable, least: float) -> float:
    """A phase's time-out; by default twice what it is planned to take, and 3 s."""
    return table.number("timeout_s", default=2.0 * least + 3.0, above=least)


def _parse_hold(name: str, table: _MissionTable) -> HoldPhase:
    duration = table.number("duration_s", above=0.0, most=600.0)
    return HoldPhase(name=name, timeout=_timeout(table, duration), duration=duration)


def _parse_morph(name: str, table: _MissionTable) -> MorphPhase:
    duration = table.number("duration_s", default=4.0, above=0.2, most=600.0)
    return MorphPhase(name=name, timeout=_timeout(table, duration), posture=table.text("posture"), duration=duration)


def _parse_raise(name: str, table: _MissionTable) -> RaisePhase:
    duration = table.number("duration_s", default=4.0, above=0.5, most=600.0)
    thrust = table.number("thrust_N", default=3.0, above=0.0, most=1000.0)
    return RaisePhase(name=name, timeout=_timeout(table, duration), duration=duration, thrust=thrust)


def _parse_sit(name: str, table: _MissionTable) -> SitPhase:
    duration = table.number("duration_s", default=4.0, above=0.5, most=600.0)
    return SitPhase(name=name, timeout=_timeout(table, duration), duration=duration)


def _parse_balance(name: str, table: _MissionTable) -> BalancePhase:
    controller = table.text("controller", default="default")
    if controller not in CONTROLLERS:
        raise table.error("controller", f"must be one of {', '.join(CONTROLLERS)}, got '{controller}'")
    goal = table.take("to_m")
    thrust = table.take("thrust_N")
    return BalancePhase(
        name=name,
        timeout=table.number("timeout_s", default=120.0, above=0.0),
        controller=controller,  # type: ignore[arg-type]
        goal=None if goal is None else table.number("to_m", least=-1000.0, most=1000.0),
        speed=table.number("speed_m_s", default=0.3, above=0.0, most=2.0),
        turn=math.radians(table.number("turn_deg", default=0.0, least=-360.0, most=360.0)),
        settle_time=table.number("settle_s", default=1.0, least=0.0, most=600.0),
        hold_time=table.number("hold_s", default=1.0, least=0.0, most=600.0),
        thrust=None if thrust is None else table.number("thrust_N", least=0.0, most=1000.0),
    )
