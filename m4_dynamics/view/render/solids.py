"""What a picture shows, as triangles: the robot's bodies in a configuration, and the ground under them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.bodies import mesh_arrays
from m4_dynamics.view.silhouette import surface_points

__all__ = ["GroundSlab", "Solid", "RobotShapes"]

Array = NDArray[np.float64]

_DISC_WIDTH, _DISC_COLOUR = 0.3, (0.2, 0.24, 0.28)  # width over radius; sRGB


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A body of one colour.

    Attributes:
        corners: Corners of its triangles, shape (n, 3, 3) [m].
        normals: Outward unit normals of the triangles, shape (n, 3).
        colour: sRGB in [0, 1], shape (3,).
    """

    corners: Array
    normals: Array
    colour: Array

    def moved(self, rotation: Array, translation: Array) -> Solid:
        """The body, turned by a matrix of shape (3, 3) and then shifted by a vector of shape (3,) [m]."""
        return replace(self, corners=self.corners @ rotation.T + translation, normals=self.normals @ rotation.T)


@dataclass(frozen=True, slots=True, eq=False)
class GroundSlab:
    """A strip of ground: a profile extruded across the view.

    Attributes:
        profile: Corners (x, z), shape (n, 2) [m].
        near: Its edge towards negative y [m].
        far: Its other edge [m].
        thickness: Of the slab that is drawn [m].
    """

    profile: Array
    near: float = -0.55
    far: float = 0.55
    thickness: float = 0.06

    def triangles(self) -> tuple[Array, Array]:
        """The surface and, below it, the flank that faces negative y.

        Returns:
            Corners of the surface's triangles and of the flank's, each of shape (n, 3, 3) [m].
        """
        surface, flank = [], []
        for (x0, z0), (x1, z1) in zip(self.profile[:-1], self.profile[1:], strict=True):
            a, b = (x0, self.near, z0), (x1, self.near, z1)
            surface += [(a, b, (x1, self.far, z1)), (a, (x1, self.far, z1), (x0, self.far, z0))]
            low_a, low_b = (x0, self.near, z0 - self.thickness), (x1, self.near, z1 - self.thickness)
            flank += [(a, b, low_b), (a, low_b, low_a)]
        return np.array(surface, dtype=float), np.array(flank, dtype=float)


class RobotShapes:
    """A robot's visual bodies as triangles, found once and placed as often as wanted."""

    def __init__(self, robot: Robot) -> None:
        """Tessellate the robot's bodies; round ones become polyhedra of many faces.

        A wheel without a visual body is drawn as a disc.
        """
        self._model, self._data = robot.model, robot.model.createData()
        self._bodies: list[tuple[int, Solid]] = []  # with the joint that each moves with
        for geometry in robot.visual_model.geometryObjects:
            solid = _solid(geometry.geometry, np.asarray(geometry.meshColor, dtype=float)[:3])
            if solid is not None:
                placement = geometry.placement
                placed = solid.moved(np.asarray(placement.rotation), np.asarray(placement.translation))
                self._bodies.append((int(geometry.parentJoint), placed))
        drawn = {joint for joint, _ in self._bodies}
        for wheel in robot.wheels:
            if wheel.joint_id not in drawn:
                disc = _solid(coal.Cylinder(wheel.radius, _DISC_WIDTH * wheel.radius), np.array(_DISC_COLOUR))
                turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), wheel.axis_in_joint)
                if disc is not None:
                    self._bodies.append((wheel.joint_id, disc.moved(turn.toRotationMatrix(), np.zeros(3))))

    def at(self, configuration: NDArray[np.float64], shift: Sequence[float] = (0.0, 0.0, 0.0)) -> list[Solid]:
        """The bodies in a configuration.

        Args:
            configuration: Shape (nq,).
            shift: Added to every position [m].

        Returns:
            One solid per body, in the world.
        """
        pin.forwardKinematics(self._model, self._data, configuration)
        placements = self._data.oMi
        return [
            solid.moved(np.asarray(placements[joint].rotation), np.asarray(placements[joint].translation) + shift)
            for joint, solid in self._bodies
        ]


def _solid(geometry: coal.CollisionGeometry, colour: Array) -> Solid | None:
    """One body in its own frame; None for what has no finite surface."""
    arrays = mesh_arrays(geometry) if isinstance(geometry, coal.BVHModelBase) else None
    if arrays is not None:
        corners = arrays[0][arrays[1]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return Solid(corners, normals / np.maximum(length, 1e-15), colour)
    points = surface_points(geometry)
    if points is None:
        return None
    hull = ConvexHull(points)
    return Solid(points[hull.simplices], np.array(hull.equations[:, :3]), colour)
