"""Overall dimensions of a robot in a posture, from its collision geometry.

A robot's extent along a direction is the furthest that any of its shapes reaches, which for each shape is its support
function: exact for boxes, cylinders and the like in any orientation, where a box around a rotated shape's own box would
be too large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import RobotDescriptionError, require_finite, require_shape
from m4_dynamics.robot.robot import Robot

__all__ = ["OverallDimensions", "extent", "overall_dimensions", "support"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class OverallDimensions:
    """How much room a robot takes up.

    Attributes:
        length: Extent along the first axis [m].
        width: Extent along the second axis [m].
        height: Extent along the third axis [m].
    """

    length: float
    width: float
    height: float


def support(shape: coal.CollisionGeometry, direction: ArrayLike) -> float:
    """How far a shape reaches from its frame's origin along a direction.

    Args:
        shape: A box, sphere, cylinder, capsule, cone, ellipsoid, convex body or mesh.
        direction: Unit vector in the shape's frame, shape (3,).

    Returns:
        The largest value of direction . point over the shape's points [m]; infinite for planes and half-spaces.

    Raises:
        RobotDescriptionError: If the shape is of another kind.
    """
    d = np.asarray(direction, dtype=float)
    across = math.hypot(d[0], d[1])
    if isinstance(shape, coal.Box):
        return float(np.abs(d) @ shape.halfSide)
    if isinstance(shape, coal.Sphere):
        return float(shape.radius)
    if isinstance(shape, coal.Cylinder):
        return float(shape.halfLength * abs(d[2]) + shape.radius * across)
    if isinstance(shape, coal.Capsule):
        return float(shape.halfLength * abs(d[2]) + shape.radius)
    if isinstance(shape, coal.Cone):  # apex at +z
        return float(max(shape.halfLength * d[2], -shape.halfLength * d[2] + shape.radius * across))
    if isinstance(shape, coal.Ellipsoid):
        return float(np.linalg.norm(np.asarray(shape.radii) * d))
    if isinstance(shape, coal.Plane | coal.Halfspace):
        return math.inf
    if isinstance(shape, coal.ConvexBase):
        return float((np.asarray(shape.points()) @ d).max())
    if isinstance(shape, coal.BVHModelBase):
        return float((np.asarray(shape.vertices()) @ d).max())
    raise RobotDescriptionError(f"no extent is known for a collision shape of type {type(shape).__name__}")


def extent(robot: Robot, configuration: ArrayLike, direction_in_world: ArrayLike) -> tuple[float, float]:
    """Lowest and highest point of a robot along a direction.

    Args:
        robot: The robot.
        configuration: Full configuration, shape (nq,).
        direction_in_world: Unit vector, shape (3,); with a configuration whose free-flyer is neutral the base's axes
            are the world's.

    Returns:
        (lowest, highest) coordinate along the direction, from the world's origin [m].

    Raises:
        RobotDescriptionError: If the robot has no collision geometry.
    """
    q = np.asarray(configuration, dtype=float)
    require_shape("configuration", q, (robot.model.nq,))
    require_finite("configuration", q)
    d = np.asarray(direction_in_world, dtype=float)
    data = robot.model.createData()
    geometry_data = robot.collision_model.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.collision_model, geometry_data, q)
    low, high = math.inf, -math.inf
    for shape, placement in zip(robot.collision_model.geometryObjects, geometry_data.oMg, strict=True):
        centre = float(d @ placement.translation)
        d_in_shape = placement.rotation.T @ d
        high = max(high, centre + support(shape.geometry, d_in_shape))
        low = min(low, centre - support(shape.geometry, -d_in_shape))
    if not low <= high:
        raise RobotDescriptionError(f"robot '{robot.name}' has no collision geometry to take its dimensions from")
    return low, high


def overall_dimensions(
    robot: Robot, configuration: ArrayLike, *, axes_in_world: ArrayLike | None = None
) -> OverallDimensions:
    """Length, width and height of a robot.

    Args:
        robot: The robot.
        configuration: Full configuration, shape (nq,).
        axes_in_world: Unit vectors of length, width and height as columns, shape (3, 3); None takes x, y and z.

    Returns:
        The extents along the three axes.

    Raises:
        RobotDescriptionError: If the robot has no collision geometry.
    """
    axes = np.eye(3) if axes_in_world is None else np.asarray(axes_in_world, dtype=float)
    require_shape("axes_in_world", axes, (3, 3))
    sizes = []
    for axis in axes.T:
        low, high = extent(robot, configuration, axis)
        sizes.append(high - low)
    return OverallDimensions(length=sizes[0], width=sizes[1], height=sizes[2])
