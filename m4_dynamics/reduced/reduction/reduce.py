"""From the full robot to the planar pendulum: composite inertia in a posture, nothing tuned by hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import RobotDescriptionError, require_finite, require_shape
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.reduction.frame import BalanceFrame, balance_frame, drive_wheel_joints
from m4_dynamics.reduced.reduction.outline import body_outline
from m4_dynamics.reduced.reduction.projection import Residual, residual
from m4_dynamics.reduced.trim_limits import TrimLimits
from m4_dynamics.robot.robot import Robot

__all__ = ["Reduction", "reduce_robot"]

_Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Reduction:
    """A robot reduced to the planar pendulum in one posture.

    Attributes:
        parameters: The pendulum.
        frame: Its axes on the robot.
        posture: Name of the posture.
        configuration: The posture with the base at the world's origin, shape (nq,).
        thrust_shares: Share of the total thrust that each of the robot's thrusters gives, shape (thrusters,).
        thrust_max: Greatest total thrust of the balancing thrusters [N].
        com_lateral: How far the robot's CoM lies to the pendulum's left of the sagittal plane [m].
        outline_in_body: Convex outline (forward, up) of the body from the axle, shape (k, 2) [m], or None.
        residual: Disagreement with the full model.
    """

    parameters: MipParameters
    frame: BalanceFrame
    posture: str
    configuration: _Array
    thrust_shares: _Array
    thrust_max: float
    com_lateral: float
    outline_in_body: _Array | None
    residual: Residual

    @property
    def residual_in_plane(self) -> float:
        """Relative disagreement of mass matrix, bias and input map."""
        return self.residual.in_plane

    @property
    def residual_out_of_plane(self) -> float:
        """Lateral force, roll and yaw moment that the contacts must carry, relative."""
        return self.residual.out_of_plane

    def trim_limits(self, **changes: Any) -> TrimLimits:
        """Limits of this robot's trims: its thrust range and outline, other entries as given or by default."""
        known: dict[str, Any] = {"thrust_range": (0.0, self.thrust_max), "outline_in_body": self.outline_in_body}
        return TrimLimits(**{**known, **changes})


class _Planar(NamedTuple):
    """What the projection needs, before the reduction that holds its result exists."""

    frame: BalanceFrame
    configuration: _Array
    thrust_shares: _Array


def reduce_robot(robot: Robot, posture: str | None = None, *, configuration: ArrayLike | None = None) -> Reduction:
    """Reduce a robot to the planar pendulum, legs held in a posture.

    Args:
        robot: A robot whose description has a `[balance]` and a `[motor]` table.
        posture: Name of the posture; None takes the balancing posture.
        configuration: Joint angles to use instead of the posture's own, such as those of the loaded legs, shape (nq,);
            the base's pose in it is ignored.

    Returns:
        The pendulum with its axes and its residual against the full model.

    Raises:
        RobotDescriptionError: If the robot does not balance, or its wheels cannot form an axle.
        UnknownNameError: If there is no such posture.
    """
    balance = robot.require_balance()
    if robot.model.joints[1].nv != 6:
        raise RobotDescriptionError(f"robot '{robot.name}' must have a free-flyer root joint to balance")
    name = balance.posture if posture is None else posture
    q = np.array(robot.posture(name).configuration if configuration is None else configuration, dtype=float)
    require_shape("configuration", q, (robot.model.nq,))
    require_finite("configuration", q)
    q[:7] = pin.neutral(robot.model)[:7]
    frame = balance_frame(robot, q)

    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    wheels = drive_wheel_joints(robot, frame)
    body, wheel_pair = pin.Inertia.Zero(), pin.Inertia.Zero()
    for joint in range(1, robot.model.njoints):
        in_base = data.oMi[joint].act(robot.model.inertias[joint])
        if joint in wheels:
            wheel_pair += in_base
        else:
            body += in_base
    shares, thrust_max, thrust_point = _thrust(robot, frame, data)
    lateral = frame.lateral_in_base
    total = body + wheel_pair
    motor = robot.motor
    parameters = MipParameters(
        mass_body=body.mass,
        mass_wheel=wheel_pair.mass,
        inertia_body=float(lateral @ body.inertia @ lateral),
        inertia_wheel=_inertia_about_axle(wheel_pair, frame),
        com_in_body=_forward_and_up(body.lever, frame),
        thrust_point_in_body=thrust_point,
        wheel_radius=frame.wheel_radius,
        torque_constant=motor.torque_constant,
        back_emf_constant=motor.back_emf_constant,
        gravity=robot.gravity,
        # Thrusters share a command in fixed parts: their total lags as their mean does.
        thrust_time_constant=float(shares @ [thruster.time_constant for thruster in robot.thrusters]),
    )
    for array in (q, shares):
        array.setflags(write=False)
    return Reduction(
        parameters=parameters,
        frame=frame,
        posture=name,
        configuration=q,
        thrust_shares=shares,
        thrust_max=thrust_max,
        com_lateral=float((total.lever - frame.axle_in_base) @ lateral),
        outline_in_body=body_outline(robot, frame, q),
        residual=residual(robot, _Planar(frame, q, shares), parameters, thrust_max=thrust_max),
    )


def _forward_and_up(point_in_base: _Array, frame: BalanceFrame) -> tuple[float, float]:
    """Components of a point from the axle."""
    from_axle = point_in_base - frame.axle_in_base
    return float(from_axle @ frame.forward_in_base), float(from_axle @ frame.up_in_base)


def _inertia_about_axle(wheels: pin.Inertia, frame: BalanceFrame) -> float:
    """Inertia of both wheels about the axle [kg m^2]."""
    lateral = frame.lateral_in_base
    off_axle = np.cross(lateral, wheels.lever - frame.axle_in_base)
    return float(lateral @ wheels.inertia @ lateral + wheels.mass * off_axle @ off_axle)


def _thrust(robot: Robot, frame: BalanceFrame, data: pin.Data) -> tuple[_Array, float, tuple[float, float]]:
    """Shares of the balancing thrusters, in proportion to what they can give; their maximum; where they push."""
    balance = robot.require_balance()
    maxima = np.array([t.maximum_thrust if t.frame in balance.thrusters else 0.0 for t in robot.thrusters])
    thrust_max = float(maxima.sum())
    if thrust_max <= 0.0:
        return maxima, 0.0, (0.0, 0.0)
    shares = maxima / thrust_max
    points = np.array([data.oMi[t.joint_id].act(np.array(t.position_in_joint)) for t in robot.thrusters])
    return shares, thrust_max, _forward_and_up(shares @ points, frame)
