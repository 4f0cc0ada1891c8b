"""Strips of pictures, as cut from the film of an experiment (paper, Figs. m4_experiment and wair_experiment)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.instants import Instant, climbing_instants, transformation_instants
from m4_dynamics.view.render.picture import Frame
from m4_dynamics.view.render.stage import METRES_PER_NEWTON, Pose, Stage, force_legend
from m4_dynamics.view.style import COLOURS, INK, new_figure, run_subtitle, save_figure, title_figure

__all__ = ["draw_climb_strip", "draw_transformation_strip", "write_climb_strip", "write_transformation_strip"]

Array = NDArray[np.float64]

_PER_ROW = 5
_PICTURE_WIDTH, _WIDE_PICTURE_WIDTH = 2.6, 3.1  # [inch]
_BETWEEN, _WORDS, _TITLE_ROOM, _FOOT = 0.07, 0.42, 0.70, 0.34  # [inch]
_DOTS_PER_INCH = 150
_VIEW = (-0.42, -1.0, 0.36)
_AROUND = 0.12  # [m] left free around the robot


def write_transformation_strip(dataset: xarray.Dataset, robot: Robot, path: Path | str) -> Path:
    """Write the strip of a transformation; see `draw_transformation_strip`."""
    return save_figure(draw_transformation_strip(dataset, robot), path)


def write_climb_strip(dataset: xarray.Dataset, robot: Robot, path: Path | str, *, pictures: int = 5) -> Path:
    """Write the strip of a climb; see `draw_climb_strip`."""
    return save_figure(draw_climb_strip(dataset, robot, pictures=pictures), path)


def draw_transformation_strip(dataset: xarray.Dataset, robot: Robot) -> Figure:
    """Draw how the robot morphs, raises itself, balances, touches down and morphs back; the camera goes with it.

    Args:
        dataset: A mission's trajectory.
        robot: The robot that made it.

    Returns:
        The figure.

    Raises:
        ResultFileError: The run has no such phases, or cannot be shown with this robot.
    """
    instants = transformation_instants(dataset)
    stage = Stage(dataset, robot, _VIEW)
    corners = [stage.corners(Pose(instant.sample)) for instant in instants]
    centres = np.array([0.5 * (own.min(axis=0) + own.max(axis=0)) for own in corners])
    # The camera goes along the ground with the robot; heights stay comparable from picture to picture.
    centres[:, 2] = 0.0
    sights = [stage.camera.project(own - centre) for own, centre in zip(corners, centres, strict=True)]
    low, high = np.concatenate(sights).min(axis=0) - _AROUND, np.concatenate(sights).max(axis=0) + _AROUND
    figure, panels, scale = _strip(len(instants), high - low, _PICTURE_WIDTH)
    for order, (axes, instant, centre) in enumerate(zip(panels, instants, centres, strict=True)):
        middle = stage.camera.project(centre)
        frame = Frame(*(low[0] + middle[0], high[0] + middle[0], low[1] + middle[1], high[1] + middle[1]))
        ground = stage.ground(float(centre[0]) - 2.5, float(centre[0]) + 2.5, half_width=2.5)
        stage.draw(axes, [Pose(instant.sample)], frame, ground, resolution=scale * _DOTS_PER_INCH)
        _caption(axes, order, instant, stage.thrust(instant.sample))
    title = f"{robot.name}: from four wheels to two" + (" and back" if _comes_back(instants) else "")
    _finish(figure, title, dataset)
    return figure


def draw_climb_strip(dataset: xarray.Dataset, robot: Robot, *, pictures: int = 5) -> Figure:
    """Draw how the robot climbs its slope, seen by a camera that stands still.

    Args:
        dataset: A trajectory.
        robot: The robot that made it.
        pictures: Number of pictures, evenly spaced along the slope.

    Returns:
        The figure.

    Raises:
        InvalidSettingError: The number of pictures is out of range.
        ResultFileError: The robot never climbed, or cannot be shown with this robot.
    """
    if not 2 <= pictures <= 20:
        raise InvalidSettingError("pictures", pictures, "from 2 to 20")
    instants = climbing_instants(dataset, along=pictures)
    stage = Stage(dataset, robot, _VIEW)
    corners = np.concatenate([stage.corners(Pose(instant.sample)) for instant in instants])
    ground = stage.ground(float(corners[:, 0].min()) - 0.3, float(corners[:, 0].max()) + 0.3)
    seen = stage.camera.project(np.concatenate([corners, *(part.reshape(-1, 3) for part in ground.triangles())]))
    low, high = seen.min(axis=0) - 0.05, seen.max(axis=0) + _AROUND
    figure, panels, scale = _strip(len(instants), high - low, _WIDE_PICTURE_WIDTH)
    frame = Frame(float(low[0]), float(high[0]), float(low[1]), float(high[1]))
    for order, (axes, instant) in enumerate(zip(panels, instants, strict=True)):
        stage.draw(axes, [Pose(instant.sample)], frame, ground, resolution=scale * _DOTS_PER_INCH)
        _caption(axes, order, instant, stage.thrust(instant.sample))
    _finish(figure, f"{robot.name} climbs a {float(dataset.attrs.get('slope_deg', 0.0)):g}° slope", dataset)
    return figure


def _strip(count: int, size: Array, wide: float) -> tuple[Figure, list[Axes], float]:
    """An empty strip for scenes of a size [m]: the figure, its pictures in order, their scale [inch/m]."""
    columns = count if count < _PER_ROW + 2 else min(_PER_ROW, -(-count // 2))
    rows = -(-count // columns)
    tall = wide * float(size[1] / size[0])
    width = columns * (wide + _BETWEEN) + _BETWEEN
    height = rows * (tall + _WORDS + _BETWEEN) + _TITLE_ROOM + _FOOT
    figure = new_figure(width=width, height=height)
    figure.set_layout_engine("none")
    panels = []
    for order in range(count):
        row, column = divmod(order, columns)
        left = _BETWEEN + column * (wide + _BETWEEN)
        bottom = height - _TITLE_ROOM - (row + 1) * (tall + _WORDS + _BETWEEN) + _WORDS
        panels.append(figure.add_axes((left / width, bottom / height, wide / width, tall / height)))
    return figure, panels, wide / float(size[0])


def _caption(axes: Axes, order: int, instant: Instant, thrust: float) -> None:
    """Number in the corner, time, phase and thrust below."""
    axes.add_patch(
        Rectangle((0, 0), 1, 1, transform=axes.transAxes, facecolor="none", edgecolor=COLOURS["mist"], linewidth=1.0,
                  zorder=12, clip_on=False)
    )  # fmt: skip
    axes.text(
        0.035, 0.955, str(order + 1), transform=axes.transAxes, ha="left", va="top", size=11, weight="bold",
        color="white", zorder=13,
        bbox={"boxstyle": "round,pad=0.28", "facecolor": instant.colour or COLOURS["ink"], "edgecolor": "none"},
    )  # fmt: skip
    words = f"{instant.time:.1f} s   {instant.phase}"
    axes.text(0.0, -0.025, words, transform=axes.transAxes, ha="left", va="top", size=8.5, color=INK)
    if thrust > 0.05:
        axes.text(1.0, -0.025, f"{thrust:.1f} N", transform=axes.transAxes, ha="right", va="top", size=8.5,
                  color=COLOURS["slate"])  # fmt: skip


def _comes_back(instants: Sequence[Instant]) -> bool:
    """Whether a change of shape follows the balancing."""
    balanced = [order for order, instant in enumerate(instants) if not instant.on_the_spot]
    return bool(balanced) and balanced[-1] < len(instants) - 1


def _finish(figure: Figure, title: str, dataset: xarray.Dataset) -> None:
    title_figure(figure, title, run_subtitle(dataset))
    height = figure.get_figheight()
    legend = figure.legend(
        handles=force_legend(), loc="lower left", bbox_to_anchor=(0.0, 0.0), ncols=3, fontsize=8.5, frameon=False,
        handlelength=2.0, borderaxespad=0.2,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_color(INK)
    bar = f"forces: 20 N is {2000.0 * METRES_PER_NEWTON:.0f} cm   ·   tiles 25 cm   ·   below right: total thrust"
    figure.text(0.993, 0.11 / height, bar, ha="right", va="bottom", size=8.5, color=COLOURS["slate"])
