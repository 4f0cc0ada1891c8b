"""Equilibria on a slope as plain values and as a table; degrees here, radians everywhere below."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from rich.table import Table

from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.power import PowerModel, power_needed
from m4_dynamics.reduced.trim import Trim
from m4_dynamics.reduced.trim_overview import TrimOverview
from m4_dynamics.view.tables import make_table

__all__ = ["describe_trim", "describe_trims", "trim_table"]


def describe_trim(parameters: MipParameters, trim: Trim, power_model: PowerModel) -> dict[str, Any]:
    """An equilibrium as values that JSON can hold; infinite becomes None.

    Args:
        parameters: The pendulum.
        trim: The equilibrium.
        power_model: Rotor figures for its power.

    Returns:
        Values by name, units in the names.
    """
    margins = trim.margins
    return {
        "branch": trim.branch,
        "thrust_N": trim.thrust,
        "pitch_deg": math.degrees(trim.pitch),
        "torque_Nm": trim.torque,
        "duty": trim.duty,
        "friction_needed": _finite(trim.friction_needed),
        "friction_force_N": trim.friction_force,
        "normal_force_N": trim.normal_force,
        "power_W": float(power_needed(parameters, power_model, trim.thrust, trim.torque, trim.wheel_rate)),
        "within_limits": trim.within_limits,
        "margins": {
            "friction": _finite(margins.friction),
            "normal_force_N": _finite(margins.normal_force),
            "thrust_N": _finite(margins.thrust),
            "duty": _finite(margins.duty),
            "clearance_m": _finite(margins.clearance),
            "pitch_window_deg": _finite(math.degrees(float(margins.pitch_window))),
        },
    }


def describe_trims(
    robot_name: str,
    parameters: MipParameters,
    overview: TrimOverview,
    power_model: PowerModel,
    **asked: float | tuple[float, float],
) -> dict[str, Any]:
    """An overview as values that JSON can hold.

    Args:
        robot_name: The robot's name.
        parameters: The pendulum.
        overview: The equilibria.
        power_model: Rotor figures for their power.
        **asked: What was asked for (slope_deg, friction_static, ...), for the record.

    Returns:
        `branches` holds the equilibria, each with the criteria that chose it under `selected_by`.
    """
    branches = []
    for member in overview.members:
        chosen = [criterion for criterion, trim in overview.selected.items() if trim == member]
        branches.append({**describe_trim(parameters, member, power_model), "selected_by": chosen})
    refusal = overview.refusal
    return {
        "robot": robot_name,
        **asked,
        "branches": branches,
        "no_trim": None if refusal is None else {"limit": refusal.limit, "reason": str(refusal)},
    }


def trim_table(description: Mapping[str, Any]) -> Table:
    """Table of the equilibria in a description from `describe_trims`."""
    title = f"Equilibria of {description['robot']} on a slope of {description['slope_deg']:g} deg"
    title += f", friction {description['friction_static']:g}"
    if description.get("speed_m_s"):
        title += f", climbing at {description['speed_m_s']:g} m/s"
    if description.get("acceleration_m_s2"):
        title += f", speeding up by {description['acceleration_m_s2']:g} m/s2"
    columns = [
        "thrust [N]",
        "pitch [deg]",
        "torque [N m]",
        "duty",
        "friction needed",
        "normal [N]",
        "clearance margin [mm]",
        "power [W]",
        "branch",
        "limits missed",
        "chosen as",
    ]
    rows = []
    for row in description["branches"]:
        clearance = row["margins"]["clearance_m"]
        rows.append(
            [
                row["thrust_N"],
                row["pitch_deg"],
                row["torque_Nm"],
                row["duty"],
                math.inf if row["friction_needed"] is None else row["friction_needed"],
                row["normal_force_N"],
                "-" if clearance is None else 1e3 * clearance,
                row["power_W"],
                row["branch"],
                ", ".join(_missed(row)),
                ", ".join(row["selected_by"]),
            ]
        )
    return make_table(title, columns, rows)


def _missed(row: Mapping[str, Any]) -> list[str]:
    """Names of the limits that an equilibrium misses; only the friction's margin can be infinitely negative."""
    names = {
        "friction": "friction",
        "normal_force_N": "normal force",
        "thrust_N": "thrust",
        "duty": "duty",
        "clearance_m": "clearance",
        "pitch_window_deg": "pitch window",
    }
    margins = row["margins"]
    missed = [name for key, name in names.items() if margins[key] is not None and margins[key] < -1e-9]
    return ["friction", *missed] if margins["friction"] is None else missed


def _finite(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None
