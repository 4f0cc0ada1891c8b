"""A ghost of the robot at its reference: translucent, in the posture of the reduced model, moving as one."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from m4_dynamics.reduced.reduction import Reduction
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.arrows import HIDDEN_SCALE
from m4_dynamics.view.bodies import joint_path, robot_commands
from m4_dynamics.view.motion import Motion
from m4_dynamics.view.reduced_motion import PlanarMotion
from m4_dynamics.view.three import Command, Material, set_property, set_transform

__all__ = ["ghost_commands", "ghost_motions"]

_OPACITY = 0.32


def ghost_commands(path: str, colour: str, robot: Robot, reduction: Reduction) -> list[Command]:
    """Commands that build the ghost, legs held in the posture of the reduction.

    Args:
        path: Its node, which moves with the base.
        colour: sRGB hex.
        robot: The robot.
        reduction: The pendulum that it is reduced to.

    Returns:
        The commands.
    """
    commands = robot_commands(robot, root=path, material=Material(colour=colour, opacity=_OPACITY, yields=True))
    objects = [command["path"] for command in commands if command["type"] == "set_object"]
    commands += [set_property(f"{one}/<object>", "castShadow", False) for one in objects]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, reduction.configuration)
    for joint in range(1, robot.model.njoints):
        commands.append(set_transform(joint_path(robot, joint, root=path), data.oMi[joint].homogeneous))
    return commands


def ghost_motions(path: str, robot: Robot, reduction: Reduction, planar: PlanarMotion) -> list[Motion]:
    """Motions of the ghost.

    Args:
        path: Its node.
        robot: The robot.
        reduction: The pendulum that it is reduced to.
        planar: Where it is at n instants; NaN hides it.

    Returns:
        One motion of all, and one per drive wheel.
    """
    known = np.isfinite(planar.axle).all(axis=1) & np.isfinite(planar.pitch) & np.isfinite(planar.wheel_angle)
    frame, count = reduction.frame, len(known)
    position, quaternion = np.zeros((count, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
    for index in np.flatnonzero(known).tolist():
        rotation = frame.base_rotation_in_world(0.0, float(planar.pitch[index]))
        position[index] = planar.axle[index] - rotation @ frame.axle_in_base
        quaternion[index] = pin.Quaternion(rotation).coeffs()
    size = np.repeat(np.where(known, 1.0, HIDDEN_SCALE)[:, None], 3, axis=1)
    motions = [Motion(path, position, quaternion, size)]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, reduction.configuration)
    for name, sign in zip(frame.wheel_joints, frame.wheel_signs, strict=True):
        wheel = robot.wheel(name)
        placement = data.oMi[wheel.joint_id]
        turns = np.empty((count, 4))
        for index in range(count):
            spin = sign * (planar.wheel_angle[index] - planar.pitch[index]) if known[index] else 0.0
            turn = pin.AngleAxis(float(spin), wheel.axis_in_joint).toRotationMatrix()
            turns[index] = pin.Quaternion(placement.rotation @ turn).coeffs()
        place = np.tile(np.asarray(placement.translation), (count, 1))
        motions.append(Motion(joint_path(robot, wheel.joint_id, root=path), place, turns))
    return motions
