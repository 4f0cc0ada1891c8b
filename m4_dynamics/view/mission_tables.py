"""A mission's phases as a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from m4_dynamics.view.tables import make_table

if TYPE_CHECKING:
    from rich.table import Table

    from m4_dynamics.mission.schema import Mission
    from m4_dynamics.mission.summary import MissionSummary

__all__ = ["mission_columns", "mission_rows", "mission_table", "mission_title", "missions_table"]


def mission_table(summary: MissionSummary) -> Table:
    """Phases with their times, margins and errors.

    Args:
        summary: The mission's figures.

    Returns:
        The table.
    """
    return make_table(mission_title(summary), mission_columns(), mission_rows(summary))


def mission_title(summary: MissionSummary) -> str:
    """Which mission, where, how fast it was simulated."""
    return (
        f"Mission {summary.mission}: slope {summary.slope_deg:g} deg, mu_s {summary.friction_static:g}, "
        f"real-time factor {summary.real_time_factor:.0f}"
    )


def mission_columns() -> tuple[str, ...]:
    """Headings of a mission's figures."""
    return (
        "phase",
        "kind",
        "time s",
        "ended",
        "thrust N",
        "margin N",
        "slip ms",
        "at corners ms",
        "friction use",
        "wheel cm",
        "pitch deg",
        "force model %",
    )


def mission_rows(summary: MissionSummary) -> list[tuple[object, ...]]:
    """Figures of each phase, in the order of `mission_columns`."""
    return [
        (
            figures.name,
            figures.kind,
            f"{figures.start_s:.1f}-{figures.end_s:.1f}",
            figures.ended,
            figures.thrust_peak_N,
            figures.thrust_margin_N,
            _scaled(figures.slip_time_s, 1e3),
            _scaled(figures.corner_slip_time_s, 1e3),
            figures.friction_use_along_slope,
            _scaled(figures.wheel_rms_m, 1e2),
            figures.pitch_rms_deg,
            _scaled(figures.ground_force_rms_over_weight, 1e2),
        )
        for figures in summary.phases
    ]


def missions_table(missions: Sequence[Mission]) -> Table:
    """The missions that come with the package."""
    rows = [(mission.name, len(mission.phases), mission.title) for mission in missions]
    return make_table("Missions", ("name", "phases", "what it shows"), rows)


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value
