"""The depth buffer: which triangle is nearest in each pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

__all__ = ["rasterise"]


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
