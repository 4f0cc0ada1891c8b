"""The scene: ground, robot, force arrows and centre of mass, as commands for meshcat's viewer and motions of its nodes.

One vocabulary serves every way of looking: a page embeds the commands and plays the motions, a live view sends the
commands once and then a transform per node. Nodes, all in the world frame with z up:

    /ground/...                    terrain profile, extruded sideways
    /robot/<joint>/<geometry>      visual geometry below the node that moves with its joint
    /thrust/<frame>                thrust on the robot, from its point of application
    /contact/<joint>               force of the ground on a wheel, from the contact point
    /com                           centre of mass of the whole robot
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.arrows import arrow_commands, arrow_motions
from m4_dynamics.view.bodies import joint_path, robot_commands
from m4_dynamics.view.frames import Frames
from m4_dynamics.view.ground import ground_commands
from m4_dynamics.view.motion import Motion
from m4_dynamics.view.style import COLOURS
from m4_dynamics.view.three import Command, Material, set_light, set_object, set_property, sphere

__all__ = ["CONTACT_COLOUR", "COM_COLOUR", "THRUST_COLOUR", "Bounds", "scene_bounds", "scene_commands", "scene_motions"]

THRUST_COLOUR = COLOURS["purple"]
CONTACT_COLOUR = COLOURS["green"]
COM_COLOUR = COLOURS["orange"]
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


def scene_commands(robot: Robot, profile: NDArray[np.float64], bounds: Bounds) -> list[Command]:
    """Commands that set the scene up; nothing stands in its place until the motions put it there.

    Args:
        robot: The robot.
        profile: Corners (x, z) of the terrain in sight, shape (n, 2) [m].
        bounds: What must be lit, and throw a shadow.

    Returns:
        The commands.
    """
    commands = _surroundings(bounds)
    commands += ground_commands(profile)
    commands += robot_commands(robot)
    for thruster in robot.thrusters:
        commands += arrow_commands(_thrust_path(thruster.frame), THRUST_COLOUR)
    for wheel in robot.wheels:
        commands += arrow_commands(_contact_path(wheel.joint), CONTACT_COLOUR)
    commands.append(set_object("/com/ball", sphere(0.018), Material(colour=COM_COLOUR, in_front=True)))
    commands.append(set_property("/com/ball/<object>", "castShadow", False))
    return commands


def scene_motions(robot: Robot, frames: Frames, *, metres_per_newton: float) -> list[Motion]:
    """Motions of every node that moves.

    Args:
        robot: The robot.
        frames: The instants.
        metres_per_newton: Length of a force arrow per force.

    Returns:
        Motions over the same instants: one per joint, three per arrow, one of the centre of mass.
    """
    data = robot.model.createData()
    count, joints = len(frames.time), robot.model.njoints
    position, quaternion = np.empty((joints, count, 3)), np.empty((joints, count, 4))
    for index, configuration in enumerate(frames.configuration):
        pin.forwardKinematics(robot.model, data, configuration)
        for joint, placement in enumerate(data.oMi):
            position[joint, index] = placement.translation
            quaternion[joint, index] = pin.Quaternion(placement.rotation).coeffs()
    motions = [Motion(joint_path(robot, joint), position[joint], quaternion[joint]) for joint in range(1, joints)]
    nowhere = np.full((count, 3), np.nan)
    for thruster in robot.thrusters:
        origin = frames.thrust_position.get(thruster.frame, nowhere)
        force = frames.thrust_force.get(thruster.frame, nowhere)
        motions += arrow_motions(_thrust_path(thruster.frame), origin, force, metres_per_newton=metres_per_newton)
    for wheel in robot.wheels:
        origin = frames.contact_position.get(wheel.joint, nowhere)
        force = frames.contact_force.get(wheel.joint, nowhere)
        motions += arrow_motions(_contact_path(wheel.joint), origin, force, metres_per_newton=metres_per_newton)
    motions.append(Motion("/com", frames.com))
    return motions


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


def _thrust_path(frame: str) -> str:
    return f"/thrust/{frame.replace('/', '_')}"


def _contact_path(joint: str) -> str:
    return f"/contact/{joint.replace('/', '_')}"


def _surroundings(bounds: Bounds) -> list[Command]:
    """A light sky, soft light from everywhere and a sun that throws shadows; meshcat's own grid, axes and lamps go."""
    commands = [
        set_property("/Background", "top_color", list(_SKY)),
        set_property("/Background", "bottom_color", list(_HORIZON)),
    ]
    for path in ("/Grid", "/Axes", "/Lights/PointLightNegativeX", "/Lights/PointLightPositiveX", "/Lights/FillLight"):
        commands.append(set_property(path, "visible", False))
    # three.js aims the sun at the world's origin, so its shadow must reach from there to the farthest corner.
    reach = float(np.max(np.linalg.norm(np.abs([bounds.low, bounds.high]), axis=1)))
    reach = max(2.0, reach)
    direction = np.array([-0.45, -0.55, 1.0])
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
        "intensity": 0.62,
        "matrix": [float(entry) for entry in place.ravel()],
        "castShadow": True,
        "shadow": {"bias": -0.0004, "radius": 2.0, "mapSize": [2048, 2048], "camera": shadow_camera},
    }
    commands.append(set_light("/sun", sun))
    commands.append(set_property("/Lights/AmbientLight/<object>", "intensity", 0.58))
    return commands
