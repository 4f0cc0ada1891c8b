"""The scene: ground, robot and what is drawn over them, as commands for meshcat's viewer and motions of its nodes.

One vocabulary serves every way of looking: a page embeds the commands and plays the motions, a live view sends the
commands once and then a transform per node. Nodes, all in the world frame with z up:

    /ground/...                    terrain profile, extruded sideways
    /robot/<joint>/<geometry>      visual geometry below the node that moves with its joint
    /robot/<joint>/rotor_<frame>   disc in the plane of a propeller that pushes
    /thrust/<frame>                thrust on the robot, from its point of application
    /contact/<joint>               force of the ground on a wheel, from the contact point
    /cone/<joint>                  friction cone at the same point, as high as the normal force
    /com                           centre of mass of the whole robot
    /trail/<piece>                 the way that the centre of mass has come
    /reduced/...                   the planar pendulum: wheel, bar to its centre of mass, thrust
    /ghost/<joint>/<geometry>      the robot at the reference
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.bodies import joint_path, robot_commands
from m4_dynamics.view.frames import Frames
from m4_dynamics.view.ground import ground_commands
from m4_dynamics.view.motion import Motion, motion_matrix
from m4_dynamics.view.overlays import (
    COM_COLOUR,
    CONTACT_COLOUR,
    THRUST_COLOUR,
    Overlays,
    overlay_commands,
    overlay_motions,
)
from m4_dynamics.view.three import Command, set_light, set_property, set_transform

__all__ = [
    "COM_COLOUR",
    "CONTACT_COLOUR",
    "THRUST_COLOUR",
    "Bounds",
    "joint_motions",
    "placing_commands",
    "scene_bounds",
    "scene_commands",
    "scene_motions",
    "surroundings",
]

_SKY, _HORIZON = (0.80, 0.88, 0.95), (0.98, 0.985, 0.99)


@dataclass(frozen=True, slots=True)
class Bounds:
    """A box along the world's axes.

    Attributes:
        low: Lowest x, y, z [m].
        high: Highest x, y, z [m].
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]


def scene_commands(
    robot: Robot, profile: NDArray[np.float64], bounds: Bounds, frames: Frames, overlays: Overlays
) -> list[Command]:
    """Commands that set the scene up; nothing stands in its place until the motions put it there.

    Args:
        robot: The robot.
        profile: Corners (x, z) of the terrain in sight, shape (n, 2) [m].
        bounds: What must be lit, and throw a shadow.
        frames: The instants shown; only the trail depends on them.
        overlays: What is drawn over robot and ground.

    Returns:
        The commands.
    """
    return [
        *surroundings(bounds),
        *ground_commands(profile),
        *robot_commands(robot),
        *overlay_commands(robot, frames, overlays),
    ]


def scene_motions(robot: Robot, frames: Frames, overlays: Overlays, *, metres_per_newton: float) -> list[Motion]:
    """Motions of every node that moves.

    Args:
        robot: The robot.
        frames: The instants.
        overlays: What is drawn over robot and ground.
        metres_per_newton: Length of a force arrow per force.

    Returns:
        Motions over the same instants, those of the joints first; pieces of the trail have instants of their own.
    """
    return [
        *joint_motions(robot, frames.configuration),
        *overlay_motions(robot, frames, overlays, metres_per_newton=metres_per_newton),
    ]


def joint_motions(robot: Robot, configurations: NDArray[np.float64], *, root: str = "/robot") -> list[Motion]:
    """Motions of the nodes that move with the robot's joints.

    Args:
        robot: The robot.
        configurations: Shape (n, nq).
        root: Node of the robot.

    Returns:
        One motion per joint.
    """
    data = robot.model.createData()
    count, joints = len(configurations), robot.model.njoints
    position, quaternion = np.empty((joints, count, 3)), np.empty((joints, count, 4))
    for index, configuration in enumerate(configurations):
        pin.forwardKinematics(robot.model, data, configuration)
        for joint, placement in enumerate(data.oMi):
            position[joint, index] = placement.translation
            quaternion[joint, index] = pin.Quaternion(placement.rotation).coeffs()
    return [
        Motion(joint_path(robot, joint, root=root), position[joint], quaternion[joint]) for joint in range(1, joints)
    ]


def placing_commands(motions: Sequence[Motion], index: int = 0) -> list[Command]:
    """Commands that put every node where it is at one instant.

    Args:
        motions: The motions.
        index: Number of the instant; those with instants of their own are left at their first one.

    Returns:
        One command per motion.
    """
    return [set_transform(one.path, motion_matrix(one, index if one.times is None else 0)) for one in motions]


def scene_bounds(motions: Sequence[Motion], robot: Robot, *, reach: float = 0.2) -> Bounds:
    """A box that holds the robot all the way.

    Args:
        motions: Motions of the scene.
        robot: The robot.
        reach: How far its bodies may stand out beyond its joints [m].

    Returns:
        The box.
    """
    paths = {joint_path(robot, joint) for joint in range(1, robot.model.njoints)}
    places = np.concatenate([one.position for one in motions if one.path in paths and one.position is not None])
    low, high = places.min(axis=0) - reach, places.max(axis=0) + reach
    return Bounds((float(low[0]), float(low[1]), float(low[2])), (float(high[0]), float(high[1]), float(high[2])))


def surroundings(bounds: Bounds) -> list[Command]:
    """A light sky, soft light from everywhere and a sun that throws shadows; meshcat's own grid, axes and lamps go."""
    commands = [
        set_property("/Background", "top_color", list(_SKY)),
        set_property("/Background", "bottom_color", list(_HORIZON)),
    ]
    for path in (
        "/Grid",
        "/Axes",
        "/Lights/PointLightNegativeX",
        "/Lights/PointLightPositiveX",
        "/Lights/FillLight",
    ):
        commands.append(set_property(path, "visible", False))
    # three.js aims the sun at the world's origin, so its shadow must reach from there to the farthest corner.
    reach = float(np.max(np.linalg.norm(np.abs([bounds.low, bounds.high]), axis=1)))
    reach = max(2.0, reach)
    direction = np.array([-0.25, -0.7, 1.0])
    place = np.eye(4)
    place[3, :3] = direction / np.linalg.norm(direction) * 3.0 * reach  # three.js keeps matrices column by column
    shadow_camera = {
        "type": "OrthographicCamera",
        "uuid": "/sun#camera",
        "left": -reach,
        "right": reach,
        "top": reach,
        "bottom": -reach,
        "near": 0.1,
        "far": 6.0 * reach,
        "zoom": 1,
    }
    sun = {
        "type": "DirectionalLight",
        "color": 0xFFFFFF,
        "intensity": 0.68,
        "matrix": [float(entry) for entry in place.ravel()],
        "castShadow": True,
        "shadow": {
            "bias": -0.0008,
            "normalBias": 0.012,
            "radius": 2.0,
            "mapSize": [2048, 2048],
            "camera": shadow_camera,
        },
    }
    commands.append(set_light("/sun", sun))
    # A weak second lamp without shadows, from uphill, keeps the other side from going black.
    place[3, :3] = np.array([0.8, -0.35, 0.25]) * 3.0 * reach
    fill = {"type": "DirectionalLight", "color": 0xFFFFFF, "intensity": 0.28}
    commands.append(set_light("/fill", {**fill, "matrix": [float(entry) for entry in place.ravel()]}))
    commands.append(set_property("/fill/<object>", "castShadow", False))  # the viewer lets every object throw one
    commands.append(set_property("/Lights/AmbientLight/<object>", "intensity", 0.52))
    return commands
