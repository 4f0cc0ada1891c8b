"""Reports of single cells, in folders beside the map that they belong to."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray

__all__ = ["CellReport", "cell_folder", "reports_beside"]

_REPORT = "report.html"


class CellReport(NamedTuple):
    """The report of one cell.

    Attributes:
        slope: [rad].
        thrust: [N].
        friction: mu_s.
        start: Number of the start.
        verdict: What came of it, as the summary beside the report says; empty without one.
        link: Where it is, from the map's folder.
    """

    slope: float
    thrust: float
    friction: float
    start: int
    verdict: str
    link: str


def cell_folder(slope: float, thrust: float, friction: float, start: int) -> str:
    """Name of the folder of a cell's run.

    Args:
        slope: [rad].
        thrust: [N].
        friction: mu_s.
        start: Number of the start.

    Returns:
        The name, inside the map's folder.
    """
    return f"cell-{np.degrees(slope):g}-{thrust:g}-{friction:g}-{start}"


def reports_beside(dataset: xarray.Dataset, folder: Path) -> tuple[CellReport, ...]:
    """Reports that there are of a map's cells.

    Args:
        dataset: A closed-loop map.
        folder: Its folder.

    Returns:
        The reports in the order of the cells.
    """
    there = {path.parent.name for path in folder.glob(f"cell-*/{_REPORT}")}
    if not there:
        return ()
    order = ("slope", "thrust", "friction")
    slopes, thrusts, frictions = (np.asarray(dataset[name].to_numpy(), dtype=float) for name in order)
    reports = []
    for i, j, k, start in itertools.product(*(range(dataset.sizes[name]) for name in (*order, "start"))):
        slope, thrust, friction = float(slopes[i]), float(thrusts[j]), float(frictions[k])
        name = cell_folder(slope, thrust, friction, start)
        if name in there:
            verdict = _verdict(folder / name / "summary.json")
            reports.append(CellReport(slope, thrust, friction, start, verdict, f"{name}/{_REPORT}"))
    return tuple(reports)


def _verdict(summary: Path) -> str:
    """The verdict in a summary; empty if there is no such file, or it is none."""
    try:
        content = json.loads(summary.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return ""
    return str(content.get("verdict", "")) if isinstance(content, dict) else ""
