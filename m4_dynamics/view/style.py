"""House style of every picture: palette, axes, titles.

The colours are those of Okabe and Ito, distinct for all common forms of colour blindness; lines that matter also differ
in dash or width. Figures are built through Matplotlib's object interface, so drawing touches no global state.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.output import replacing

__all__ = [
    "COLOURS",
    "INK",
    "draw_limit",
    "dress_axes",
    "label_lines",
    "new_figure",
    "peak_limits",
    "run_facts",
    "run_subtitle",
    "save_figure",
    "series_colours",
    "tight_limits",
    "title_figure",
]

#: Name -> sRGB hex. The names say what a colour is; what it stands for is said where it is used.
COLOURS: dict[str, str] = {
    "blue": "#0072B2",
    "vermilion": "#D55E00",
    "green": "#009E73",
    "orange": "#E69F00",
    "sky": "#56B4E9",
    "purple": "#CC79A7",
    "ink": "#1F2933",
    "slate": "#5B6770",
    "mist": "#D5DAE0",
    "paper": "#FFFFFF",
}
INK = COLOURS["ink"]

_TITLE_SIZE = 15.0
_SUBTITLE_SIZE = 10.0
_AXES_TITLE_SIZE = 10.5
_LABEL_SIZE = 9.0
_DOTS_PER_INCH = 150
_PEAK_SHARE = 2e-3  # of all samples; rarer values may leave a panel
_ONE_PEAK = 0.3  # [s] excursions that follow each other more quickly are one


def new_figure(*, width: float, height: float) -> Figure:
    """Make an empty figure on the Agg canvas.

    Args:
        width: Width [inch].
        height: Height [inch].

    Returns:
        The figure, laid out without overlaps when it is drawn.
    """
    figure = Figure(figsize=(width, height), dpi=_DOTS_PER_INCH, facecolor=COLOURS["paper"], layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def title_figure(figure: Figure, title: str, subtitle: str) -> None:
    """Write a headline and a line of facts at the upper left, and reserve their room.

    Args:
        figure: The figure.
        title: What is shown.
        subtitle: Conditions of the run; may be empty.
    """
    height = figure.get_figheight()
    room = 0.62 if subtitle else 0.42  # [inch]
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(0.0, 0.0, 1.0, 1.0 - room / height))
    figure.text(0.012, 1.0 - 0.11 / height, title, size=_TITLE_SIZE, weight="bold", color=INK, va="top", ha="left")
    figure.text(0.012, 1.0 - 0.40 / height, subtitle, size=_SUBTITLE_SIZE, color=COLOURS["slate"], va="top", ha="left")


def dress_axes(axes: Axes, *, title: str, ylabel: str, xlabel: str | None = None) -> None:
    """Give axes the house look.

    Args:
        axes: The axes.
        title: What the panel shows.
        ylabel: Quantity and unit.
        xlabel: Quantity and unit, or None where the panel below carries it.
    """
    axes.set_title(title, loc="left", size=_AXES_TITLE_SIZE, color=INK, pad=5)
    axes.set_ylabel(ylabel, size=_LABEL_SIZE, color=INK)
    if xlabel is not None:
        axes.set_xlabel(xlabel, size=_LABEL_SIZE, color=INK)
    axes.tick_params(labelsize=_LABEL_SIZE - 0.5, colors=INK, length=3, width=0.7, labelbottom=xlabel is not None)
    axes.grid(True, color=COLOURS["mist"], linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(COLOURS["slate"])
        axes.spines[side].set_linewidth(0.8)


def draw_limit(axes: Axes, value: float, text: str, *, forbidden: str | None = None) -> None:
    """Draw a limit as a dotted line with its name at the right end.

    Args:
        axes: The axes.
        value: The limit, in the unit of the vertical axis.
        text: The limit's name.
        forbidden: "above" or "below" shades that side lightly.
    """
    axes.axhline(value, color=COLOURS["slate"], linestyle=(0, (1, 1.6)), linewidth=1.3, zorder=1.5)
    axes.annotate(
        text,
        xy=(1.0, value),
        xycoords=axes.get_yaxis_transform(),
        xytext=(-2, 2.5),
        textcoords="offset points",
        ha="right",
        va="bottom",
        size=_LABEL_SIZE - 1.5,
        color=COLOURS["slate"],
        bbox={"facecolor": "white", "alpha": 0.6, "edgecolor": "none", "pad": 0.8},
        zorder=5,
    )
    if forbidden is not None:
        low, high = axes.get_ylim()
        span = (low, value) if forbidden == "below" else (value, high)
        axes.axhspan(*span, color=COLOURS["vermilion"], alpha=0.07, linewidth=0, zorder=0)
        axes.set_ylim(low, high)


def label_lines(axes: Axes, *, leave_out: tuple[str, ...] = ()) -> None:
    """Add the panel's legend in the line of its title, where it hides no data.

    Args:
        axes: The axes, with labelled lines.
        leave_out: Labels that another panel's legend explains already.
    """
    handles, labels = axes.get_legend_handles_labels()
    legend = axes.legend(
        handles=[handle for handle, label in zip(handles, labels, strict=True) if label not in leave_out],
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=8,
        fontsize=_LABEL_SIZE - 0.5,
        frameon=False,
        handlelength=1.9,
        columnspacing=1.4,
        borderaxespad=0.1,
        borderpad=0.2,
    )
    for text in legend.get_texts():
        text.set_color(INK)


def tight_limits(axes: Axes, *series: ArrayLike, include: tuple[float, ...] = (), least_span: float = 0.0) -> None:
    """Set the vertical range to the finite data with a margin, and never narrower than a stated span.

    Args:
        axes: The axes.
        series: Data drawn, in the unit of the vertical axis.
        include: Values that must be in sight.
        least_span: Narrowest range allowed, so that noise is not blown up to look like motion.
    """
    values: NDArray[np.float64] = np.concatenate([np.ravel(np.asarray(one, dtype=float)) for one in (*series, include)])
    values = values[np.isfinite(values)]
    if values.size == 0:
        return
    low, high = float(values.min()), float(values.max())
    missing = max(least_span - (high - low), 0.0) / 2.0
    margin = 0.06 * max(high - low, least_span, 1e-12)
    axes.set_ylim(low - missing - margin, high + missing + 1.6 * margin)


def peak_limits(
    axes: Axes, time: NDArray[np.float64], *series: NDArray[np.float64], include: tuple[float, ...] = ()
) -> None:
    """Set the vertical range to the data, but let short peaks that would flatten the rest leave it, with their values.

    Args:
        axes: The axes.
        time: When, shape (n,).
        series: Data drawn, each of shape (n,), NaN where there is none.
        include: Values that must be in sight.
    """
    finite = np.concatenate([one[np.isfinite(one)] for one in series])
    if finite.size == 0:
        return
    usual = np.quantile(finite, (_PEAK_SHARE, 1.0 - _PEAK_SHARE))
    low, high = min(usual[0], *include, usual[1]), max(usual[1], *include)
    room = 0.5 * (high - low)
    peaks = bool(finite.max() > high + room)
    troughs = bool(finite.min() < low - room)
    kept = finite[(finite <= high + room) & (finite >= low - room)]
    tight_limits(axes, kept, include=include)
    if peaks or troughs:
        low, high = axes.get_ylim()
        # Room for the values, which stand where the peaks leave the panel.
        axes.set_ylim(low - 0.12 * troughs * (high - low), high + 0.12 * peaks * (high - low))
    for values in series:
        if peaks:
            _name_peaks(axes, time, values, above=True)
        if troughs:
            _name_peaks(axes, time, -values, above=False)


def _name_peaks(axes: Axes, time: NDArray[np.float64], values: NDArray[np.float64], *, above: bool) -> None:
    """Write the value of each stretch that leaves the range at the edge where it leaves; below, values are negated."""
    edge = axes.get_ylim()[1] if above else -axes.get_ylim()[0]
    outside = np.flatnonzero(np.nan_to_num(values, nan=-np.inf) > edge)
    for stretch in np.split(outside, np.flatnonzero(np.diff(time[outside]) > _ONE_PEAK) + 1):
        if stretch.size:
            top = stretch[int(np.argmax(values[stretch]))]
            value = values[top] if above else -values[top]
            axes.annotate(
                f"{value:.0f}", xy=(float(time[top]), float(above)), xycoords=axes.get_xaxis_transform(),
                xytext=(4, -2 if above else 2), textcoords="offset points", ha="left", va="top" if above else "bottom",
                size=_LABEL_SIZE - 1.5, color=COLOURS["slate"],
            )  # fmt: skip


def series_colours(count: int) -> list[str]:
    """Colours for a family of lines, in an order that keeps neighbours apart.

    Args:
        count: Number of lines.

    Returns:
        Hex colours; the cycle repeats after six.
    """
    cycle = ("blue", "vermilion", "green", "purple", "orange", "sky")
    return [COLOURS[cycle[index % len(cycle)]] for index in range(count)]


def run_facts(dataset: xarray.Dataset) -> list[str]:
    """The run's conditions, from the trajectory's attributes; what is absent is left out.

    Args:
        dataset: A trajectory.

    Returns:
        For example ["slope 45°", "friction μₛ 0.8", "controller default", "verdict: climbed"].
    """
    attributes = dataset.attrs
    facts: list[str] = []
    if attributes.get("mission"):
        facts.append(f"mission {attributes['mission']}")
    if "slope_deg" in attributes:
        slope = float(attributes["slope_deg"])
        facts.append(f"slope {slope:g}°" if slope else "level ground")
    if "friction_static" in attributes:
        facts.append(f"friction μₛ {float(attributes['friction_static']):g}")
    if attributes.get("controller"):
        facts.append(f"controller {attributes['controller']}")
    if attributes.get("verdict"):
        facts.append(f"verdict: {attributes['verdict']}")
    return facts


def run_subtitle(dataset: xarray.Dataset) -> str:
    """The run's conditions in one line; see `run_facts`."""
    return "   ·   ".join(run_facts(dataset))


def save_figure(figure: Figure, path: Path | str) -> Path:
    """Write a figure to a file, whole or not at all.

    Args:
        figure: The figure.
        path: Where; the suffix chooses the format.

    Returns:
        The path.

    Raises:
        ResultFileError: The file cannot be written.
    """
    target = Path(path)
    with replacing(target) as partial:
        figure.savefig(partial, dpi=_DOTS_PER_INCH, facecolor=figure.get_facecolor())
    return target
