"""What the legs carry at an equilibrium, and how far they give way under it.

The pendulum takes the legs as rigid. On the full model position servos hold them, each giving way by torque over
stiffness, so the loaded posture differs from the nominal one by a little.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.errors import RobotDescriptionError
from m4_dynamics.reduced.reduction.frame import slope_normal, slope_tangent
from m4_dynamics.reduced.reduction.projection import contact_wrench, planar_configuration
from m4_dynamics.reduced.reduction.reduce import Reduction
from m4_dynamics.reduced.trim import Trim
from m4_dynamics.robot.robot import Robot

__all__ = ["HoldingLoads", "holding_torques", "loaded_configuration"]

_Array = NDArray[np.float64]


class HoldingLoads(NamedTuple):
    """Static loads of the legs at an equilibrium.

    Attributes:
        torques: That each servo must give, in the order of `robot.servos`, shape (servos,) [N m].
        sag: Commanded less actual angle of each servo, torque over stiffness, shape (servos,) [rad].
        contact_forces: On each drive wheel, along the slope, to the left, along the normal, shape (2, 3) [N].
    """

    torques: _Array
    sag: _Array
    contact_forces: _Array


def holding_torques(robot: Robot, reduction: Reduction, trim: Trim) -> HoldingLoads:
    """Servo torques at an equilibrium, from the full model's equations of motion and the forces of the ground.

    Two wheels leave the sharing of a lateral force open; it is split evenly.

    Args:
        robot: The robot.
        reduction: Its reduction.
        trim: The equilibrium.

    Returns:
        Servo torques, sag and contact forces.

    Raises:
        RobotDescriptionError: If a servo has no stiffness and so cannot hold anything.
    """
    for servo in robot.servos:
        if not servo.stiffness > 0.0:
            raise RobotDescriptionError(f"servo '{servo.joint}' has stiffness {servo.stiffness}; it cannot hold a leg")
    wheel_acceleration = trim.acceleration / reduction.frame.wheel_radius
    wrench = contact_wrench(
        robot, reduction, trim.slope, trim.state, (wheel_acceleration, 0.0), (trim.torque, trim.thrust)
    )
    jacobian = _contact_jacobian(robot, reduction, trim)
    # Six equations of the base for six components, of which only the sum of the lateral ones is determined: least norm.
    forces, *_ = np.linalg.lstsq(jacobian[:, :6].T, wrench.generalised[:6], rcond=1e-9)
    left = wrench.generalised - jacobian.T @ forces
    torques = np.array([left[servo.index_v] for servo in robot.servos])
    stiffness = np.array([servo.stiffness for servo in robot.servos])
    return HoldingLoads(torques, torques / stiffness, np.asarray(forces.reshape(2, 3), dtype=np.float64))


def loaded_configuration(robot: Robot, reduction: Reduction, loads: HoldingLoads) -> _Array:
    """Posture of the loaded legs: the nominal one less the sag; reduce the robot in it to see the difference.

    Args:
        robot: The robot.
        reduction: Its reduction in the nominal posture.
        loads: Loads at an equilibrium.

    Returns:
        Configuration with the base at the world's origin, shape (nq,).
    """
    q = np.array(reduction.configuration)
    for servo, sag in zip(robot.servos, loads.sag, strict=True):
        q[servo.index_q] -= sag
    return q


def _contact_jacobian(robot: Robot, reduction: Reduction, trim: Trim) -> _Array:
    """Jacobian of the two rims' material points on the ground, in slope axes, shape (6, nv)."""
    model, data = robot.model, robot.model.createData()
    q = planar_configuration(robot, reduction, trim.slope, trim.state)
    pin.computeJointJacobians(model, data, q)
    axes = np.stack([slope_tangent(trim.slope), np.array([0.0, 1.0, 0.0]), slope_normal(trim.slope)])
    to_rim = -reduction.frame.wheel_radius * slope_normal(trim.slope)
    blocks = []
    for name in reduction.frame.wheel_joints:
        jacobian = pin.getJointJacobian(model, data, robot.wheel(name).joint_id, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        blocks.append(axes @ (jacobian[:3] - pin.skew(to_rim) @ jacobian[3:]))
    return np.vstack(blocks)
