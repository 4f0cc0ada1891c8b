"""Picture of a region of attraction."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from m4_dynamics.feasibility.attraction_rollout import OUTCOMES
from m4_dynamics.view.map_style import OUTCOME_COLOURS, outline_cells
from m4_dynamics.view.style import COLOURS, INK, dress_axes, new_figure, save_figure, title_figure

__all__ = ["plot_attraction"]

_PANELS_MAX = 3


def plot_attraction(dataset: xarray.Dataset, path: Path | str) -> Path:
    """Draw the worst outcome of each cell over pitch and pitch rate, with the outline of the region.

    Args:
        dataset: A region of attraction; up to three of its wheel speeds are drawn.
        path: The picture's file.

    Returns:
        The path.

    Raises:
        ResultFileError: The file cannot be written.
    """
    speeds = dataset["wheel_speed"].to_numpy()
    shown = np.unique(np.linspace(0, len(speeds) - 1, min(len(speeds), _PANELS_MAX)).round().astype(int))
    full = dataset.attrs["plant"] == "full"
    figure = new_figure(width=2.6 + 4.8 * len(shown), height=5.6)
    panels = figure.subplots(1, len(shown), squeeze=False, sharey=True)[0]
    seen: set[int] = set()
    for axes, index in zip(panels, shown, strict=True):
        seen |= _draw(axes, dataset.isel(wheel_speed=index), full=full)
        label = "initial pitch rate [deg/s]" if axes is panels[0] else ""
        title = f"wheels at {speeds[index]:g} m/s"
        dress_axes(axes, title=title, xlabel="initial pitch less the equilibrium's [deg]", ylabel=label)
        axes.grid(False)
    handles: list[Patch | Line2D] = [
        Patch(facecolor=OUTCOME_COLOURS[OUTCOMES[code]], edgecolor=COLOURS["slate"], label=OUTCOMES[code])
        for code in sorted(seen)
    ]
    handles.append(Line2D([], [], color=INK, linewidth=1.6, label="comes back"))
    if full:
        handles.append(
            Line2D([], [], color=COLOURS["blue"], linewidth=1.3, linestyle="--", label="reduced model comes back")
        )
    handles.append(Line2D([], [], color=INK, marker="+", linestyle="", markersize=8, label="equilibrium"))
    figure.legend(handles=handles, loc="outside right center", fontsize=8.5, frameon=False)
    settings, attributes = json.loads(dataset.attrs["settings"]), dataset.attrs
    title_figure(
        figure,
        f"From where the robot comes back to its equilibrium on {math.degrees(attributes['slope']):.4g}°",
        f"{attributes.get('robot', '')}   ·   {'full' if full else 'reduced'} model   ·   "
        f"controller {settings['controller']}   ·   pitch {math.degrees(attributes['trim_pitch']):.1f}°, "
        f"thrust {attributes['trim_thrust']:.1f} N, friction μₛ {attributes['friction']:g}   ·   "
        f"{settings['duration']:g} s",
    )
    return save_figure(figure, path)


def _draw(axes: Axes, cells: xarray.Dataset, *, full: bool) -> set[int]:
    """Colour the cells by their worst start and draw the outlines; returns the outcomes seen."""
    pitch, rate = np.degrees(cells["pitch_error"].to_numpy()), np.degrees(cells["pitch_rate"].to_numpy())
    worst = cells["outcome"].max("start").transpose("pitch_rate", "pitch_error").to_numpy()
    colours = ListedColormap([OUTCOME_COLOURS[outcome] for outcome in OUTCOMES])
    norm = BoundaryNorm(np.arange(len(OUTCOMES) + 1) - 0.5, len(OUTCOMES))
    axes.pcolormesh(pitch, rate, np.ma.masked_less(worst, 0), cmap=colours, norm=norm, shading="nearest")
    region = cells["returns"].transpose("pitch_rate", "pitch_error").to_numpy()
    outline_cells(axes, pitch, rate, region, color=INK, linewidth=1.6)
    if full:
        reduced = cells["returns_reduced"].transpose("pitch_rate", "pitch_error").to_numpy()
        outline_cells(axes, pitch, rate, reduced, color=COLOURS["blue"], linewidth=1.3, linestyle="--")
    axes.plot(0.0, 0.0, marker="+", markersize=10, color=INK)
    return {int(code) for code in np.unique(worst) if code >= 0}
