"""The robot at rest on level ground, on its wheels or whatever reaches lowest."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.errors import RobotDescriptionError
from m4_dynamics.robot.robot import Robot

__all__ = ["joint_angles", "standing_configuration"]


def standing_configuration(robot: Robot, posture: str | None = None) -> NDArray[np.float64]:
    """Configuration with the base level and the lowest wheel or contact point touching the ground z = 0.

    A simulator that takes a wheel's width into account finds tilted wheels pressed into the ground.

    Args:
        robot: The robot; it needs a free-flyer root and at least one wheel.
        posture: Joint angles to take; None sets every joint to zero.

    Returns:
        The configuration, shape (nq,).

    Raises:
        RobotDescriptionError: The robot has no wheel, or its root is not a free-flyer.
        UnknownNameError: The robot has no such posture.
    """
    model = robot.model
    if not robot.wheels:
        raise RobotDescriptionError(f"robot '{robot.name}' has no wheels to stand on")
    if model.njoints < 2 or model.joints[1].nq != 7:
        raise RobotDescriptionError(f"robot '{robot.name}' must have a free-flyer root joint to stand on the ground")
    q = pin.neutral(model) if posture is None else robot.posture(posture).configuration.copy()
    q[:7] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    lowest = math.inf
    for wheel in robot.wheels:
        placement = data.oMi[wheel.joint_id]
        axis_in_world = placement.rotation @ wheel.axis_in_joint
        # The rim of a tilted disc reaches less far down.
        reach = wheel.radius * math.sqrt(max(0.0, 1.0 - axis_in_world[2] ** 2))
        lowest = min(lowest, placement.translation[2] - reach)
    for point in robot.contact_points:
        position_in_world = data.oMi[point.joint_id].act(np.asarray(point.position_in_joint))
        lowest = min(lowest, float(position_in_world[2]))
    q[2] = -lowest
    return np.asarray(q)


def joint_angles(robot: Robot, configuration: NDArray[np.float64]) -> Iterator[tuple[str, float]]:
    """Name and angle of every joint but the root, as simulators with one number per joint want them.

    Args:
        robot: The robot.
        configuration: Its configuration, shape (nq,).

    Yields:
        (name, angle [rad], or position [m] of a sliding joint).

    Raises:
        RobotDescriptionError: A joint has more than one degree of freedom.
    """
    model = robot.model
    for name, joint in zip(list(model.names)[2:], list(model.joints)[2:], strict=True):
        if joint.nv != 1:
            raise RobotDescriptionError(
                f"robot '{robot.name}': joint '{name}' has {joint.nv} degrees of freedom; the comparison takes one"
            )
        entry = configuration[joint.idx_q : joint.idx_q + joint.nq]
        yield name, float(entry[0]) if joint.nq == 1 else math.atan2(entry[1], entry[0])
