"""Loops over pixels: which triangle is nearest, and how bright it is there."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

__all__ = ["rasterise", "shade"]


@njit(cache=True)
def rasterise(corners: Any, depth: Any, nearest: Any) -> None:
    """Draw triangles into a depth buffer; a triangle seen edge-on covers nothing.

    Args:
        corners: Triangles, shape (n, 3, 3): column and row in pixels (the centre of pixel (i, j) at i + 0.5, j + 0.5),
            depth away from the viewer.
        depth: Depth of what is nearest, shape (rows, columns); infinite where nothing is yet.
        nearest: Number of the nearest triangle, shape (rows, columns); -1 where nothing is yet.
    """
    rows, columns = depth.shape
    for triangle in range(corners.shape[0]):
        ax, ay, az = corners[triangle, 0]
        bx, by, bz = corners[triangle, 1]
        cx, cy, cz = corners[triangle, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-12:
            continue
        first_column = max(0, int(np.ceil(min(ax, bx, cx) - 0.5)))
        last_column = min(columns - 1, int(np.floor(max(ax, bx, cx) - 0.5)))
        first_row = max(0, int(np.ceil(min(ay, by, cy) - 0.5)))
        last_row = min(rows - 1, int(np.floor(max(ay, by, cy) - 0.5)))
        for row in range(first_row, last_row + 1):
            y = row + 0.5
            for column in range(first_column, last_column + 1):
                x = column + 0.5
                # Barycentric coordinates; all of one sign inside, whichever way round the corners go.
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                z = u * az + v * bz + w * cz
                if z < depth[row, column]:
                    depth[row, column] = z
                    nearest[row, column] = triangle


@njit(cache=True)
def shade(
    depth: Any, nearest: Any, left: float, top: float, pixel: float, camera: Any, owner: Any, outlined: Any,
    colour: Any, normal: Any, tiling: Any, tile: float, dark_tile: Any, sun: Any, sun_depth: Any, sun_low: Any,
    sun_pixel: float, sun_slack: float, ambient: float, sunlight: float, in_shadow: float, outline: float, fine: int,
    image: Any,
) -> None:  # fmt: skip
    """Colour what a depth buffer shows, `fine` x `fine` pixels of it for one of the picture.

    Args:
        depth, nearest: From `rasterise`.
        left, top: Place of the depth buffer's corner in the camera's plane [m].
        pixel: Size of its pixels [m].
        camera: Right, up and away in the world, shape (3, 3).
        owner: Body that each triangle belongs to, shape (n,).
        outlined: Whether the triangle's body has an outline, shape (n,).
        colour: Of each triangle, shape (n, 3).
        normal: Unit normal of each triangle, shape (n, 3).
        tiling: Of each triangle x of its start [m], arc length there [m], arc length per x; the last is 0 for what has
            no tiles, shape (n, 3).
        tile: Side of a tile [m].
        dark_tile: Colour of every other tile, shape (3,).
        sun: Right, up and away as seen from the sun; shape (3, 3).
        sun_depth: Depth buffer of the bodies that throw shadows, rows upwards; without pixels nothing throws one.
        sun_low: Place of its corner in the sun's plane, shape (2,) [m].
        sun_pixel: Size of its pixels [m].
        sun_slack: A point this far behind the first one that the sun meets is still lit [m].
        ambient: Brightness without sun.
        sunlight: Brightness that the sun adds where it stands at right angles.
        in_shadow: Share of it that is left in a shadow.
        outline: Brightness of an outline.
        fine: Pixels of the depth buffer along one of the picture.
        image: RGBA to be filled, zero before, shape (rows / fine, columns / fine, 4).
    """
    rows, columns = depth.shape
    sun_rows, sun_columns = sun_depth.shape
    for row in range(rows):
        for column in range(columns):
            triangle = nearest[row, column]
            if triangle < 0:
                continue
            right, up, away = left + (column + 0.5) * pixel, top - (row + 0.5) * pixel, depth[row, column]
            x = right * camera[0, 0] + up * camera[1, 0] + away * camera[2, 0]
            y = right * camera[0, 1] + up * camera[1, 1] + away * camera[2, 1]
            z = right * camera[0, 2] + up * camera[1, 2] + away * camera[2, 2]
            facing = 0.0
            for axis in range(3):
                facing -= normal[triangle, axis] * sun[2, axis]
            light = max(0.0, facing)
            if light > 0.0 and sun_rows > 0:
                sun_column = (x * sun[0, 0] + y * sun[0, 1] + z * sun[0, 2] - sun_low[0]) / sun_pixel
                sun_row = (x * sun[1, 0] + y * sun[1, 1] + z * sun[1, 2] - sun_low[1]) / sun_pixel
                sun_away = x * sun[2, 0] + y * sun[2, 1] + z * sun[2, 2]
                lit = 0
                for step in range(5):  # the middle and four corners around it, for a soft edge
                    offset_row = 0.0 if step == 0 else (1.0 if step > 2 else -1.0)
                    offset_column = 0.0 if step == 0 else (1.0 if step % 2 == 0 else -1.0)
                    i, j = int(np.floor(sun_row + offset_row)), int(np.floor(sun_column + offset_column))
                    inside = 0 <= i < sun_rows and 0 <= j < sun_columns
                    if not inside or sun_away < sun_depth[i, j] + sun_slack:
                        lit += 1
                light *= in_shadow + (1.0 - in_shadow) * lit / 5.0
            brightness = ambient + sunlight * light
            if outlined[triangle]:
                # Beside another body that is farther away, or beside nothing.
                for side in range(4):
                    i = row + (1 if side == 0 else (-1 if side == 1 else 0))
                    j = column + (1 if side == 2 else (-1 if side == 3 else 0))
                    if 0 <= i < rows and 0 <= j < columns and depth[i, j] >= depth[row, column]:
                        other = nearest[i, j]
                        if other < 0 or owner[other] != owner[triangle]:
                            brightness *= outline
                            break
            along = tiling[triangle, 1] + (x - tiling[triangle, 0]) * tiling[triangle, 2]
            dark = tiling[triangle, 2] > 0.0 and (np.floor(along / tile) + np.floor(y / tile)) % 2 == 1
            for channel in range(3):
                surface = dark_tile[channel] if dark else colour[triangle, channel]
                image[row // fine, column // fine, channel] += min(1.0, max(0.0, surface * brightness))
            image[row // fine, column // fine, 3] += 1.0
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            covered = image[row, column, 3]
            if covered > 0.0:
                for channel in range(3):
                    image[row, column, channel] /= covered
                image[row, column, 3] = covered / (fine * fine)
