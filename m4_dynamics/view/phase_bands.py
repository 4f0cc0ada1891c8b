"""Phases of a mission in plots over time: a ribbon with their names on top, light bands behind the data."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from m4_dynamics.view.phases import PhaseSpan
from m4_dynamics.view.style import COLOURS, INK

__all__ = ["draw_corners", "draw_phase_bands", "draw_phase_ribbon", "ribbon_height"]

_BAR = 0.17  # [inch] height of the bars
_SIZE = 7.5  # [point] of the names
_LETTER = 0.0575  # [inch] width of a letter of that size, about
_SLANT = 30.0  # [deg] of names that are longer than their bars
_LETTERS_APART = 0.19  # [inch] least distance of two slanted names
_BAND_STRENGTH, _BAR_STRENGTH = 0.085, 0.62


def ribbon_height(phases: Sequence[PhaseSpan], *, width: float) -> float:
    """Height that a ribbon needs [inch].

    Args:
        phases: The phases, one at least.
        width: Width of the ribbon [inch], about.

    Returns:
        The height: more if a name is longer than its bar, so that the names have to slant.
    """
    if _names_fit(phases, width):
        return _BAR
    longest = max(len(phase.label) for phase in phases)
    return _BAR + 0.24 + longest * _LETTER * math.sin(math.radians(_SLANT))


def draw_phase_ribbon(axes: Axes, phases: Sequence[PhaseSpan], *, width: float) -> None:
    """Draw the phases as a row of bars with their names, inside or slanting down to them.

    Args:
        axes: Axes of their own above the panels, as high as `ribbon_height` says.
        phases: The phases, one at least.
        width: Width of the axes [inch], about.
    """
    start, end = phases[0].start, phases[-1].end
    inside = _names_fit(phases, width)
    bar = _BAR / ribbon_height(phases, width=width)
    axes.set_xlim(start, end)
    axes.set_ylim(0.0, 1.0)
    axes.set_axis_off()
    middles = np.array([0.5 * (phase.start + phase.end) for phase in phases])
    places = _spread(middles, _LETTERS_APART / width * (end - start))
    for phase, middle, place in zip(phases, middles, places, strict=True):
        axes.axvspan(phase.start, phase.end, 0.0, bar, color=phase.colour, alpha=_BAR_STRENGTH, linewidth=0)
        axes.axvline(phase.start, 0.0, bar, color="white", linewidth=1.0)
        if inside:
            axes.text(middle, 0.46 * bar, phase.label, size=_SIZE, color=INK, ha="center", va="center")
            continue
        foot = bar * (1.0 + 0.06 / _BAR)
        axes.plot([middle, place], [bar, foot], color=COLOURS["slate"], linewidth=0.7, clip_on=False)
        name = axes.text(
            place, foot, phase.label, rotation=-_SLANT, rotation_mode="anchor", size=_SIZE, color=INK, ha="right"
        )
        name.set_in_layout(False)  # names may stand out to the left, where no panel has anything


def _names_fit(phases: Sequence[PhaseSpan], width: float) -> bool:
    """Whether every name fits into its bar."""
    per_second = width / (phases[-1].end - phases[0].start)
    return all(len(phase.label) * _LETTER < 0.96 * per_second * (phase.end - phase.start) for phase in phases)


def draw_phase_bands(axes: Axes, phases: Iterable[PhaseSpan]) -> None:
    """Tint the background of a panel phase by phase.

    Args:
        axes: The panel.
        phases: The phases.
    """
    for phase in phases:
        axes.axvspan(phase.start, phase.end, color=phase.colour, alpha=_BAND_STRENGTH, linewidth=0, zorder=0)


def draw_corners(axes: Axes, times: NDArray[np.float64], *, text: str = "") -> None:
    """Mark the moments at which the wheels came to a corner of the terrain.

    Args:
        axes: The panel.
        times: The moments [s].
        text: Written beside the first one.
    """
    for order, time in enumerate(times):
        axes.axvline(time, color=COLOURS["slate"], linestyle=(0, (4, 3)), linewidth=0.8, alpha=0.8, zorder=1)
        if text and order == 0:
            axes.annotate(
                text, xy=(time, 0.0), xycoords=axes.get_xaxis_transform(), xytext=(-3, 4), textcoords="offset points",
                ha="right", va="bottom", size=7.5, color=COLOURS["slate"],
            )  # fmt: skip


def _spread(middles: NDArray[np.float64], distance: float) -> NDArray[np.float64]:
    """Places at or before the given ones, in their order, none nearer to the next than a distance."""
    places = middles.copy()
    for index in range(len(places) - 2, -1, -1):
        places[index] = min(places[index], places[index + 1] - distance)
    return places
