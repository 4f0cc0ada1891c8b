"""A robot in the postures of a map: reduced, with its limits and its collisions."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.feasibility.grid import MapGrid
from m4_dynamics.feasibility.static import PostureCase
from m4_dynamics.reduced.reduction import Reduction, reduce_robot
from m4_dynamics.robot.consistency import self_collisions
from m4_dynamics.robot.robot import Robot

__all__ = ["posture_case", "posture_cases", "posture_configuration"]

_Array = NDArray[np.float64]


def posture_configuration(robot: Robot, angles: Mapping[str, float], *, posture: str | None = None) -> _Array:
    """A posture with some joints at other angles.

    Args:
        robot: A robot that balances.
        angles: Joint -> angle [rad].
        posture: Name of the posture; None takes the balancing one.

    Returns:
        Configuration, shape (nq,).

    Raises:
        UnknownNameError: There is no such joint or posture.
        InvalidSettingError: A joint has not one angle, or its range does not hold the one given.
    """
    name = robot.require_balance().posture if posture is None else posture
    q = np.array(robot.posture(name).configuration, dtype=float)
    for joint, angle in angles.items():
        model_joint = robot.model.joints[robot.joint_id(joint)]
        if model_joint.nq != 1:
            raise InvalidSettingError("joint of the posture", joint, "a joint with one angle, such as a leg's")
        low = float(robot.model.lowerPositionLimit[model_joint.idx_q])
        high = float(robot.model.upperPositionLimit[model_joint.idx_q])
        if not low <= angle <= high:
            bounds = f"{math.degrees(low):.1f} to {math.degrees(high):.1f}"
            raise InvalidSettingError(f"angle of {joint} [deg]", round(math.degrees(angle), 6), bounds)
        q[model_joint.idx_q] = angle
    return q


def posture_case(robot: Robot, reduction: Reduction) -> PostureCase:
    """What a static map needs of a robot in one posture.

    Args:
        robot: The robot.
        reduction: Its reduction in that posture.

    Returns:
        Pendulum, limits and whether bodies overlap.
    """
    collides = bool(self_collisions(robot, reduction.configuration))
    return PostureCase(reduction.parameters, reduction.trim_limits(), collides)


def posture_cases(robot: Robot, grid: MapGrid, *, posture: str | None = None) -> list[PostureCase]:
    """Reduce the robot at every posture angle of a grid.

    Args:
        robot: A robot that balances.
        grid: The map's axes.
        posture: Name of the posture; None takes the balancing one.

    Returns:
        One case for each posture angle.

    Raises:
        UnknownNameError: There is no such joint or posture.
        InvalidSettingError: A joint cannot turn that far.
        RobotDescriptionError: The robot does not balance.
    """
    if not grid.posture_joints:
        return [posture_case(robot, reduce_robot(robot, posture))]
    cases = []
    for angle in grid.axes["posture_angle"]:
        q = posture_configuration(robot, dict.fromkeys(grid.posture_joints, float(angle)), posture=posture)
        cases.append(posture_case(robot, reduce_robot(robot, posture, configuration=q)))
    return cases
