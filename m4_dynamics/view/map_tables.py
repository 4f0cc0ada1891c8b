"""Maps as tables on the terminal and as plain values."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray
from rich.table import Table

from m4_dynamics.feasibility.limits import LIMIT_LABELS, Limit
from m4_dynamics.feasibility.static import best_branch
from m4_dynamics.view.tables import make_table

__all__ = ["describe_curves", "static_tables"]


def describe_curves(curves: xarray.Dataset) -> dict[str, Any]:
    """The curves as values that JSON can hold, angles in degrees.

    Args:
        curves: From `map_curves`.

    Returns:
        By posture angle and speed: the steepest slope for each friction, and the least friction for each slope.
    """
    rows = []
    for p, angle in enumerate(curves["posture_angle"].to_numpy()):
        for s, speed in enumerate(curves["speed"].to_numpy()):
            one = curves.isel(posture_angle=p, speed=s)
            by_friction = [
                {
                    "friction": float(friction),
                    "steepest_slope_deg": _number(math.degrees(float(one["steepest_slope_best_thrust"][m]))),
                    "thrust_N": _number(float(one["best_thrust"][m])),
                }
                for m, friction in enumerate(one["friction"].to_numpy())
            ]
            by_slope = [
                {
                    "slope_deg": math.degrees(float(slope)),
                    "least_friction": _number(float(one["least_friction"][k])),
                    "thrust_N": _number(float(one["thrust_of_least_friction"][k])),
                    "power_W": _number(float(one["power_of_least_friction"][k])),
                }
                for k, slope in enumerate(one["slope"].to_numpy())
            ]
            rows.append(
                {
                    "posture_angle_deg": _number(math.degrees(float(angle))),
                    "speed_m_s": float(speed),
                    "by_friction": by_friction,
                    "by_slope": by_slope,
                }
            )
    return {"robot": curves.attrs.get("robot", ""), "curves": rows}


def static_tables(dataset: xarray.Dataset, curves: xarray.Dataset) -> list[Table]:
    """What a static map says, in two tables: the steepest slope for each friction, and what stops the robot.

    Args:
        dataset: The map; its first posture is shown.
        curves: Its curves.

    Returns:
        The tables.
    """
    best = best_branch(dataset.isel(posture_angle=[0])).isel(posture_angle=0)
    rows = []
    for s, speed in enumerate(dataset["speed"].to_numpy()):
        for m, friction in enumerate(dataset["friction"].to_numpy()):
            one = curves.isel(posture_angle=0, speed=s, friction=m)
            share = float(best["feasible"].isel(speed=s, friction=m).mean())
            steepest = _number(math.degrees(float(one["steepest_slope_best_thrust"])))
            rows.append((float(friction), float(speed), steepest, _number(float(one["best_thrust"])), 100.0 * share))
    columns = ("friction", "speed [m/s]", "steepest slope [deg]", "with thrust [N]", "cells feasible [%]")
    steepest_table = make_table(f"Steepest slopes of {dataset.attrs.get('robot', 'the robot')}", columns, rows)
    stopped = ~best["feasible"].to_numpy()
    codes = best["active_limit"].transpose(*best["feasible"].dims).to_numpy()[stopped]
    counted = [
        (LIMIT_LABELS[limit], 100.0 * float(np.mean(codes == limit))) for limit in Limit if (codes == limit).any()
    ]
    counted.sort(key=lambda row: -row[1])
    return [steepest_table, make_table("What stops it elsewhere", ("limit missed most", "of those cells [%]"), counted)]


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
