"""The ground in the scene: the terrain's profile extruded sideways, tiled so that the eye sees motion over it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.view.three import Command, Material, Shape, mesh, set_object, set_property

__all__ = ["TILE_LENGTH", "clip_profile", "ground_commands", "tile_profile"]

ROOT = "/ground"
TILE_LENGTH = 0.25  # [m] along the profile and across it
_LIGHT, _DARK, _FLANK = (0.83, 0.845, 0.86), (0.70, 0.73, 0.76), "#A9B3BC"
_THICKNESS = 0.08  # [m] of the slab drawn below the profile


def clip_profile(x: ArrayLike, z: ArrayLike, *, low: float, high: float) -> NDArray[np.float64]:
    """The part of a polyline between two horizontal positions.

    Args:
        x: Horizontal positions of its corners, increasing, shape (n,) [m].
        z: Their heights, shape (n,) [m].
        low: Start of the part [m].
        high: End of the part [m].

    Returns:
        Corners of the part, cut points included, shape (k, 2) [m]; it ends where the polyline ends.

    Raises:
        InvalidSettingError: The profile is no polyline with increasing x.
    """
    horizontal, height = np.asarray(x, dtype=float), np.asarray(z, dtype=float)
    if horizontal.ndim != 1 or horizontal.shape != height.shape or len(horizontal) < 2:
        raise InvalidSettingError("terrain profile", (horizontal.shape, height.shape), "two or more corners (x, z)")
    if not (np.diff(horizontal) > 0.0).all():
        raise InvalidSettingError("terrain profile", horizontal.tolist(), "x increasing from corner to corner")
    start, end = max(low, float(horizontal[0])), min(high, float(horizontal[-1]))
    inside = horizontal[(horizontal > start) & (horizontal < end)]
    places = np.array([start, *inside, end]) if end > start else horizontal
    return np.column_stack([places, np.interp(places, horizontal, height)])


def ground_commands(profile: NDArray[np.float64], *, half_width: float = 0.75) -> list[Command]:
    """Commands that build the ground.

    Args:
        profile: Corners (x, z) of the terrain, shape (n, 2) [m].
        half_width: Half of its width across the direction of travel [m].

    Returns:
        The commands: a chequered surface and the slab that carries it.
    """
    surface = set_object(f"{ROOT}/surface", _chequered(profile, half_width), Material(vertex_colours=True, flat=True))
    slab = set_object(f"{ROOT}/slab", _slab(profile, half_width), Material(colour=_FLANK, flat=True))
    # It throws no shadow, least of all on itself.
    return [
        surface,
        slab,
        *(set_property(f"{ROOT}/{one}/<object>", "castShadow", False) for one in ("surface", "slab")),
    ]


def tile_profile(
    profile: NDArray[np.float64], tile: float = TILE_LENGTH
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Cut a profile into tiles of equal length along its path, and at its corners.

    Args:
        profile: Corners (x, z), shape (n, 2) [m].
        tile: Length of a tile [m].

    Returns:
        Cut points (x, z), shape (k + 1, 2) [m], and the number of the tile that each of the k pieces belongs to.
    """
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    regular = np.arange(0.0, arc[-1], tile)
    cuts = np.unique(np.concatenate([arc, regular]).round(9))
    points = np.column_stack([np.interp(cuts, arc, profile[:, axis]) for axis in range(2)])
    middles = 0.5 * (cuts[1:] + cuts[:-1])
    return points, np.floor(middles / tile).astype(np.int64)


def _chequered(profile: NDArray[np.float64], half_width: float) -> Shape:
    """The surface: squares in two tones, each with corners of its own so that the tones don't blend."""
    points, tiles = tile_profile(profile)
    across = np.arange(-half_width, half_width + 1e-9, TILE_LENGTH)
    vertices: list[tuple[float, float, float]] = []
    colours: list[tuple[float, float, float]] = []
    triangles: list[tuple[int, int, int]] = []
    for piece, tile in enumerate(tiles):
        (x0, z0), (x1, z1) = points[piece], points[piece + 1]
        for lane in range(len(across) - 1):
            y0, y1 = across[lane], across[lane + 1]
            first = len(vertices)
            vertices += [(x0, y0, z0), (x1, y0, z1), (x1, y1, z1), (x0, y1, z0)]
            colours += [_LIGHT if (tile + lane) % 2 == 0 else _DARK] * 4
            triangles += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return mesh(vertices, triangles, colours)


def _slab(profile: NDArray[np.float64], half_width: float) -> Shape:
    """The flanks, the ends and the underside, a little below the surface."""
    top = np.array(profile)
    steps = np.diff(top, axis=0)
    normals = np.column_stack([-steps[:, 1], steps[:, 0]]) / np.linalg.norm(steps, axis=1)[:, None]
    at_corner = np.vstack([normals[:1], 0.5 * (normals[1:] + normals[:-1]), normals[-1:]])
    bottom = top - _THICKNESS * at_corner
    top = top - 1e-3 * at_corner
    count = len(top)
    vertices: list[tuple[float, float, float]] = []
    for side in (-half_width, half_width):
        vertices += [(float(x), side, float(z)) for x, z in np.vstack([top, bottom])]
    triangles: list[tuple[int, int, int]] = []

    def quad(a: int, b: int, c: int, d: int) -> None:
        triangles.extend([(a, b, c), (a, c, d)])

    far = 2 * count
    for index in range(count - 1):
        quad(count + index, count + index + 1, index + 1, index)  # flank at -y
        quad(far + index, far + index + 1, far + count + index + 1, far + count + index)  # flank at +y
        quad(far + count + index, far + count + index + 1, count + index + 1, count + index)  # underside
    quad(count, 0, far, far + count)
    last = count - 1
    quad(far + count + last, far + last, last, count + last)
    return mesh(vertices, triangles)
