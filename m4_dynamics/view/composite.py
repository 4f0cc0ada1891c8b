"""One picture of a whole climb: the robot from the side at several instants, with the forces that carry it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Polygon
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.frames import sample_frames
from m4_dynamics.view.ground import clip_profile
from m4_dynamics.view.scene import COM_COLOUR, CONTACT_COLOUR, THRUST_COLOUR
from m4_dynamics.view.silhouette import Outline, outlines_at
from m4_dynamics.view.style import COLOURS, INK, new_figure, run_subtitle, save_figure, title_figure

__all__ = ["draw_climb", "write_climb_picture"]

_LARGEST = (11.0, 8.6)  # width and height of the scene at most [inch]
_TITLE_ROOM = 0.7  # [inch]
_FRAME_RATE = 50.0  # [1/s] at which the trajectory is searched for the instants
_METRES_PER_NEWTON = 0.009
_CONE_LENGTH = 0.34  # [m]
_PALEST = 0.62  # how far the first pose fades into the background
_LABEL: dict[str, Any] = {"color": INK, "size": 10, "ha": "center", "va": "center", "zorder": 1000}
_GROUND, _GROUND_LINE = "#E4E8EC", "#7A8792"


def write_climb_picture(dataset: xarray.Dataset, robot: Robot, path: Path | str, *, poses: int = 5) -> Path:
    """Write a picture of a climb seen from the side.

    Args:
        dataset: A trajectory.
        robot: The robot that made it.
        path: The picture's file; the suffix chooses the format.
        poses: Number of instants shown, evenly spaced along the way.

    Returns:
        The path.

    Raises:
        InvalidSettingError: Fewer than two poses.
        ResultFileError: The trajectory cannot be shown with this robot, or the file cannot be written.
    """
    return save_figure(draw_climb(dataset, robot, poses=poses), path)


def draw_climb(dataset: xarray.Dataset, robot: Robot, *, poses: int = 5) -> Figure:
    """Draw a climb seen from the side: x to the right, z up.

    Args:
        dataset: A trajectory.
        robot: The robot that made it.
        poses: Number of instants shown, evenly spaced along the way.

    Returns:
        The figure.

    Raises:
        InvalidSettingError: Fewer than two poses.
        ResultFileError: The trajectory cannot be shown with this robot.
    """
    if not 2 <= poses <= 50:
        raise InvalidSettingError("poses", poses, "from 2 to 50")
    frames = sample_frames(dataset, robot, frames_per_second=_FRAME_RATE)
    shown = _evenly_along_the_way(frames.com, poses)
    outlines = [outlines_at(robot, frames.configuration[index]) for index in shown]
    corners = np.vstack([polygon for pose in outlines for outline in pose for polygon in outline.polygons])
    low, high = corners.min(axis=0) - np.array([0.3, 0.28]), corners.max(axis=0) + np.array([0.3, 0.1])
    profile = clip_profile(dataset["terrain_x"].values, dataset["terrain_z"].values, low=low[0] - 1, high=high[0] + 1)
    size = (high - low) * min(_LARGEST[0] / (high[0] - low[0]), _LARGEST[1] / (high[1] - low[1]))
    figure = new_figure(width=max(6.0, float(size[0])), height=float(size[1]) + _TITLE_ROOM)
    axes = figure.add_subplot()
    axes.set_aspect("equal", adjustable="box")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.set_axis_off()
    _draw_ground(axes, profile, low[1])
    axes.plot(frames.com[:, 0], frames.com[:, 2], color=COM_COLOUR, linewidth=1.2, linestyle=(0, (4, 2.5)), zorder=3)

    friction = dataset.attrs.get("friction_static")
    contact = _resultant(frames.contact_position, frames.contact_force)
    thrust = _resultant(frames.thrust_position, frames.thrust_force)
    for order, index in enumerate(shown):
        fade = _PALEST * (1.0 - order / (len(shown) - 1)) ** 0.8
        layer = 10.0 * (order + 1)
        _draw_pose(axes, outlines[order], fade, layer)
        place = contact[0][index]
        touching = bool(np.isfinite(place).all())
        below = place if touching else _ground_below(profile, float(frames.com[index, 0]))
        normal = _normal_at(profile, float(below[0]))
        axes.text(*_pair(below - 0.12 * normal), f"{frames.time[index]:.1f} s", **_LABEL)
        if touching and friction is not None:
            _draw_cone(axes, place, normal, float(friction), layer + 6.0, fade)
        _draw_arrow(axes, place, contact[1][index], CONTACT_COLOUR, layer + 8.0, fade)
        _draw_arrow(axes, thrust[0][index], thrust[1][index], THRUST_COLOUR, layer + 8.0, fade)
        com = frames.com[index, [0, 2]]
        axes.plot(*com, "o", color=_faded(COM_COLOUR, fade), markeredgecolor="white", markersize=7, zorder=layer + 9.0)
    _draw_legend(axes, friction)
    slope = dataset.attrs.get("slope_deg")
    title = robot.name if slope is None else f"{robot.name} on a {float(slope):g}° slope"
    title_figure(figure, title, run_subtitle(dataset))
    return figure


def _evenly_along_the_way(com: NDArray[np.float64], count: int) -> list[int]:
    """Frames evenly spaced along the line from the first place to the last; in time for a robot that stays."""
    span = com[-1] - com[0]
    if np.linalg.norm(span) < 0.2:
        return [round(share * (len(com) - 1)) for share in np.linspace(0.0, 1.0, count)]
    # A sway backwards is no progress: the farthest place so far counts.
    progress = np.maximum.accumulate((com - com[0]) @ span / (span @ span))
    return [int(np.searchsorted(progress, share)) for share in np.linspace(0.0, 1.0, count)[:-1]] + [len(com) - 1]


def _resultant(
    positions: dict[str, NDArray[np.float64]], forces: dict[str, NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sum of forces in the plane of the picture and the mean of their points, weighted by the forces' sizes.

    Args:
        positions: Name -> points, shape (n, 3) [m]; NaN where a force has none.
        forces: The same names -> forces, shape (n, 3) [N].

    Returns:
        Points (x, z), NaN where no force acts, and forces (x, z), each of shape (n, 2).
    """
    points = np.stack([positions[name] for name in forces])[:, :, [0, 2]]
    vectors = np.stack(list(forces.values()))[:, :, [0, 2]]
    acting = np.isfinite(points).all(axis=2) & np.isfinite(vectors).all(axis=2)
    weight = np.where(acting, np.linalg.norm(np.nan_to_num(vectors), axis=2), 0.0)[:, :, None]
    total = weight.sum(axis=0)
    mean: NDArray[np.float64] = np.full(points.shape[1:], np.nan)
    np.divide((weight * np.nan_to_num(points)).sum(axis=0), total, out=mean, where=total > 1e-6)
    return mean, np.where(np.expand_dims(acting, 2), np.nan_to_num(vectors), 0.0).sum(axis=0)


def _normal_at(profile: NDArray[np.float64], x: float) -> NDArray[np.float64]:
    """Unit normal (x, z) out of the ground at a horizontal position."""
    piece = int(np.clip(np.searchsorted(profile[:, 0], x) - 1, 0, len(profile) - 2))
    step = profile[piece + 1] - profile[piece]
    return np.asarray(np.array([-step[1], step[0]]) / np.linalg.norm(step))


def _ground_below(profile: NDArray[np.float64], x: float) -> NDArray[np.float64]:
    return np.array([x, np.interp(x, profile[:, 0], profile[:, 1])])


def _pair(place: NDArray[np.float64]) -> tuple[float, float]:
    return float(place[0]), float(place[1])


def _faded(colour: str, fade: float) -> str:
    """A colour mixed with white."""
    red, green, blue = ((1.0 - fade) * channel + fade for channel in to_rgb(colour))
    return str(to_hex((red, green, blue)))


def _draw_ground(axes: Axes, profile: NDArray[np.float64], bottom: float) -> None:
    """Filled ground with a mark every half metre along it."""
    deep = min(bottom, float(profile[:, 1].min())) - 5.0
    outline = np.vstack([profile, [profile[-1, 0], deep], [profile[0, 0], deep]])
    axes.add_patch(Polygon(outline, closed=True, facecolor=_GROUND, edgecolor="none", zorder=0))
    axes.plot(profile[:, 0], profile[:, 1], color=_GROUND_LINE, linewidth=2.0, solid_capstyle="round", zorder=1)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    for distance in np.arange(0.5, arc[-1], 0.5):
        place = np.array([np.interp(distance, arc, profile[:, axis]) for axis in range(2)])
        end = place - 0.05 * _normal_at(profile, float(place[0]))
        axes.plot([place[0], end[0]], [place[1], end[1]], color=_GROUND_LINE, linewidth=1.2, zorder=1)


def _draw_pose(axes: Axes, outlines: list[Outline], fade: float, layer: float) -> None:
    """The robot's bodies, painted from far to near."""
    for order, outline in enumerate(outlines):
        face = _faded(outline.colour, fade)
        red, green, blue = (0.55 * channel for channel in to_rgb(outline.colour))
        edge = _faded(str(to_hex((red, green, blue))), fade)
        single = len(outline.polygons) == 1
        bodies = PolyCollection(
            outline.polygons,
            facecolors=face,
            edgecolors=edge if single else face,
            linewidths=0.6,
            zorder=layer + 5.0 * order / len(outlines),
        )
        axes.add_collection(bodies)


def _draw_cone(
    axes: Axes, place: NDArray[np.float64], normal: NDArray[np.float64], friction: float, layer: float, fade: float
) -> None:
    """The friction cone at a contact: a force inside it does not make the wheel slip."""
    along = np.array([normal[1], -normal[0]])
    angles = np.linspace(-np.arctan(friction), np.arctan(friction), 25)
    rim = place + _CONE_LENGTH * (np.outer(np.cos(angles), normal) + np.outer(np.sin(angles), along))
    colour = _faded(CONTACT_COLOUR, fade)
    axes.add_patch(Polygon(np.vstack([place, rim]), facecolor=colour, alpha=0.22, edgecolor="none", zorder=layer))
    for edge in (rim[0], rim[-1]):
        axes.plot([place[0], edge[0]], [place[1], edge[1]], color=colour, linewidth=0.8, zorder=layer)


def _draw_arrow(
    axes: Axes, place: NDArray[np.float64], force: NDArray[np.float64], colour: str, layer: float, fade: float
) -> None:
    """A force from its point of application."""
    if not np.isfinite(place).all() or np.linalg.norm(force) * _METRES_PER_NEWTON < 0.02:
        return
    tip = place + _METRES_PER_NEWTON * force
    style = "-|>,head_length=5,head_width=2.8"
    arrow = FancyArrowPatch(
        _pair(place), _pair(tip), arrowstyle=style, shrinkA=0, shrinkB=0, linewidth=2.4, zorder=layer
    )
    arrow.set_color(_faded(colour, 0.8 * fade))
    axes.add_patch(arrow)


def _draw_legend(axes: Axes, friction: object) -> None:
    """What the colours mean, and the scale of forces and lengths."""
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=THRUST_COLOUR, linewidth=2.4, marker=">", markersize=7, label="thrust"),
        Line2D([], [], color=CONTACT_COLOUR, linewidth=2.4, marker=">", markersize=7, label="ground on the wheels"),
    ]
    if friction is not None:
        handles.append(Patch(facecolor=CONTACT_COLOUR, alpha=0.25, label="friction cone"))
    handles.append(Line2D([], [], color=COM_COLOUR, linestyle=(0, (4, 2.5)), marker="o", label="centre of mass"))
    legend = axes.legend(handles=handles, loc="upper left", fontsize=10, frameon=False, handlelength=2.6)
    for text in legend.get_texts():
        text.set_color(INK)
    newtons = 20.0
    bar = f"forces: {newtons:g} N is {100.0 * newtons * _METRES_PER_NEWTON:.0f} cm   ·   ground marked every 0.5 m"
    axes.text(0.995, 0.012, bar, transform=axes.transAxes, ha="right", va="bottom", size=9, color=COLOURS["slate"])
