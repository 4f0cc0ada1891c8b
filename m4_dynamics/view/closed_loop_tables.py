"""Closed-loop maps as tables on the terminal and as plain values."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray
from rich.table import Table

from m4_dynamics.feasibility.cell import VERDICTS
from m4_dynamics.feasibility.disagreement import EFFECT_LABELS, Agreement, agreement
from m4_dynamics.view.tables import make_table

__all__ = ["closed_loop_tables", "describe_closed_loop"]


def describe_closed_loop(dataset: xarray.Dataset) -> dict[str, Any]:
    """What a closed-loop map says, as values that JSON can hold.

    Args:
        dataset: The map.

    Returns:
        Verdicts by name, the steepest slope climbed for each friction, and the agreement with statics and reduced
        model.
    """
    verdicts = dataset["verdict"].to_numpy()
    shares = agreement(dataset)
    climbs = dataset["climbs"].to_numpy()
    slopes = np.degrees(dataset["slope"].to_numpy())
    steepest = [
        {
            "friction": float(friction),
            "steepest_slope_deg": float(slopes[climbs[m].any(axis=1)].max()) if climbs[m].any() else None,
        }
        for m, friction in enumerate(dataset["friction"].to_numpy())
    ]
    return {
        "robot": dataset.attrs.get("robot", ""),
        "plant": dataset.attrs.get("plant", ""),
        "rollouts": int((verdicts >= 0).sum()),
        "verdicts": {str(verdict): int((verdicts == code).sum()) for code, verdict in enumerate(VERDICTS)},
        "steepest": steepest,
        "agreement": {
            "static_all_cells": shares.agreeing,
            "static_away_from_boundary": _finite(shares.agreeing_inner),
            "static_away_from_boundary_simulated": _finite(shares.agreeing_simulated),
            "reduced_model": _finite(shares.reduced),
            "effects": {EFFECT_LABELS[effect]: count for effect, count in shares.effects.items()},
        },
        "computing_time_s": float(np.nansum(dataset["elapsed"].to_numpy())),
    }


def closed_loop_tables(dataset: xarray.Dataset) -> list[Table]:
    """What a closed-loop map says, in tables.

    Args:
        dataset: The map.

    Returns:
        Verdicts, steepest slopes, and agreement with its effects.
    """
    said = describe_closed_loop(dataset)
    total = max(said["rollouts"], 1)
    verdicts = [(name, count, 100.0 * count / total) for name, count in said["verdicts"].items() if count]
    shares = said["agreement"]
    compared = agreement(dataset)
    rows: list[tuple[str, int, float | None]] = [
        ("statics and rollouts, all cells", compared.cells, 100.0 * shares["static_all_cells"]),
        ("away from the statics' boundary", compared.inner, _percent(shares["static_away_from_boundary"])),
        ("of those, simulated", compared.simulated, _percent(shares["static_away_from_boundary_simulated"])),
        ("reduced and simulated model, all cells", compared.cells, _percent(shares["reduced_model"])),
    ]
    tables = [
        make_table(f"Rollouts of {said['robot']}", ("verdict", "rollouts", "share [%]"), verdicts),
        make_table(
            "Steepest slopes climbed",
            ("friction", "slope [deg]"),
            [(row["friction"], row["steepest_slope_deg"]) for row in said["steepest"]],
        ),
        make_table("Agreement on where the robot climbs", ("between", "cells", "agree [%]"), rows),
    ]
    if shares["effects"]:
        columns = ("effect", "cells", "of these away from the boundary", "slopes [deg]", "thrusts [N]")
        tables.append(make_table("What sets statics and rollouts apart", columns, _places(dataset, compared)))
    return tables


def _places(dataset: xarray.Dataset, compared: Agreement) -> list[tuple[object, ...]]:
    """A row for each effect: how many cells, and between which slopes and thrusts."""
    codes = dataset["disagreement"].to_numpy()
    slope, thrust = np.degrees(dataset["slope"].to_numpy()), dataset["thrust"].to_numpy()
    rows: list[tuple[object, ...]] = []
    for effect, count in compared.effects.items():
        _, i, j = np.nonzero(codes == effect)
        inner = compared.effects_inner.get(effect, 0)
        rows.append((EFFECT_LABELS[effect], count, inner, _span(slope[i]), _span(thrust[j])))
    return rows


def _span(values: np.ndarray) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share
