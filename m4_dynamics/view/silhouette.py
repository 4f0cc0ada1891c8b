"""Outlines of bodies seen from the side: x to the right, z up, the viewer at negative y."""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.bodies import hex_colour, mesh_arrays

__all__ = ["Outline", "outlines_at", "surface_points"]

_AROUND = 48  # points on a circle


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """One body's silhouette.

    Attributes:
        polygons: Closed outlines (x, z), each of shape (k, 2) [m]; a mesh that isn't convex gives one per triangle.
        depth: Position across the view of the body's nearest point [m]; larger is farther from the viewer.
        colour: sRGB hex.
    """

    polygons: list[NDArray[np.float64]]
    depth: float
    colour: str


def outlines_at(robot: Robot, configuration: NDArray[np.float64]) -> list[Outline]:
    """Silhouettes of all visual bodies, farthest first.

    Args:
        robot: The robot.
        configuration: Its configuration, shape (nq,).

    Returns:
        The outlines in the order in which a painter lays them down.
    """
    data, visual_data = robot.model.createData(), robot.visual_model.createData()
    pin.forwardKinematics(robot.model, data, configuration)
    pin.updateGeometryPlacements(robot.model, data, robot.visual_model, visual_data)
    outlines = []
    for geometry, placement in zip(robot.visual_model.geometryObjects, visual_data.oMg, strict=True):
        local = surface_points(geometry.geometry)
        if local is None:
            continue
        points = local @ np.asarray(placement.rotation).T + np.asarray(placement.translation)
        flat = points[:, [0, 2]]
        arrays = mesh_arrays(geometry.geometry) if isinstance(geometry.geometry, coal.BVHModelBase) else None
        polygons = [_hull(flat)] if arrays is None else [flat[corners] for corners in arrays[1]]
        outlines.append(Outline(polygons, float(points[:, 1].min()), hex_colour(geometry.meshColor)))
    # Bodies of equal depth keep their order, whatever the last digits say.
    return sorted(outlines, key=lambda outline: -round(outline.depth, 4))


def surface_points(geometry: coal.CollisionGeometry) -> NDArray[np.float64] | None:
    """Points whose hull is a body: corners of polyhedra, a dense sample of round ones.

    Args:
        geometry: A primitive, a convex body or a triangle mesh.

    Returns:
        Points in the geometry's frame, shape (n, 3) [m], or None for what has no finite surface.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(_AROUND)])
    up = np.array([0.0, 0.0, 1.0])
    if isinstance(geometry, coal.Box):
        corners = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, -1).T
        return np.asarray(corners * np.asarray(geometry.halfSide))
    if isinstance(geometry, coal.Sphere):
        return np.asarray(_ball() * geometry.radius)
    if isinstance(geometry, coal.Ellipsoid):
        return np.asarray(_ball() * np.asarray(geometry.radii))
    if isinstance(geometry, coal.Capsule):
        ball = _ball() * geometry.radius
        return np.vstack([ball + geometry.halfLength * up, ball - geometry.halfLength * up])
    if isinstance(geometry, coal.Cylinder):
        rim = circle * geometry.radius
        return np.vstack([rim + geometry.halfLength * up, rim - geometry.halfLength * up])
    if isinstance(geometry, coal.Cone):
        return np.vstack([circle * geometry.radius - geometry.halfLength * up, geometry.halfLength * up])
    arrays = mesh_arrays(geometry)
    return None if arrays is None else arrays[0]


def _ball() -> NDArray[np.float64]:
    """Points on the unit sphere, rings of latitude."""
    latitude = np.linspace(-np.pi / 2.0, np.pi / 2.0, _AROUND // 2 + 1)
    longitude = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    height, around = np.meshgrid(latitude, longitude)
    return np.column_stack(
        [(np.cos(height) * np.cos(around)).ravel(), (np.cos(height) * np.sin(around)).ravel(), np.sin(height).ravel()]
    )


def _hull(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convex outline of points in the plane; a body seen edge-on gives its two ends."""
    spread = points.max(axis=0) - points.min(axis=0)
    centred = points - points.mean(axis=0)
    if np.linalg.svd(centred, compute_uv=False)[-1] < 1e-9 * max(float(spread.max()), 1e-9) * len(points):
        along = centred @ np.linalg.svd(centred)[2][0]
        return points[[int(np.argmin(along)), int(np.argmax(along))]]
    return np.asarray(points[ConvexHull(points).vertices])
