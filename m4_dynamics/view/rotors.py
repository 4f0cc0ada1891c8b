"""Discs in the propellers' planes: they show which wheels push at the moment and which are idle."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.robot.robot import Robot, Thruster
from m4_dynamics.view.arrows import HIDDEN_SCALE
from m4_dynamics.view.bodies import joint_path
from m4_dynamics.view.motion import Motion
from m4_dynamics.view.three import Command, Material, cylinder, set_object, set_property, set_transform

__all__ = ["rotor_commands", "rotor_motion", "rotor_path"]

_OPACITY = 0.42
_INSIDE_WHEEL = 0.8  # radius of the disc over that of the wheel around it
_WITHOUT_WHEEL = 0.10  # [m] radius of a disc that no wheel surrounds
_FULL_SIZE_FROM = 1.0  # [N] below, the disc shrinks with the thrust


def rotor_commands(robot: Robot, thruster: Thruster, colour: str) -> list[Command]:
    """Commands that build the disc of a thruster, fixed to the body that carries it.

    Args:
        robot: The robot.
        thruster: The thruster.
        colour: sRGB hex.

    Returns:
        The commands.
    """
    radius = _WITHOUT_WHEEL
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, pin.neutral(robot.model))
    centre = data.oMi[thruster.joint_id].act(np.array(thruster.position_in_joint))
    for wheel in robot.wheels:
        if np.linalg.norm(data.oMi[wheel.joint_id].translation - centre) < 0.5 * wheel.radius:
            radius = _INSIDE_WHEEL * wheel.radius
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(thruster.direction_in_joint))
    placement = pin.SE3(turn.toRotationMatrix(), np.array(thruster.position_in_joint))
    path = rotor_path(robot, thruster)
    material = Material(colour=colour, opacity=_OPACITY, see_through=True)
    return [
        set_object(f"{path}/blur", cylinder(radius, 0.004), material),
        set_property(f"{path}/blur/<object>", "castShadow", False),
        set_transform(path, placement.homogeneous),
    ]


def rotor_motion(robot: Robot, thruster: Thruster, thrust: NDArray[np.float64]) -> Motion:
    """Motion of a thruster's disc.

    Args:
        robot: The robot.
        thruster: The thruster.
        thrust: Its thrust, shape (n,) [N].

    Returns:
        The disc shrinks to nothing without thrust.
    """
    size = np.clip(np.nan_to_num(thrust) / _FULL_SIZE_FROM, HIDDEN_SCALE, 1.0)
    return Motion(f"{rotor_path(robot, thruster)}/blur", scale=np.repeat(size[:, None], 3, axis=1))


def rotor_path(robot: Robot, thruster: Thruster) -> str:
    """The node of a thruster's disc, below that of the body that carries it."""
    return f"{joint_path(robot, thruster.joint_id)}/rotor_{thruster.frame.replace('/', '_')}"
