"""Picture of a closed-loop map: verdicts, where statics draw the line, and what sets the two apart."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from m4_dynamics.feasibility.cell import VERDICTS
from m4_dynamics.feasibility.disagreement import EFFECT_LABELS, Effect
from m4_dynamics.view.map_style import VERDICT_COLOURS, outline_cells
from m4_dynamics.view.style import COLOURS, INK, dress_axes, new_figure, save_figure, title_figure

__all__ = ["plot_closed_loop"]

_PANELS_MAX = 3
_MARKERS = {
    Effect.THRUST_BOUND: "v",
    Effect.PLANNING_MARGIN: "o",
    Effect.START_TRANSIENT: "^",
    Effect.MARGIN_AND_TRANSIENT: "D",
    Effect.ACCELERATION: ">",
    Effect.SLIP: "s",
    Effect.MOTOR_SPEED: "P",
    Effect.RESERVE: "*",
    Effect.FULL_MODEL: "h",
    Effect.UNEXPLAINED: "X",
}


def plot_closed_loop(dataset: xarray.Dataset, path: Path | str) -> Path:
    """Draw the worst verdict of each cell over slope and thrust, with the static boundary and the disagreements.

    Args:
        dataset: A closed-loop map; up to three of its frictions are drawn.
        path: The picture's file.

    Returns:
        The path.

    Raises:
        ResultFileError: The file cannot be written.
    """
    frictions = dataset["friction"].to_numpy()
    shown = np.unique(np.linspace(0, len(frictions) - 1, min(len(frictions), _PANELS_MAX)).round().astype(int))
    figure = new_figure(width=2.4 + 5.2 * len(shown), height=5.8)
    panels = figure.subplots(1, len(shown), squeeze=False, sharey=True)[0]
    verdicts: set[int] = set()
    effects: set[Effect] = set()
    for axes, index in zip(panels, shown, strict=True):
        cells = dataset.isel(friction=index)
        verdicts |= _draw_verdicts(axes, cells)
        effects |= _mark_effects(axes, cells)
        label = "total thrust [N]" if axes is panels[0] else ""
        dress_axes(axes, title=f"friction μₛ {frictions[index]:g}", xlabel="slope [deg]", ylabel=label)
        axes.grid(False)
    handles: list[Patch | Line2D] = [
        Patch(facecolor=VERDICT_COLOURS[VERDICTS[code]], edgecolor=COLOURS["slate"], label=_label(VERDICTS[code]))
        for code in sorted(verdicts)
    ]
    handles.append(Line2D([], [], color=INK, linewidth=1.6, label="boundary of the statics"))
    handles += [
        Line2D([], [], marker=_MARKERS[e], linestyle="", markersize=5, color=COLOURS["blue"], label=EFFECT_LABELS[e])
        for e in sorted(effects)
    ]
    figure.legend(handles=handles, loc="outside right center", fontsize=8.5, frameon=False)
    settings = json.loads(dataset.attrs["settings"])
    model = "full model" if settings["plant"] == "full" else "reduced model"
    title_figure(
        figure,
        "Where the robot climbs in closed loop",
        f"{dataset.attrs.get('robot', '')}   ·   {model}   ·   controller {settings['controller']}   ·   "
        f"{settings['duration']:g} s at {settings['speed']:g} m/s   ·   marks: statics disagree, and why",
    )
    return save_figure(figure, path)


def _label(verdict: str) -> str:
    return "no equilibrium" if verdict == "infeasible" else str(verdict)


def _draw_verdicts(axes: Axes, cells: xarray.Dataset) -> set[int]:
    """Colour the cells by their worst start and draw the static boundary; returns the verdicts seen."""
    slope, thrust = np.degrees(cells["slope"].to_numpy()), cells["thrust"].to_numpy()
    worst = cells["verdict"].max("start").transpose("thrust", "slope").to_numpy()
    colours = ListedColormap([VERDICT_COLOURS[verdict] for verdict in VERDICTS])
    norm = BoundaryNorm(np.arange(len(VERDICTS) + 1) - 0.5, len(VERDICTS))
    axes.pcolormesh(slope, thrust, np.ma.masked_less(worst, 0), cmap=colours, norm=norm, shading="nearest")
    static = cells["static_feasible"].transpose("thrust", "slope").to_numpy()
    outline_cells(axes, slope, thrust, static, color=INK, linewidth=1.6)
    return {int(code) for code in np.unique(worst) if code >= 0}


def _mark_effects(axes: Axes, cells: xarray.Dataset) -> set[Effect]:
    slope, thrust = np.degrees(cells["slope"].to_numpy()), cells["thrust"].to_numpy()
    codes = cells["disagreement"].transpose("slope", "thrust").to_numpy()
    seen = {Effect(int(code)) for code in np.unique(codes) if code > 0}
    for effect in seen:
        i, j = np.nonzero(codes == effect)
        axes.plot(slope[i], thrust[j], linestyle="", marker=_MARKERS[effect], markersize=4.5, color=COLOURS["blue"])
    return seen
