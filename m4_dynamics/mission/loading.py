"""Mission files: TOML in, a checked `Mission` out, before anything runs.

name = "wair45"
[start]    posture, distance_to_foot_m, heading_deg
[terrain]  profile, slope_deg, length_m, friction
[abort]    pitch_error_deg, heading_error_deg, roll_deg
[[phase]]  name, kind, and the keys of that kind (see `schema`)
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import get_args

from m4_dynamics.mission.schema import (
    AbortRule,
    BalancePhase,
    HoldPhase,
    InvalidMissionError,
    Mission,
    MorphPhase,
    Phase,
    Profile,
    RaisePhase,
    SitPhase,
    Start,
    TerrainPlan,
)
from m4_dynamics.robot.toml_table import TomlTable
from m4_dynamics.simulation.controllers import CONTROLLERS

__all__ = ["load_mission", "parse_mission", "shipped_missions"]


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
