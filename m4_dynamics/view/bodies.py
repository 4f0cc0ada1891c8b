"""The robot's visual geometry as nodes of the scene: one moving node per joint, its shapes fixed below it."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.robot.robot import Robot, Wheel
from m4_dynamics.view.shading import crease_normals
from m4_dynamics.view.three import (
    Command,
    Material,
    Shape,
    box,
    capsule,
    cone,
    cylinder,
    ellipsoid,
    mesh,
    set_object,
    set_transform,
    sphere,
)

__all__ = ["hex_colour", "joint_path", "mesh_arrays", "robot_commands", "shape_of"]

ROOT = "/robot"
_MARK_COLOUR = "#F4F1EA"


def joint_path(robot: Robot, joint_id: int, *, root: str = ROOT) -> str:
    """Path of the node that moves with a joint; joint 0 is the world's."""
    return f"{root}/{_clean(robot.model.names[joint_id])}"


def robot_commands(robot: Robot, *, root: str = ROOT, material: Material | None = None) -> list[Command]:
    """Commands that build the robot's bodies; whoever shows a posture or a motion places the joints.

    Args:
        robot: The robot.
        root: Node of the robot.
        material: How all of it looks; None takes the colours of its description.

    Returns:
        The commands: per geometry its shape and its fixed placement in its joint, and a mark on plain wheels.
    """
    commands: list[Command] = []
    shapes: dict[tuple[str, bytes], Shape | None] = {}  # of meshes, by file and scale: wheels share theirs
    for geometry in _bodies(robot):
        key = (geometry.meshPath, np.asarray(geometry.meshScale).tobytes())
        shape = shapes.get(key) or shape_of(geometry.geometry)
        if geometry.meshPath and isinstance(geometry.geometry, coal.BVHModelBase):
            shapes[key] = shape
        if shape is None:
            continue  # a plane, half-space or point cloud has no body to show
        path = f"{joint_path(robot, geometry.parentJoint, root=root)}/{_clean(geometry.name)}"
        colour = geometry.meshColor
        own = Material(colour=hex_colour(colour), opacity=float(colour[3]))
        commands.append(set_object(path, shape, own if material is None else material))
        commands.append(set_transform(path, geometry.placement.homogeneous))
    for wheel in robot.wheels:
        if _looks_still(robot, wheel):
            commands.extend(_spin_mark(robot, wheel, root))
    return commands


def shape_of(geometry: coal.CollisionGeometry) -> Shape | None:
    """The three.js shape of one Pinocchio geometry.

    Args:
        geometry: A primitive, a convex body or a triangle mesh.

    Returns:
        The shape, or None for what has no finite surface.
    """
    if isinstance(geometry, coal.Box):
        return box(2.0 * geometry.halfSide)
    if isinstance(geometry, coal.Sphere):
        return sphere(geometry.radius)
    if isinstance(geometry, coal.Ellipsoid):
        return ellipsoid(geometry.radii)
    if isinstance(geometry, coal.Capsule):
        return capsule(geometry.radius, 2.0 * geometry.halfLength)
    if isinstance(geometry, coal.Cylinder):
        return cylinder(geometry.radius, 2.0 * geometry.halfLength)
    if isinstance(geometry, coal.Cone):
        return cone(geometry.radius, 2.0 * geometry.halfLength)
    arrays = mesh_arrays(geometry)
    if arrays is None:
        return None
    vertices, normals, triangles = crease_normals(*arrays)
    return mesh(vertices, triangles, normals=normals)


def mesh_arrays(geometry: coal.CollisionGeometry) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """Vertices and triangles of a mesh.

    Args:
        geometry: Any geometry.

    Returns:
        Vertices, shape (n, 3) [m], and indices of the triangles, shape (m, 3); None for anything but a mesh.
    """
    if isinstance(geometry, coal.BVHModelBase):
        vertices, faces = geometry.vertices(), [geometry.tri_indices(index) for index in range(geometry.num_tris)]
    elif isinstance(geometry, coal.Convex):
        vertices, faces = geometry.points(), [geometry.polygons(index) for index in range(geometry.num_polygons)]
    else:
        return None
    if not faces:
        return None
    triangles = np.array([[face[corner] for corner in range(3)] for face in faces], dtype=np.int64)
    return np.asarray(vertices, dtype=float), triangles


def hex_colour(colour: NDArray[np.float64]) -> str:
    """An RGBA colour with entries in [0, 1] as "#rrggbb"."""
    red, green, blue = (round(255.0 * float(np.clip(entry, 0.0, 1.0))) for entry in colour[:3])
    return f"#{red:02X}{green:02X}{blue:02X}"


def _clean(name: str) -> str:
    """A name that is one step of a path."""
    return name.replace("/", "_") or "unnamed"


def _geometries_of(robot: Robot, wheel: Wheel) -> list[pin.GeometryObject]:
    return [one for one in _bodies(robot) if one.parentJoint == wheel.joint_id]


def _bodies(robot: Robot) -> list[pin.GeometryObject]:
    """What there is to see of a robot: what its description shows, or else what collides."""
    return list(robot.visual_model.geometryObjects) or list(robot.collision_model.geometryObjects)


def _looks_still(robot: Robot, wheel: Wheel) -> bool:
    """Whether a wheel looks the same at every angle: nothing on it but round bodies about its axle."""
    for geometry in _geometries_of(robot, wheel):
        centre = geometry.placement.translation
        if np.linalg.norm(np.cross(centre, wheel.axis_in_joint)) > 1e-3 * wheel.radius:
            return False
        if isinstance(geometry.geometry, coal.Sphere):
            continue
        about_axle = abs(float(geometry.placement.rotation[:, 2] @ wheel.axis_in_joint)) > 1.0 - 1e-6
        if not (about_axle and isinstance(geometry.geometry, coal.Cylinder | coal.Capsule | coal.Cone)):
            return False
    return True


def _spin_mark(robot: Robot, wheel: Wheel, root: str) -> list[Command]:
    """A light bar across both faces of a wheel, so that the eye sees it turn."""
    axis = wheel.axis_in_joint
    half_width = 0.1 * wheel.radius
    for geometry in _geometries_of(robot, wheel):
        if isinstance(geometry.geometry, coal.Sphere):
            half_width = max(half_width, geometry.geometry.radius)
        else:
            half_width = max(
                half_width, geometry.geometry.halfLength + abs(float(geometry.placement.translation @ axis))
            )
    across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across /= np.linalg.norm(across)
    placement = np.eye(4)
    placement[:3, :3] = np.column_stack([across, np.cross(axis, across), axis])
    path = f"{joint_path(robot, wheel.joint_id, root=root)}/spin_mark"
    bar = box((1.5 * wheel.radius, 0.14 * wheel.radius, 2.0 * half_width + 0.004))
    return [set_object(path, bar, Material(colour=_MARK_COLOUR)), set_transform(path, placement)]
