"""Normals of a triangle mesh: round where its faces meet at a small angle, sharp where they meet at a large one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["crease_normals"]

_CREASE = np.deg2rad(38.0)


def crease_normals(
    vertices: NDArray[np.float64], triangles: NDArray[np.int64], crease: float = _CREASE
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Split a mesh along its edges so that each vertex has one normal.

    Args:
        vertices: Points, shape (n, 3) [m].
        triangles: Indices of points, shape (m, 3).
        crease: Faces that differ by less are smoothed into each other [rad].

    Returns:
        Vertices, shape (k, 3), their unit normals, shape (k, 3), and the triangles' indices into them, shape (m, 3).
    """
    corners = vertices[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])  # normals, twice the area long
    unit = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-15)
    # Vertices of equal position are one, whatever the file says.
    _, point = np.unique(np.round(vertices / 1e-6).astype(np.int64), axis=0, return_inverse=True)
    point_of_corner = point.reshape(-1)[triangles].ravel()
    face_of_corner = np.repeat(np.arange(len(triangles)), 3)
    order = np.argsort(point_of_corner, kind="stable")
    ends = np.cumsum(np.bincount(point_of_corner))
    normals = np.empty((len(face_of_corner), 3))
    cosine = np.cos(crease)
    for start, end in zip(np.concatenate([[0], ends[:-1]]), ends, strict=True):
        group = order[start:end]  # the corners that meet in one point
        faces = face_of_corner[group]
        near = unit[faces] @ unit[faces].T > cosine
        normals[group] = near.astype(float) @ areas[faces]
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)
    keys = np.column_stack([point_of_corner, np.round(normals * 1e3).astype(np.int64)])
    _, first, index = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return vertices[triangles.ravel()[first]], normals[first], index.reshape(-1, 3)
