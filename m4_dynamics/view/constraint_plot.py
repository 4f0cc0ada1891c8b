"""The constraints of the predictive controller, from the reduced model's forces and from the simulated ones, and its
cost (paper, Fig. plot_mpc).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from m4_dynamics.errors import ResultFileError
from m4_dynamics.view.phase_bands import draw_corners
from m4_dynamics.view.phases import corner_times, predictive_samples
from m4_dynamics.view.run_figure import ACTUAL, REFERENCE, TIME_LABEL, require_variables, run_figure, values_of
from m4_dynamics.view.style import COLOURS, draw_limit, dress_axes, label_lines, peak_limits, save_figure

__all__ = ["ConstraintFigures", "constraint_figures", "draw_constraints", "plot_constraints"]

Array = NDArray[np.float64]

_NEAR_CORNER = 0.1  # [s] on either side, in which no rigid planar model has the right forces
_LEAST_COST = 1e-6  # costs below it are nothing but the last digits of a perfect hold


@dataclass(frozen=True, slots=True)
class ConstraintFigures:
    """How well the model's ground forces agree with the simulated ones, and where the cost goes.

    Attributes:
        friction_rms: Of the difference in friction force [N].
        normal_rms: Of the difference in normal force [N].
        worst_friction: Largest f_x^2 - (mu_s f_n)^2 of the simulated forces [N^2]; below zero nothing slips.
        worst_normal: Largest -f_n of the simulated forces [N]; below zero nothing lifts off.
        cost_first: Median cost in the first quarter of the time.
        cost_last: Median cost in the last quarter.
    """

    friction_rms: float
    normal_rms: float
    worst_friction: float
    worst_normal: float
    cost_first: float
    cost_last: float


def plot_constraints(dataset: xarray.Dataset, path: Path | str) -> Path:
    """Write the picture of constraints and cost; see `draw_constraints`."""
    return save_figure(draw_constraints(dataset), path)


def constraint_figures(dataset: xarray.Dataset) -> ConstraintFigures:
    """Sum the picture up, a tenth of a second around each corner of the ground aside.

    Args:
        dataset: A trajectory.

    Returns:
        The figures.

    Raises:
        ResultFileError: A variable is missing, or no predictive controller ran.
    """
    shown = _predictive(dataset)
    for corner in corner_times(dataset):
        shown &= np.abs(values_of(dataset, "time") - corner) > _NEAR_CORNER
    model, simulated = (
        values_of(dataset, "ground_force_model")[shown],
        values_of(dataset, "ground_force_simulated")[shown],
    )
    friction_rms, normal_rms = np.sqrt(np.mean((model - simulated) ** 2, axis=0))
    normal, cone = _constraints(simulated, float(dataset.attrs["friction_static"]))
    cost = values_of(dataset, "cost")[shown]
    quarter = max(1, len(cost) // 4)
    return ConstraintFigures(
        friction_rms=float(friction_rms),
        normal_rms=float(normal_rms),
        worst_friction=float(cone.max()),
        worst_normal=float(normal.max()),
        cost_first=float(np.median(cost[:quarter])),
        cost_last=float(np.median(cost[-quarter:])),
    )


def draw_constraints(dataset: xarray.Dataset) -> Figure:
    """Draw h(x, u) < 0 in the paper's form, model against simulation, and the cost, while a predictive controller runs.

    Args:
        dataset: A trajectory.

    Returns:
        The figure.

    Raises:
        ResultFileError: A variable is missing, or no predictive controller ran.
    """
    shown = _predictive(dataset)
    friction = float(dataset.attrs["friction_static"])
    time = values_of(dataset, "time")
    making = run_figure(dataset, shown, rows=3, columns=1, size=(9.0, 7.0))
    panels = making.panels[:, 0]
    sources = [
        _constraints(np.where(shown[:, None], values_of(dataset, f"ground_force_{name}"), np.nan), friction)
        for name in ("simulated", "model")
    ]
    for axes, row, title, ylabel, forbidden in (
        (panels[0], 0, "Normal force", r"$-f_n$ [N]", "lifts off above"),
        (panels[1], 1, "Friction cone", r"$f_x^2 - (\mu_s f_n)^2$ [N$^2$]", "slips above"),
    ):
        axes.plot(time, sources[0][row], color=ACTUAL, linewidth=1.8, label="simulated forces")
        axes.plot(time, sources[1][row], color=REFERENCE, linewidth=1.2, linestyle="--", label="reduced model")
        dress_axes(axes, title=title, ylabel=ylabel)
        peak_limits(axes, time, sources[0][row], sources[1][row], include=(0.0,))
        draw_limit(axes, 0.0, forbidden, forbidden="above")
    label_lines(panels[0])
    _draw_cost(panels[2], time, np.where(shown, values_of(dataset, "cost"), np.nan))
    for axes in panels:
        draw_corners(
            axes, making.in_sight(corner_times(dataset)), text="corner of the ground" if axes is panels[0] else ""
        )
    return making.finish(dataset, "Constraints of the MPC, model against simulation, and its cost")


def _predictive(dataset: xarray.Dataset) -> NDArray[np.bool_]:
    """Samples under a predictive controller, after making sure that there are some."""
    require_variables(dataset, "ground_force_model", "ground_force_simulated", "cost")
    if "friction_static" not in dataset.attrs:
        raise ResultFileError("the trajectory has no attribute 'friction_static', so its friction cone is unknown")
    shown = predictive_samples(dataset)
    if not shown.any():
        controller = dataset.attrs.get("controller", "none")
        raise ResultFileError(f"no predictive controller ran (controller: {controller}), so there are no constraints")
    return shown


def _constraints(force: Array, friction: float) -> tuple[Array, Array]:
    """The paper's constraints h < 0, eq. ground_constraint: -f_n and f_x^2 - (mu_s f_n)^2, each of shape (n,)."""
    return -force[:, 1], force[:, 0] ** 2 - (friction * force[:, 1]) ** 2


def _draw_cost(axes: Axes, time: Array, cost: Array) -> None:
    axes.plot(time, np.where(cost > 0.0, cost, np.nan), color=COLOURS["ink"], linewidth=1.4)
    dress_axes(axes, title="Cost", ylabel=r"$J$ [-]", xlabel=TIME_LABEL)
    if (cost > 0.0).any():
        axes.set_yscale("log")
        axes.set_ylim(bottom=max(axes.get_ylim()[0], _LEAST_COST))
