"""Pictures of static maps: what stops the robot where, and the curves that summarise it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch

from m4_dynamics.feasibility.limits import LIMIT_LABELS, Limit
from m4_dynamics.feasibility.static import best_branch
from m4_dynamics.view.map_style import LIMIT_COLOURS
from m4_dynamics.view.style import COLOURS, INK, dress_axes, label_lines, new_figure, save_figure, series_colours
from m4_dynamics.view.style import title_figure as title

__all__ = ["plot_static_curves", "plot_static_map"]

_PANELS_MAX = 3
_FRICTION_LEVELS = np.arange(0.1, 2.0, 0.1)
_PITCH_LEVELS = np.arange(-90.0, 91.0, 15.0)


def plot_static_map(dataset: xarray.Dataset, path: Path | str) -> Path:
    """Draw the active limit over slope and thrust, with contours of the friction needed and of the pitch.

    Args:
        dataset: A static map; up to three of its frictions are drawn, the first posture and the fastest speed.
        path: The picture's file.

    Returns:
        The path.

    Raises:
        ResultFileError: The file cannot be written.
    """
    chosen = best_branch(dataset.isel(posture_angle=[0], speed=[-1])).squeeze(["posture_angle", "speed"])
    frictions = dataset["friction"].to_numpy()
    shown = np.unique(np.linspace(0, len(frictions) - 1, min(len(frictions), _PANELS_MAX)).round().astype(int))
    figure = new_figure(width=1.6 + 4.9 * len(shown) + (1.4 if len(shown) == 1 else 0.0), height=5.6)
    panels = figure.subplots(1, len(shown), squeeze=False, sharey=True)[0]
    seen: set[Limit] = set()
    for axes, index in zip(panels, shown, strict=True):
        cells = chosen.isel(friction=index)
        seen |= _draw_limits(axes, cells)
        dress_axes(
            axes,
            title=f"friction μₛ {frictions[index]:g}",
            xlabel="slope [deg]",
            ylabel="total thrust [N]" if axes is panels[0] else "",
        )
        axes.grid(False)
    handles = [Patch(facecolor="white", edgecolor=COLOURS["slate"], label="feasible")]
    handles += [Patch(facecolor=LIMIT_COLOURS[limit], label=LIMIT_LABELS[limit]) for limit in Limit if limit in seen]
    figure.legend(handles=handles, loc="outside right center", fontsize=8.5, frameon=False, title="limit missed most")
    speed = float(dataset["speed"][-1])
    title(
        figure,
        "Where the robot can climb, and what stops it elsewhere",
        f"{dataset.attrs.get('robot', '')}   ·   equilibria at {speed:g} m/s   ·   "
        "lines: friction needed (black), pitch in deg (blue, dashed)",
    )
    return save_figure(figure, path)


def _draw_limits(axes: Axes, cells: xarray.Dataset) -> set[Limit]:
    """Colour the infeasible cells and draw contours; returns the limits seen."""
    slope, thrust = np.degrees(cells["slope"].to_numpy()), cells["thrust"].to_numpy()
    active = cells["active_limit"].transpose("thrust", "slope").to_numpy()
    feasible = cells["feasible"].transpose("thrust", "slope").to_numpy()
    colours = ListedColormap([LIMIT_COLOURS[limit] for limit in Limit])
    norm = BoundaryNorm(np.arange(len(Limit) + 1) - 0.5, len(Limit))
    axes.pcolormesh(slope, thrust, np.ma.masked_array(active, feasible), cmap=colours, norm=norm, shading="nearest")
    if len(slope) > 1 and len(thrust) > 1:
        axes.contour(slope, thrust, feasible.astype(float), levels=[0.5], colors=[INK], linewidths=1.6)
        for name, levels, colour, style, size in (
            ("friction_needed", _FRICTION_LEVELS, INK, "solid", 0.8),
            ("pitch", _PITCH_LEVELS, COLOURS["blue"], (0, (4, 2)), 0.7),
        ):
            values = cells[name].transpose("thrust", "slope").to_numpy()
            if name == "pitch":
                values = np.degrees(values)
            values = np.where(np.isfinite(values) & feasible, values, np.nan)
            if np.isfinite(values).sum() < 4:
                continue
            inside = levels[(levels > np.nanmin(values)) & (levels < np.nanmax(values))]
            if len(inside) == 0:
                continue
            lines = axes.contour(
                slope, thrust, values, levels=inside, colors=[colour], linewidths=size, linestyles=[style]
            )
            axes.clabel(
                lines, fontsize=7, fmt=lambda level: f"{level:.1f}" if level < 10 and level % 1 else f"{level:g}"
            )
    return {Limit(int(code)) for code in np.unique(active[~feasible])}


def plot_static_curves(curves: xarray.Dataset, path: Path | str) -> Path:
    """Draw steepest slopes, least friction with its thrust, and power.

    Args:
        curves: From `map_curves`; the first posture and the fastest speed are drawn.
        path: The picture's file.

    Returns:
        The path.

    Raises:
        ResultFileError: The file cannot be written.
    """
    one = curves.isel(posture_angle=0, speed=-1)
    slope, thrust = np.degrees(one["slope"].to_numpy()), one["thrust"].to_numpy()
    friction = one["friction"].to_numpy()
    shown = np.unique(np.linspace(0, len(friction) - 1, min(len(friction), 6)).round().astype(int))
    figure = new_figure(width=11.0, height=7.4)
    (of_thrust, of_friction), (needed, power) = figure.subplots(2, 2)
    for colour, index in zip(series_colours(len(shown)), shown, strict=True):
        values = np.degrees(one["steepest_slope"].isel(friction=index).to_numpy())
        of_thrust.plot(thrust, values, color=colour, linewidth=1.5, label=f"μₛ {friction[index]:g}")
    dress_axes(of_thrust, title="Steepest slope", xlabel="total thrust [N]", ylabel="slope [deg]")
    # Six frictions do not fit beside the title; the panel of the power has the same colours.
    of_thrust.legend(loc="upper left", ncols=2, fontsize=8.5, frameon=False)

    marker = "o" if len(friction) < 12 else ""
    best = np.degrees(one["steepest_slope_best_thrust"].to_numpy())
    of_friction.plot(friction, best, color=COLOURS["blue"], marker=marker, markersize=4, linewidth=1.6)
    of_friction.plot(
        friction, np.degrees(np.arctan(friction)), color=COLOURS["slate"], linestyle=(0, (1, 1.6)), label="arctan μₛ"
    )
    dress_axes(of_friction, title="Steepest slope with the best thrust", xlabel="friction μₛ", ylabel="slope [deg]")
    label_lines(of_friction)

    needed.plot(slope, one["least_friction"], color=COLOURS["vermilion"], linewidth=1.6, label="least friction")
    needed.plot(slope, np.tan(np.radians(slope)), color=COLOURS["slate"], linestyle=(0, (1, 1.6)), label="tan slope")
    finite = one["least_friction"].to_numpy()
    top = float(np.nanmax(finite)) if np.isfinite(finite).any() else 1.0
    needed.set_ylim(0.0, min(1.1 * top, 2.0) if top > 0.0 else 1.0)
    dress_axes(needed, title="Friction needed at least", xlabel="slope [deg]", ylabel="coefficient [1]")
    label_lines(needed)

    for colour, index in zip(series_colours(len(shown)), shown, strict=True):
        values = one["least_power"].isel(friction=index).to_numpy()
        power.plot(slope, values, color=colour, linewidth=1.5, label=f"μₛ {friction[index]:g}")
    power.plot(
        slope,
        one["power_of_least_friction"],
        color=INK,
        linestyle=(0, (4, 2)),
        linewidth=1.1,
        label="at the least friction",
    )
    dress_axes(power, title="Least power within all limits", xlabel="slope [deg]", ylabel="power [W]")
    label_lines(power, leave_out=tuple(f"μₛ {value:g}" for value in friction))
    merit = curves.attrs.get("figure_of_merit", math.nan)
    title(
        figure,
        "How steep, on what ground, at what cost",
        f"{curves.attrs.get('robot', '')}   ·   equilibria at {float(one['speed']):g} m/s   ·   "
        f"rotors by momentum theory, figure of merit {merit:g} (assumed)",
    )
    return save_figure(figure, path)
