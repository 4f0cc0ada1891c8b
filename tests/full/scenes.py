"""M4 put on the ground, for tests that step it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.full.model import FullModel
from m4_dynamics.full.terrain import incline_terrain
from m4_dynamics.robot.robot import Ground, Robot

Array = NDArray[np.float64]


def on_incline(robot: Robot, slope: float = 0.0, *, ground: Ground | None = None) -> FullModel:
    """The robot's model on one endless face."""
    return FullModel.build(robot, incline_terrain(slope), ground=ground)


def lowest_point(model: FullModel, q: Array, slope: float = 0.0) -> float:
    """Least distance of a wheel's rim or a contact point from the face through the origin, negative below it."""
    normal = np.array([-np.sin(slope), 0.0, np.cos(slope)])
    robot, data = model.robot, model.robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    heights = [data.oMi[point.joint_id].act(point.position_in_joint) @ normal for point in robot.contact_points]
    for wheel in robot.wheels:
        placement = data.oMi[wheel.joint_id]
        lean = (placement.rotation @ wheel.axis_in_joint) @ normal
        heights.append(placement.translation @ normal - wheel.radius * np.sqrt(1.0 - lean**2))
    return float(min(heights))


def placed(model: FullModel, posture: str, *, slope: float = 0.0, above: float = 0.0) -> Array:
    """A posture, turned with the slope, its lowest point at a height above the face through the origin."""
    q: Array = model.robot.posture(posture).configuration.copy()
    turn = pin.rpy.rpyToMatrix(0.0, -slope, 0.0) @ pin.Quaternion(q[3:7]).toRotationMatrix()
    q[3:7] = pin.Quaternion(turn).coeffs()
    q[:3] += (above - lowest_point(model, q, slope)) * np.array([-np.sin(slope), 0.0, np.cos(slope)])
    return q
