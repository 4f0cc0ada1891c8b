"""The body's outline seen from the side, for ground clearance: everything but the drive wheels."""

from __future__ import annotations

import math

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from m4_dynamics.reduced.reduction.frame import BalanceFrame, drive_wheel_joints
from m4_dynamics.robot.robot import Robot

__all__ = ["body_outline"]

_Array = NDArray[np.float64]

#: Points on a circle; the outline lies inside the circle by at most 0.14 % of its radius.
_CIRCLE_POINTS = 60


def body_outline(robot: Robot, frame: BalanceFrame, configuration: _Array) -> _Array | None:
    """Convex outline of the body in the sagittal plane.

    Clearance to a plane depends on the convex hull only. Collision shapes, wheels other than the drive wheels and
    contact points count; round shapes are sampled.

    Args:
        robot: The robot.
        frame: The pendulum's axes.
        configuration: Full configuration with the base at the world's origin, shape (nq,).

    Returns:
        Corners (forward, up) from the axle, shape (k, 2) [m]; None if the robot has no such shape.
    """
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, configuration)
    wheels = drive_wheel_joints(robot, frame)
    clouds = []
    for shape in robot.collision_model.geometryObjects:
        if shape.parentJoint not in wheels:
            placement = data.oMi[shape.parentJoint] * shape.placement
            clouds.append(_shape_points(shape) @ placement.rotation.T + placement.translation)
    for wheel in robot.wheels:
        if wheel.joint_id not in wheels:
            placement = data.oMi[wheel.joint_id]
            rim = wheel.radius * _circle_about(wheel.axis_in_joint)
            clouds.append(rim @ placement.rotation.T + placement.translation)
    for point in robot.contact_points:
        if point.joint_id not in wheels:
            clouds.append(np.atleast_2d(data.oMi[point.joint_id].act(np.array(point.position_in_joint))))
    if not clouds:
        return None
    from_axle = np.vstack(clouds) - frame.axle_in_base
    flat = np.column_stack([from_axle @ frame.forward_in_base, from_axle @ frame.up_in_base])
    try:
        return np.asarray(flat[ConvexHull(flat).vertices])
    except QhullError:  # fewer than three points, or all on one line: they are their own outline
        return np.unique(flat, axis=0)


def _shape_points(shape: pin.GeometryObject) -> _Array:
    """Points whose convex hull is the shape (to sampling), in the shape's frame, shape (k, 3) [m]."""
    geometry = shape.geometry
    if isinstance(geometry, coal.Box):
        half_side = np.array(geometry.halfSide)
        return _box_corners(-half_side, half_side)
    if isinstance(geometry, coal.Cylinder):
        rim = geometry.radius * _circle_about(np.array([0.0, 0.0, 1.0]))
        offset = np.array([0.0, 0.0, geometry.halfLength])
        return np.vstack([rim + offset, rim - offset])
    if isinstance(geometry, coal.Sphere | coal.Capsule):
        half = getattr(geometry, "halfLength", 0.0)
        offset = np.array([0.0, 0.0, half])
        ball = geometry.radius * _ball()
        return np.vstack([ball + offset, ball - offset])
    if isinstance(geometry, coal.BVHModelBase):
        # The vertices come scaled from the loader; `meshScale` is only a record of it.
        return np.array([geometry.vertex(index) for index in range(geometry.num_vertices)])
    # Any other shape is taken as its bounding box, which can only make the clearance look smaller.
    geometry.computeLocalAABB()
    return _box_corners(np.asarray(geometry.aabb_local.min_), np.asarray(geometry.aabb_local.max_))


def _box_corners(low: _Array, high: _Array) -> _Array:
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def _circle_about(axis: _Array) -> _Array:
    """Unit circle about an axis, shape (n, 3)."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, helper)
    first = first / np.linalg.norm(first)
    second = np.cross(axis, first)
    angle = np.linspace(0.0, 2.0 * math.pi, _CIRCLE_POINTS, endpoint=False)
    return np.asarray(np.outer(np.cos(angle), first) + np.outer(np.sin(angle), second))


def _ball() -> _Array:
    """Points on the unit sphere, in circles of latitude."""
    latitude = np.linspace(-0.5 * math.pi, 0.5 * math.pi, _CIRCLE_POINTS // 2 + 1)
    circle = _circle_about(np.array([0.0, 0.0, 1.0]))
    pole = np.array([0.0, 0.0, 1.0])
    return np.vstack([math.cos(angle) * circle + math.sin(angle) * pole for angle in latitude])
