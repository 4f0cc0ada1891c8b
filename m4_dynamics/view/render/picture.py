"""From solids to pixels: nearest surface, sunlight with shadows, dark outlines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from m4_dynamics.view.render.camera import Camera
from m4_dynamics.view.render.kernels import rasterise, shade
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
    pixel = 1.0 / (_FINE * resolution)
    rows = _FINE * round((frame.top - frame.bottom) * resolution)
    columns = _FINE * round((frame.right - frame.left) * resolution)
    surfaces = _surfaces(solids, ground)
    seen = camera.view(surfaces.corners)
    pixels = np.stack(
        [(seen[..., 0] - frame.left) / pixel, (frame.top - seen[..., 1]) / pixel, seen[..., 2]], axis=-1
    )  # fmt: skip
    depth, nearest = _depth_buffer(pixels, rows, columns)
    sun = Camera(_SUN)
    sun_depth, sun_low = _shadows(solids, sun)
    image = np.zeros((rows // _FINE, columns // _FINE, 4))
    shade(
        depth, nearest, frame.left, frame.top, pixel, camera.axes, surfaces.owner, surfaces.outlined, surfaces.colour,
        surfaces.normal, surfaces.tiling, _TILE, np.array(_DARK_TILE), sun.axes, sun_depth, sun_low, _SHADOW_PIXEL,
        _SHADOW_SLACK, _AMBIENT, _SUNLIGHT, _IN_SHADOW, _OUTLINE, _FINE, image,
    )  # fmt: skip
    return image


@dataclass(frozen=True, slots=True, eq=False)
class _Surfaces:
    """Everything in sight as triangles, with what `shade` wants to know of each."""

    corners: Array
    owner: NDArray[np.int64]
    outlined: NDArray[np.bool_]
    colour: Array
    normal: Array
    tiling: Array


def _surfaces(solids: Sequence[Solid], ground: GroundSlab | None) -> _Surfaces:
    corners = [solid.corners for solid in solids]
    colours = [np.tile(solid.colour, (len(solid.corners), 1)) for solid in solids]
    normals = [solid.normals for solid in solids]
    tilings = [np.zeros((len(solid.corners), 3)) for solid in solids]
    if ground is not None:
        surface, flank = ground.triangles()
        pieces = np.diff(ground.profile, axis=0)
        length = np.linalg.norm(pieces, axis=1)
        upward = np.column_stack([-pieces[:, 1], np.zeros(len(pieces)), pieces[:, 0]]) / length[:, None]
        # Tiles are counted from the world's origin, where slopes begin, so that they stay where they are.
        arc = np.concatenate([[0.0], np.cumsum(length)])
        arc -= np.interp(0.0, ground.profile[:, 0], arc)
        along = np.column_stack([ground.profile[:-1, 0], arc[:-1], length / pieces[:, 0]])
        corners += [surface, flank]
        colours += [np.tile(_LIGHT_TILE, (len(surface), 1)), np.tile(_FLANK, (len(flank), 1))]
        normals += [np.repeat(upward, 2, axis=0), np.tile((0.0, -1.0, 0.0), (len(flank), 1))]
        tilings += [np.repeat(along, 2, axis=0), np.zeros((len(flank), 3))]
    owner = np.repeat(np.arange(len(corners)), [len(group) for group in corners])
    none = np.empty((0, 3))
    return _Surfaces(
        corners=np.concatenate([np.empty((0, 3, 3)), *corners]),
        owner=owner,
        outlined=owner < len(solids),
        colour=np.concatenate([none, *colours]),
        normal=np.concatenate([none, *normals]),
        tiling=np.concatenate([none, *tilings]),
    )


def _depth_buffer(pixels: Array, rows: int, columns: int) -> tuple[Array, NDArray[np.int64]]:
    depth, nearest = np.full((rows, columns), np.inf), np.full((rows, columns), -1, dtype=np.int64)
    rasterise(np.ascontiguousarray(pixels), depth, nearest)
    return depth, nearest


def _shadows(solids: Sequence[Solid], sun: Camera) -> tuple[Array, Array]:
    """Depth of the solids as the sun sees them, rows upwards, and the place of its corner; empty without solids."""
    if not solids:
        return np.empty((0, 0)), np.zeros(2)
    corners = sun.view(np.concatenate([solid.corners for solid in solids]))
    low, high = corners[..., :2].min(axis=(0, 1)), corners[..., :2].max(axis=(0, 1))
    columns, rows = (np.ceil((high - low) / _SHADOW_PIXEL).astype(int) + 1).tolist()
    pixels = np.concatenate([(corners[..., :2] - low) / _SHADOW_PIXEL, corners[..., 2:]], axis=-1)
    return _depth_buffer(pixels, rows, columns)[0], np.asarray(low)
