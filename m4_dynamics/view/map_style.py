"""Colours and words that all pictures of maps share."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from m4_dynamics.feasibility.limits import Limit

__all__ = ["LIMIT_COLOURS", "OUTCOME_COLOURS", "VERDICT_COLOURS", "outline_cells"]

#: Tints that leave lines and labels on top of them legible.
LIMIT_COLOURS: dict[Limit, str] = {
    Limit.EQUILIBRIUM: "#C3CAD1",
    Limit.FRICTION: "#F2B08A",
    Limit.NORMAL_FORCE: "#A9D6F2",
    Limit.THRUST: "#8B97A1",
    Limit.TORQUE: "#CBA4C8",
    Limit.MOTOR_SPEED: "#F3D27A",
    Limit.CLEARANCE: "#8FCDB6",
    Limit.PITCH_WINDOW: "#8FB6D9",
    Limit.COLLISION: "#4A545E",
}

VERDICT_COLOURS: dict[str, str] = {
    "climbed": "#FFFFFF",
    "lagged": "#F3D27A",
    "slipped": "#F2B08A",
    "fell": "#B5533C",
    "infeasible": "#C3CAD1",
    "aborted": "#4A545E",
}

OUTCOME_COLOURS: dict[str, str] = {
    "returned": "#FFFFFF",
    "slid": "#F2B08A",
    "astray": "#F3D27A",
    "fell": "#B5533C",
    "aborted": "#4A545E",
}


def outline_cells(
    axes: Axes,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    inside: NDArray[np.bool_],
    *,
    color: str,
    linewidth: float,
    linestyle: str = "-",
) -> None:
    """Draw the line between cells that are inside a region and cells that are not, along their edges.

    Args:
        axes: Where to draw.
        x: Centres of the columns, shape (m,).
        y: Centres of the rows, shape (n,).
        inside: Shape (n, m).
        color: Of the line.
        linewidth: Of the line [pt].
        linestyle: Of the line.
    """
    if min(inside.shape) < 2 or inside.all() or not inside.any():
        return
    # A cell's edge is where it changes, not the line between two centres.
    edges = [np.repeat(_edges(values), 2)[1:-1] for values in (x, y)]
    stepped = np.repeat(np.repeat(inside, 2, axis=0), 2, axis=1).astype(float)
    axes.contour(*edges, stepped, levels=[0.5], colors=[color], linewidths=linewidth, linestyles=linestyle)


def _edges(centres: NDArray[np.float64]) -> NDArray[np.float64]:
    middle = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[1.5 * centres[0] - 0.5 * centres[1]], middle, [1.5 * centres[-1] - 0.5 * centres[-2]]])
