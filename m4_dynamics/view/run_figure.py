"""What every picture of a run over time has: panels on one time axis, the mission's phases, a headline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray
from matplotlib.figure import Figure
from numpy.typing import NDArray

from m4_dynamics.errors import ResultFileError
from m4_dynamics.view.phase_bands import draw_phase_bands, draw_phase_ribbon, ribbon_height
from m4_dynamics.view.phases import PhaseSpan, phases_of
from m4_dynamics.view.style import COLOURS, new_figure, run_subtitle, title_figure

__all__ = [
    "ACTUAL",
    "REFERENCE",
    "TIME_LABEL",
    "RunFigure",
    "require_variables",
    "run_figure",
    "values_of",
    "wheel_label",
]

ACTUAL = COLOURS["blue"]
REFERENCE = COLOURS["vermilion"]
TIME_LABEL = "time [s]"
_BESIDE_PANEL, _AROUND_PANEL = 0.75, 0.4  # [inch] taken by labels and titles


@dataclass(frozen=True, slots=True, eq=False)
class RunFigure:
    """A figure in the making.

    Attributes:
        figure: The figure.
        panels: Its panels, shape (rows, columns).
        phases: The phases in sight.
        start: Where the time axis starts [s].
        end: Where it ends [s].
    """

    figure: Figure
    panels: NDArray[np.object_]
    phases: tuple[PhaseSpan, ...]
    start: float
    end: float

    def in_sight(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Those of some moments that lie on the time axis [s]."""
        return times[(times >= self.start) & (times <= self.end)]

    def finish(self, dataset: xarray.Dataset, title: str) -> Figure:
        """Tint the phases, set the time axis, align the labels and write the headline.

        Args:
            dataset: The trajectory.
            title: What is shown, with a capital.

        Returns:
            The figure.
        """
        for axes in self.panels.ravel():
            draw_phase_bands(axes, self.phases)
            axes.set_xlim(self.start, self.end)
        self.figure.align_ylabels(list(self.panels.ravel()))
        robot = str(dataset.attrs.get("robot", "")).strip()
        headline = f"{robot}: {title[0].lower()}{title[1:]}" if robot else title
        title_figure(self.figure, headline, run_subtitle(dataset))
        return self.figure


def run_figure(
    dataset: xarray.Dataset,
    shown: NDArray[np.bool_] | None = None,
    *,
    rows: int,
    columns: int,
    size: tuple[float, float],
) -> RunFigure:
    """Make panels on a common time axis, with the phases of a mission named above them.

    Args:
        dataset: The trajectory.
        shown: Samples that must be in sight, shape (time,); None shows all.
        rows: Rows of panels.
        columns: Columns of panels.
        size: Width and, without the names of phases, height [inch].

    Returns:
        The figure in the making.
    """
    time = values_of(dataset, "time")
    seen = time if shown is None or not shown.any() else time[shown]
    start, end = float(seen[0]), float(seen[-1])
    phases = tuple(phase.within(start, end) for phase in phases_of(dataset) if phase.end > start and phase.start < end)
    width, height = size
    if not phases:
        figure = new_figure(width=width, height=height)
        panels = figure.subplots(rows, columns, sharex=True, squeeze=False)
        return RunFigure(figure, panels, (), start, end)
    panel_width = width / columns - _BESIDE_PANEL
    ribbon = ribbon_height(phases, width=panel_width)
    figure = new_figure(width=width, height=height + ribbon)
    grid = figure.add_gridspec(rows + 1, columns, height_ratios=[ribbon, *[height / rows - _AROUND_PANEL] * rows])
    panels = np.empty((rows, columns), dtype=object)
    for column in range(columns):
        draw_phase_ribbon(figure.add_subplot(grid[0, column]), phases, width=panel_width)
        for row in range(rows):
            panels[row, column] = figure.add_subplot(grid[row + 1, column], sharex=panels[0, 0])
    return RunFigure(figure, panels, phases, start, end)


def require_variables(dataset: xarray.Dataset, *names: str) -> None:
    """Check that a trajectory can be plotted.

    Args:
        dataset: A trajectory.
        names: Variables that it must have beside its time.

    Raises:
        ResultFileError: One is missing, or there is but one sample.
    """
    missing = [name for name in ("time", *names) if name not in dataset.variables]
    if missing:
        present = ", ".join(sorted(str(name) for name in dataset.variables))
        raise ResultFileError(f"the trajectory has no variable {', '.join(missing)}; it has {present or 'none'}")
    if dataset.sizes["time"] < 2:
        raise ResultFileError(f"a plot needs two samples or more, but the trajectory has {dataset.sizes['time']}")


def values_of(dataset: xarray.Dataset, name: str) -> NDArray[np.float64]:
    """A variable's values."""
    return np.asarray(dataset[name].values, dtype=float)


def wheel_label(dataset: xarray.Dataset, index: int) -> str:
    """A wheel's name as plots show it."""
    return str(dataset["wheel"].values[index]).replace("_", " ") if "wheel" in dataset.coords else f"wheel {index + 1}"
