"""From solids to pixels: nearest surface, sunlight with shadows, dark outlines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from m4_dynamics.view.render.camera import Camera
from m4_dynamics.view.render.kernels import rasterise
from m4_dynamics.view.render.solids import GroundSlab, Solid

__all__ = ["Frame", "draw_picture", "render_picture"]

Array = NDArray[np.float64]

_SUN = (-0.45, -0.62, 1.0)  # towards it
_AMBIENT, _SUNLIGHT = 0.58, 0.50
_IN_SHADOW = 0.30  # share of the sunlight that still comes in, from the sky
_TILE = 0.25  # [m]
_LIGHT_TILE, _DARK_TILE, _FLANK = (0.90, 0.915, 0.93), (0.79, 0.815, 0.84), (0.62, 0.67, 0.71)
_OUTLINE = 0.32  # brightness of an outline
_FINE = 2  # pixels in place of one, averaged in the end
_SHADOW_PIXEL = 0.004  # [m]
_TAPS = ((-1.0, -1.0), (1.0, -1.0), (0.0, 0.0), (-1.0, 1.0), (1.0, 1.0))  # [shadow pixel], for a soft edge
_SHADOW_SLACK = 0.012  # [m] a surface this far behind the first one that the sun meets is still lit


@dataclass(frozen=True, slots=True)
class Frame:
    """A rectangle in the camera's plane.

    Attributes:
        left, right, bottom, top: Its edges [m].
    """

    left: float
    right: float
    bottom: float
    top: float


def draw_picture(
    axes: Axes, solids: Sequence[Solid], ground: GroundSlab | None, camera: Camera, frame: Frame, *, resolution: float
) -> None:
    """Show a rendered picture in axes whose coordinates become metres in the camera's plane.

    Args:
        axes: The axes; lines and words drawn into them lie over the picture.
        solids: What is shown.
        ground: What it stands on, or None.
        camera: The camera.
        frame: What is in sight.
        resolution: Pixels per metre.
    """
    image = render_picture(solids, ground, camera, frame, resolution=resolution)
    axes.imshow(image, extent=(frame.left, frame.right, frame.bottom, frame.top), interpolation="antialiased", zorder=1)
    axes.set(xlim=(frame.left, frame.right), ylim=(frame.bottom, frame.top))
    axes.set_aspect("equal", adjustable="box")
    axes.set_axis_off()


def render_picture(
    solids: Sequence[Solid], ground: GroundSlab | None, camera: Camera, frame: Frame, *, resolution: float
) -> Array:
    """Render solids and ground.

    Args:
        solids: What is shown.
        ground: What it stands on, or None.
        camera: The camera.
        frame: What is in sight.
        resolution: Pixels per metre.

    Returns:
        RGBA in [0, 1], shape (rows, columns, 4), the upper row first; transparent where there is nothing.
    """
    fine = _FINE * resolution
    rows = _FINE * round((frame.top - frame.bottom) * resolution)
    columns = _FINE * round((frame.right - frame.left) * resolution)
    groups = [solid.corners for solid in solids]
    bodies = sum(len(corners) for corners in groups)
    if ground is not None:
        surface, flank = ground.triangles()
        groups += [surface, flank]
    corners = np.concatenate(groups) if groups else np.empty((0, 3, 3))
    owner = np.repeat(np.arange(len(groups)), [len(group) for group in groups])

    seen = camera.view(corners)
    pixels = np.stack([(seen[..., 0] - frame.left) * fine, (frame.top - seen[..., 1]) * fine, seen[..., 2]], axis=-1)
    depth, nearest = np.full((rows, columns), np.inf), np.full((rows, columns), -1, dtype=np.int64)
    rasterise(np.ascontiguousarray(pixels), depth, nearest)

    row, column = np.nonzero(nearest >= 0)
    triangle = nearest[row, column]
    place = camera.world(
        np.column_stack(
            [frame.left + (column + 0.5) / fine, frame.top - (row + 0.5) / fine, depth[row, column]]
        )
    )  # fmt: skip
    albedo, normal = _surfaces(solids, ground, triangle, bodies, place)
    sun = np.array(_SUN) / np.linalg.norm(_SUN)
    sunlight = np.clip(normal @ sun, 0.0, 1.0) * _share_of_sun(solids, place)
    image = np.zeros((rows, columns, 4))
    image[row, column, :3] = np.clip(albedo * (_AMBIENT + _SUNLIGHT * sunlight)[:, None], 0.0, 1.0)
    image[row, column, 3] = 1.0
    _draw_outlines(image, np.where(nearest >= 0, owner[nearest], -1), len(solids), depth)
    return _average(image)


def _surfaces(
    solids: Sequence[Solid], ground: GroundSlab | None, triangle: NDArray[np.int64], bodies: int, place: Array
) -> tuple[Array, Array]:
    """Colour and normal of the surface in each pixel that shows one."""
    count = len(triangle)
    albedo: Array = np.empty((count, 3))
    normal: Array = np.empty((count, 3))
    on_body = triangle < bodies
    if bodies:
        colours = np.concatenate([np.tile(solid.colour, (len(solid.corners), 1)) for solid in solids])
        normals = np.concatenate([solid.normals for solid in solids])
        albedo[on_body], normal[on_body] = colours[triangle[on_body]], normals[triangle[on_body]]
    if ground is not None:
        pieces = np.diff(ground.profile, axis=0)
        length = np.linalg.norm(pieces, axis=1)
        upward = np.column_stack([-pieces[:, 1], np.zeros(len(pieces)), pieces[:, 0]]) / length[:, None]
        below = ~on_body
        rank = triangle[below] - bodies
        on_top = rank < 2 * len(pieces)
        arc = np.concatenate([[0.0], np.cumsum(length)])
        # Tiles are counted from the world's origin, where slopes begin, so that they stay where they are.
        origin = np.interp(0.0, ground.profile[:, 0], arc)
        along = np.interp(place[below, 0], ground.profile[:, 0], arc) - origin
        dark = (np.floor(along / _TILE) + np.floor(place[below, 1] / _TILE)) % 2 == 1
        colour = np.where(dark[:, None], _DARK_TILE, _LIGHT_TILE)
        albedo[below] = np.where(on_top[:, None], colour, _FLANK)
        normal[below] = np.where(on_top[:, None], upward[rank % (2 * len(pieces)) // 2], (0.0, -1.0, 0.0))
    return albedo, normal


def _share_of_sun(solids: Sequence[Solid], place: Array) -> Array:
    """How much of the sun each point gets: 1 in the light, less in the shadow of a solid, in between at its edge."""
    if not solids or not len(place):
        return np.ones(len(place))
    sun = Camera(_SUN)
    corners = sun.view(np.concatenate([solid.corners for solid in solids]))
    low, high = corners[..., :2].min(axis=(0, 1)), corners[..., :2].max(axis=(0, 1))
    columns, rows = (np.ceil((high - low) / _SHADOW_PIXEL).astype(int) + 1).tolist()
    depth, nearest = np.full((rows, columns), np.inf), np.full((rows, columns), -1, dtype=np.int64)
    pixels = np.concatenate([(corners[..., :2] - low) / _SHADOW_PIXEL, corners[..., 2:]], axis=-1)
    rasterise(np.ascontiguousarray(pixels), depth, nearest)
    points = sun.view(place)
    share = np.ones(len(place))
    margin = 2.0 * _SHADOW_PIXEL
    near = np.flatnonzero(((points[:, :2] > low - margin) & (points[:, :2] < high + margin)).all(axis=1))
    column, row = ((points[near, :2] - low) / _SHADOW_PIXEL).T
    lit = np.zeros(len(near))
    for step_column, step_row in _TAPS:
        i, j = np.floor(row + step_row).astype(int), np.floor(column + step_column).astype(int)
        inside = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
        first = np.full(len(near), np.inf)
        first[inside] = depth[i[inside], j[inside]]
        lit += points[near, 2] < first + _SHADOW_SLACK
    share[near] = _IN_SHADOW + (1.0 - _IN_SHADOW) * lit / len(_TAPS)
    return share


def _draw_outlines(image: Array, owner: NDArray[np.int64], solids: int, depth: Array) -> None:
    """Darken the pixels of a solid beside another solid that is farther away, or beside none."""
    edge = np.zeros(owner.shape, dtype=bool)
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        other, behind = np.roll(owner, step, axis=axis), np.roll(depth, step, axis=axis)
        edge |= (other != owner) & (depth <= behind)
    edge &= (owner >= 0) & (owner < solids)
    image[edge, :3] *= _OUTLINE


def _average(image: Array) -> Array:
    """Blocks of fine pixels become one; colours are weighted with their coverage."""
    rows, columns = image.shape[0] // _FINE, image.shape[1] // _FINE
    blocks = image.reshape(rows, _FINE, columns, _FINE, 4)
    alpha = blocks[..., 3].mean(axis=(1, 3))
    colour = (blocks[..., :3] * blocks[..., 3:]).mean(axis=(1, 3))
    result = np.zeros((rows, columns, 4))
    np.divide(colour, alpha[..., None], out=result[..., :3], where=alpha[..., None] > 0.0)
    result[..., 3] = alpha
    return result
