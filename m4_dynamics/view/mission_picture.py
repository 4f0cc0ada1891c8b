"""One picture of a whole run: the robot at several instants, from four wheels to the end of its climb (paper,
Fig. plot_states A).

What happens on the spot would be drawn on top of itself, so those poses are drawn side by side, before the place where
they happened; a bracket says so.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.instants import Instant, way_instants
from m4_dynamics.view.render.picture import Frame
from m4_dynamics.view.render.stage import METRES_PER_NEWTON, Pose, Stage, force_legend
from m4_dynamics.view.scene import COM_COLOUR
from m4_dynamics.view.style import COLOURS, INK, new_figure, run_subtitle, save_figure, title_figure

__all__ = ["draw_mission", "write_mission_picture"]

Array = NDArray[np.float64]

_WIDTH = 13.0  # [inch]
_HIGHEST = 7.4  # [inch] of the scene
_TITLE_ROOM, _DOTS_PER_INCH = 0.66, 150
_GAP = 0.16  # [m] between poses drawn side by side
_MARGIN, _ABOVE = 0.25, 0.12  # [m]
_WORDS = 0.62  # [inch] below the ground for times and phases


def write_mission_picture(dataset: xarray.Dataset, robot: Robot, path: Path | str, *, along: int = 6) -> Path:
    """Write the picture of a whole run.

    Args:
        dataset: A trajectory.
        robot: The robot that made it.
        path: The picture's file; the suffix chooses the format.
        along: Number of poses along the way, evenly spaced.

    Returns:
        The path.

    Raises:
        InvalidSettingError: The number of poses is out of range.
        ResultFileError: The trajectory cannot be shown with this robot, or the file cannot be written.
    """
    return save_figure(draw_mission(dataset, robot, along=along), path)


def draw_mission(dataset: xarray.Dataset, robot: Robot, *, along: int = 6) -> Figure:
    """Draw a whole run in one picture.

    Args:
        dataset: A trajectory.
        robot: The robot that made it.
        along: Number of poses along the way, evenly spaced.

    Returns:
        The figure.

    Raises:
        InvalidSettingError: The number of poses is out of range.
        ResultFileError: The trajectory cannot be shown with this robot.
    """
    if not 2 <= along <= 40:
        raise InvalidSettingError("along", along, "from 2 to 40 poses")
    stage = Stage(dataset, robot)
    instants = way_instants(dataset, along=along)
    poses = _side_by_side(stage, instants)
    corners = [stage.corners(pose) for pose in poses]
    everything = np.concatenate([*corners, stage.frames.com[[pose.sample for pose in poses]]])
    low, high = everything.min(axis=0), everything.max(axis=0)
    ground = stage.ground(float(low[0]) - _MARGIN, float(high[0]) + _MARGIN)
    seen = stage.camera.project(np.concatenate([everything, *(part.reshape(-1, 3) for part in ground.triangles())]))
    (left, bottom), (right, top) = seen.min(axis=0).tolist(), seen.max(axis=0).tolist()
    top += _ABOVE
    scale = min(_WIDTH / (right - left), _HIGHEST / (top - bottom))  # [inch/m]
    frame = Frame(left=left, right=right, bottom=bottom - _WORDS / scale, top=top)
    figure = new_figure(
        width=max(7.0, scale * (frame.right - frame.left)), height=scale * (frame.top - frame.bottom) + _TITLE_ROOM
    )
    axes = figure.add_subplot()
    stage.draw(axes, poses, frame, ground, resolution=scale * _DOTS_PER_INCH)
    first = next((order for order, pose in enumerate(poses) if pose.shift == 0.0), 0)
    way = stage.camera.project(stage.frames.com[instants[first].sample : instants[-1].sample + 1])
    axes.plot(way[:, 0], way[:, 1], color=COM_COLOUR, linewidth=1.1, linestyle=(0, (4, 2.5)), zorder=7)
    phase = ""
    for instant, pose, own in zip(instants, poses, corners, strict=True):
        _name(axes, stage, instant, pose, own, with_phase=instant.phase != phase)
        phase = instant.phase
    if first:
        _bracket(axes, stage, corners[:first])
    _legend(axes)
    slope = float(dataset.attrs.get("slope_deg", 0.0))
    way_words = f"up a {slope:g}° slope" if slope else "along the ground"
    title_figure(
        figure, f"{robot.name} {'stands up and drives' if first else 'drives'} {way_words}", run_subtitle(dataset)
    )
    return figure


def _side_by_side(stage: Stage, instants: Sequence[Instant]) -> list[Pose]:
    """Poses along the way where they were; those on the spot moved to the left, one beside the other."""
    poses: list[Pose] = []
    edge = np.inf  # left end of what is drawn so far
    for instant in reversed(instants):
        own = stage.corners(Pose(instant.sample))[:, 0]
        shift = float(edge - _GAP - own.max()) if instant.on_the_spot and np.isfinite(edge) else 0.0
        edge = min(edge, float(own.min()) + shift)
        poses.append(Pose(instant.sample, min(shift, 0.0)))
    return poses[::-1]


def _name(axes: Axes, stage: Stage, instant: Instant, pose: Pose, corners: Array, *, with_phase: bool) -> None:
    """Time and, where it is new, phase under a pose, at the near edge of the ground."""
    if instant.on_the_spot:
        middle = 0.5 * float(corners[:, 0].min() + corners[:, 0].max())
    else:
        middle = float(stage.axle[pose.sample, 0]) + pose.shift
    ground = stage.ground(middle - 0.01, middle + 0.01)
    (x0, z0), (x1, z1) = ground.profile[0], ground.profile[-1]
    steep = (z1 - z0) > 0.3 * (x1 - x0)
    place = stage.camera.project((middle, ground.near, z0 - ground.thickness))
    words = [f"{instant.time:.1f} s", *(textwrap.wrap(instant.phase, 15) if with_phase else [])]
    axes.annotate(
        "\n".join(words), xy=(float(place[0]), float(place[1])), xytext=(7, -3) if steep else (0, -6),
        textcoords="offset points", ha="left" if steep else "center", va="top", size=8, color=INK, linespacing=1.25,
        zorder=10,
    )  # fmt: skip


def _bracket(axes: Axes, stage: Stage, corners: Sequence[Array]) -> None:
    """Say which poses have been moved apart."""
    points = stage.camera.project(np.concatenate(corners))
    left, right = float(points[:, 0].min()), float(points[:, 0].max())
    height = float(points[:, 1].max()) + 0.1
    axes.plot([left, left, right, right], [height - 0.05, height, height, height - 0.05], color=COLOURS["slate"],
              linewidth=1.0, zorder=6)  # fmt: skip
    words = "on the spot, drawn side by side"
    axes.text(0.5 * (left + right), height + 0.03, words, ha="center", va="bottom", size=8.5, color=COLOURS["slate"])


def _legend(axes: Axes) -> None:
    legend = axes.legend(handles=force_legend(), loc="upper left", fontsize=9, frameon=False, handlelength=2.2)
    for text in legend.get_texts():
        text.set_color(INK)
    bar = f"forces: 20 N is {2000.0 * METRES_PER_NEWTON:.0f} cm   ·   tiles 25 cm"
    axes.text(0.995, 0.012, bar, transform=axes.transAxes, ha="right", va="bottom", size=8.5, color=COLOURS["slate"])
