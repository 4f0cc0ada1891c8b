"""Ground forces of a run over time: constraints of the model against the simulation, slip and cost.

Everything here is about the robot on its drive wheels: of a mission only the phases in which it balances are drawn.
"""

from __future__ import annotations

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from m4_dynamics.errors import ResultFileError
from m4_dynamics.view.friction import friction_use_in_plane, worst_wheel
from m4_dynamics.view.phase_bands import draw_corners
from m4_dynamics.view.phases import balancing_samples, corner_times
from m4_dynamics.view.run_figure import (
    ACTUAL,
    REFERENCE,
    TIME_LABEL,
    require_variables,
    run_figure,
    values_of,
    wheel_label,
)
from m4_dynamics.view.style import COLOURS, draw_limit, dress_axes, label_lines, peak_limits, series_colours

__all__ = ["draw_ground_forces"]

_SLIDING_MM_S = 5.0  # a contact point faster than this slides visibly; slower ones creep
_LEAST_COST = 1e-6  # costs below it are nothing but the last digits of a perfect hold


def draw_ground_forces(dataset: xarray.Dataset) -> Figure:
    """Draw the ground constraints of the model beside the simulated contact forces, the slip and the cost.

    Args:
        dataset: A trajectory.

    Returns:
        The figure: friction reserve, normal force, friction use, slip speed and cost over time, of a mission over the
        time in which it balances.

    Raises:
        ResultFileError: A variable or the attribute `friction_static` is missing.
    """
    require_variables(dataset, "ground_force_model", "ground_force_simulated", "slip_speed", "cost", "tracking_cost")
    if "friction_static" not in dataset.attrs:
        raise ResultFileError("the trajectory has no attribute 'friction_static', so its friction reserve is unknown")
    friction = float(dataset.attrs["friction_static"])
    time, balancing = values_of(dataset, "time"), balancing_samples(dataset)

    def while_balancing(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.where(balancing.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)

    sources = {
        "simulated": while_balancing(values_of(dataset, "ground_force_simulated")),
        "model": while_balancing(values_of(dataset, "ground_force_model")),
    }
    reserve = {name: friction * force[:, 1] - np.abs(force[:, 0]) for name, force in sources.items()}
    normal = {name: force[:, 1] for name, force in sources.items()}
    use = {name: friction_use_in_plane(force, friction) for name, force in sources.items()}

    making = run_figure(dataset, balancing, rows=5, columns=1, size=(10.0, 10.5))
    panels = making.panels[:, 0]
    _draw_sources(panels[0], time, reserve, "Friction reserve", r"$\mu_s f_n - |f_x|$ [N]", 0.0, "slips below", "below")
    _draw_sources(panels[1], time, normal, "Normal force, both wheels", r"$f_n$ [N]", 0.0, "lifts off below", "below")
    _draw_sources(panels[2], time, use, "Friction use", r"$|f_x|\,/\,\mu_s f_n$ [-]", 1.0, "slips above", "above")
    if "friction_use" in dataset:
        # The reduced model knows nothing of sideways forces, which use up friction too.
        worst = worst_wheel(while_balancing(values_of(dataset, "friction_use")))
        panels[2].plot(time, worst, color=COLOURS["purple"], linewidth=1.1, label="worst wheel, sideways included")
        label_lines(panels[2], leave_out=("simulated contact", "model of the controller"))
    # The model's forces mean nothing once the robot lies on the ground; they would flatten the rest.
    panels[2].set_ylim(top=min(panels[2].get_ylim()[1], 1.6))
    label_lines(panels[0])
    _draw_slip(panels[3], dataset, time, 1e3 * while_balancing(values_of(dataset, "slip_speed")))
    _draw_cost(
        panels[4],
        time,
        while_balancing(values_of(dataset, "cost")),
        while_balancing(values_of(dataset, "tracking_cost")),
    )
    corners = making.in_sight(corner_times(dataset))
    for axes in panels:
        draw_corners(axes, corners, text="corner of the ground" if axes is panels[1] else "")
    if not balancing.any():
        panels[0].text(0.5, 0.5, "the robot never balanced", transform=panels[0].transAxes, ha="center", va="center")
    return making.finish(dataset, "Ground forces, slip and cost")


def _draw_sources(
    axes: Axes,
    time: NDArray[np.float64],
    sources: dict[str, NDArray[np.float64]],
    title: str,
    ylabel: str,
    limit: float,
    limit_text: str,
    forbidden: str,
) -> None:
    """One ground constraint, simulated and model, with its limit."""
    axes.plot(time, sources["simulated"], color=ACTUAL, linewidth=1.8, label="simulated contact")
    axes.plot(time, sources["model"], color=REFERENCE, linewidth=1.2, linestyle="--", label="model of the controller")
    dress_axes(axes, title=title, ylabel=ylabel)
    peak_limits(axes, time, *sources.values(), include=(limit, 0.0))
    draw_limit(axes, limit, limit_text, forbidden=forbidden)


def _draw_slip(axes: Axes, dataset: xarray.Dataset, time: NDArray[np.float64], slip: NDArray[np.float64]) -> None:
    """Speed of each wheel's contact point on a logarithmic scale: sticking contacts creep, sliding ones run."""
    floor = 1e-3  # [mm/s]; below it a contact stands still for any purpose
    touching = [index for index in range(slip.shape[1]) if np.nanmax(slip[:, index], initial=0.0) > 0.0]
    for order, (colour, index) in enumerate(zip(series_colours(len(touching)), touching, strict=True)):
        dash = "-" if order % 2 == 0 else (0, (4, 1.5))
        label = wheel_label(dataset, index)
        axes.plot(time, np.maximum(slip[:, index], floor), color=colour, linewidth=1.4, linestyle=dash, label=label)
    dress_axes(axes, title="Slip speed of the contact points", ylabel="[mm/s]")
    axes.set_yscale("log")
    axes.set_ylim(floor, max(30.0, 2.0 * float(np.nanmax(slip, initial=0.0))))
    draw_limit(axes, _SLIDING_MM_S, f"sliding above {_SLIDING_MM_S:g} mm/s")
    if touching:
        label_lines(axes)


def _draw_cost(axes: Axes, time: NDArray[np.float64], cost: NDArray[np.float64], tracking: NDArray[np.float64]) -> None:
    """Cost of the predictive controller and of the tracking alone, on a logarithmic scale."""
    drawn = []
    for values, label, colour, dash in (
        (cost, r"MPC cost $J$", ACTUAL, "-"),
        (tracking, r"tracking $e^\top Q\,e$", COLOURS["green"], "-."),
    ):
        positive = np.where(values > 0.0, values, np.nan)
        if np.isfinite(positive).any():
            axes.plot(time, positive, color=colour, linewidth=1.5, linestyle=dash, label=label)
            drawn.append(positive)
    dress_axes(axes, title="Cost", ylabel=r"$J$ [-]", xlabel=TIME_LABEL)
    if drawn:
        axes.set_yscale("log")
        axes.set_ylim(bottom=max(axes.get_ylim()[0], _LEAST_COST))
        label_lines(axes)
    else:
        axes.text(0.5, 0.5, "this controller reports no cost", transform=axes.transAxes, ha="center", va="center")
