"""The figures of a climb as a table, each with the limit it is held against."""

from __future__ import annotations

from typing import TYPE_CHECKING

from m4_dynamics.view.tables import make_table

if TYPE_CHECKING:
    from rich.table import Table

    from m4_dynamics.simulation.verdict import ClimbSummary

__all__ = ["climb_rows", "climb_table", "climb_title"]


def climb_table(summary: ClimbSummary) -> Table:
    """A table of a climb's figures.

    Args:
        summary: The figures.

    Returns:
        The table; figures that do not exist are dashes.
    """
    return make_table(climb_title(summary), ("figure", "value", "unit", "limit"), climb_rows(summary))


def climb_title(summary: ClimbSummary) -> str:
    """What was climbed, on what, with which controller."""
    plant = ", realistic plant" if summary.fidelity else ""
    return (
        f"Climb of {summary.slope_deg:g} deg, mu_s {summary.friction_static:g}, controller {summary.controller}{plant}"
    )


def climb_rows(summary: ClimbSummary) -> list[tuple[str, object, str, str]]:
    """A climb's figures as (name, value, unit, limit); an empty limit is none."""
    s = summary
    times = s.mpc_step_us
    return [
        ("verdict", s.verdict, "", ""),
        ("trim pitch", s.trim_pitch_deg, "deg", ""),
        ("trim thrust", s.trim_thrust_N, "N", ""),
        ("friction that the trim needs", s.trim_friction_needed, "", f"mu_s {s.friction_static:g}"),
        ("worst friction use along the slope", s.max_friction_use_along_slope, "of mu_s", "< 1"),
        ("worst friction use, sideways included", s.max_friction_use, "of mu_s", "<= 1"),
        ("least normal force of a wheel", s.min_normal_force_N, "N", "> 0"),
        ("fastest slip", _scaled(s.max_slip_speed_m_s, 1e3), "mm/s", "<= 5"),
        ("slid distance, worst wheel", _scaled(s.slip_distance_m, 1e3), "mm", "<= 5"),
        ("wheel position RMS", _scaled(s.wheel_rms_m, 1e2), "cm", "<= 2"),
        ("pitch RMS", s.pitch_rms_deg, "deg", "<= 1"),
        ("largest heading error", s.yaw_max_deg, "deg", "<= 1"),
        ("climbed", s.climbed_m, "m", f"goal {s.goal_m:.2f}" if s.goal_m is not None else ""),
        ("speed at the end", _scaled(s.end_speed_m_s, 1e3), "mm/s", "< 1"),
        (
            "ground force, model against simulation, RMS",
            _scaled(s.ground_force_rms_over_weight, 1e2),
            "% of weight",
            "<= 3",
        ),
        ("steady tracking cost", s.steady_cost, "", ""),
        *_imperfections(s),
        ("fallbacks", s.fallbacks, "steps", "0"),
        ("contact solver failures", s.newton_failures, "steps", "0"),
        ("control step, median / 99 %", f"{times.median:.0f} / {times.p99:.0f}" if times else None, "us", ""),
        ("real-time factor", s.real_time_factor, "", ">= 25"),
    ]


def _imperfections(summary: ClimbSummary) -> list[tuple[str, object, str, str]]:
    """What the estimator and the battery came to, on a plant that is not ideal."""
    rows: list[tuple[str, object, str, str]] = []
    if summary.fidelity:
        rows.append(("pitch estimate, error RMS", summary.pitch_estimate_rms_deg, "deg", ""))
        rows.append(("heading estimate, largest error", summary.heading_estimate_max_deg, "deg", ""))
    if summary.battery_min_V is not None:
        rows.append(("lowest battery voltage", summary.battery_min_V, "V", ""))
        rows.append(("charge left", _scaled(summary.battery_charge_end, 1e2), "%", ""))
    return rows


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value
