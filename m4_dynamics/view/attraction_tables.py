"""Regions of attraction as tables on the terminal and as plain values."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray
from rich.table import Table

from m4_dynamics.feasibility.attraction import reach
from m4_dynamics.feasibility.attraction_rollout import OUTCOMES
from m4_dynamics.view.tables import make_table

__all__ = ["attraction_tables", "describe_attraction", "describe_equilibrium"]


def describe_attraction(dataset: xarray.Dataset) -> dict[str, Any]:
    """What a region of attraction says, as values that JSON can hold, angles in degrees.

    Args:
        dataset: The map.

    Returns:
        The equilibrium, outcomes by name, for each wheel speed how far the region reaches, and how often full and
        reduced model agree.
    """
    outcomes, attributes = dataset["outcome"].to_numpy(), dataset.attrs
    regions = []
    for k, speed in enumerate(dataset["wheel_speed"].to_numpy()):
        found = reach(dataset, k)
        regions.append(
            {
                "wheel_speed_m_s": float(speed),
                "pitch_error_deg": [_degrees(value) for value in found.pitch],
                "pitch_rate_deg_s": [_degrees(value) for value in found.rate],
                "share": found.share,
                "ends_inside_the_axes": found.bounded,
            }
        )
    said: dict[str, Any] = {
        "robot": attributes.get("robot", ""),
        "plant": attributes["plant"],
        "slope_deg": math.degrees(attributes["slope"]),
        "friction": float(attributes["friction"]),
        "trim_pitch_deg": math.degrees(attributes["trim_pitch"]),
        "trim_thrust_N": float(attributes["trim_thrust"]),
        "rollouts": int((outcomes >= 0).sum()),
        "outcomes": {str(outcome): int((outcomes == code).sum()) for code, outcome in enumerate(OUTCOMES)},
        "regions": regions,
        "computing_time_s": float(np.nansum(dataset["elapsed"].to_numpy())),
    }
    if attributes["plant"] == "full":
        run = (dataset["outcome"] >= 0).all("start").to_numpy()
        full, reduced = dataset["returns"].to_numpy()[run], dataset["returns_reduced"].to_numpy()[run]
        said["reduced_model"] = {
            "agrees": float((full == reduced).mean()),
            "returns_only_there": int((reduced & ~full).sum()),
            "returns_only_on_the_full_model": int((full & ~reduced).sum()),
        }
    return said


def attraction_tables(dataset: xarray.Dataset) -> list[Table]:
    """What a region of attraction says, in tables.

    Args:
        dataset: The map.

    Returns:
        Outcomes, reach at each wheel speed, and the reduced model beside the full one.
    """
    said = describe_attraction(dataset)
    total = max(said["rollouts"], 1)
    outcomes = [(name, count, 100.0 * count / total) for name, count in said["outcomes"].items() if count]
    columns = ("wheel speed [m/s]", "pitch [deg]", "pitch rate [deg/s]", "cells [%]", "ends inside the axes")
    regions = [
        (
            row["wheel_speed_m_s"],
            _span(row["pitch_error_deg"]),
            _span(row["pitch_rate_deg_s"]),
            100.0 * row["share"],
            row["ends_inside_the_axes"],
        )
        for row in said["regions"]
    ]
    tables = [
        make_table(f"Starts of {said['robot']}", ("outcome", "rollouts", "share [%]"), outcomes),
        make_table("It comes back from, without a gap, the other error nil", columns, regions),
    ]
    if "reduced_model" in said:
        beside = said["reduced_model"]
        rows = [
            ("agree [% of cells]", 100.0 * beside["agrees"]),
            ("reduced model alone comes back [cells]", beside["returns_only_there"]),
            ("full model alone comes back [cells]", beside["returns_only_on_the_full_model"]),
        ]
        tables.append(make_table("Full and reduced model", ("", "value"), rows))
    return tables


def describe_equilibrium(dataset: xarray.Dataset) -> str:
    """The equilibrium of a region of attraction in one line.

    Args:
        dataset: The map.

    Returns:
        Slope, friction, pitch, thrust.
    """
    said = describe_attraction(dataset)
    return (
        f"equilibrium on {said['slope_deg']:.4g} deg, friction {said['friction']:g}: "
        f"pitch {said['trim_pitch_deg']:.1f} deg, thrust {said['trim_thrust_N']:.1f} N"
    )


def _degrees(value: float) -> float | None:
    return round(math.degrees(value), 9) if math.isfinite(value) else None


def _span(ends: list[float | None]) -> str:
    low, high = ends
    return "-" if low is None or high is None else f"{low:+.4g} to {high:+.4g}"
