"""The pendulum's axes on a robot: which way is forward, up and left when it balances on two wheels.

Nothing about them is hard-coded: the lateral line is the drive wheels' common axis in the posture, forward is the
thrust direction (or what the description says), up is the side of the axle on which the centre of mass lies, and the
lateral axis completes a right-handed triad, so that positive rotation about it leans the body forward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import RobotDescriptionError
from m4_dynamics.robot.robot import Robot, Wheel

__all__ = [
    "BalanceFrame",
    "PlanarPosture",
    "balance_frame",
    "drive_wheel_joints",
    "slope_normal",
    "slope_tangent",
]

_Array = NDArray[np.float64]

#: Drive wheels may be cambered this far from their common axis before the pendulum is refused [rad].
_COAXIAL_TOLERANCE = math.radians(5.0)


@dataclass(frozen=True, slots=True, eq=False)
class BalanceFrame:
    """Where the pendulum sits in the robot's base frame, in a given posture.

    Attributes:
        forward_in_base: MIP x axis, the direction of thrust, shape (3,).
        lateral_in_base: MIP y axis (left), about which pitch and wheel angle are positive, shape (3,).
        up_in_base: MIP z axis, shape (3,).
        axle_in_base: Midpoint of the two drive wheels, shape (3,) [m].
        wheel_joints: Joints of the drive wheels, in the description's order.
        wheel_signs: Sign of each joint's axis against the lateral axis: joint rate = sign (phi' - theta'), shape (2,).
        wheel_offsets: Lateral position of each wheel, positive on the pendulum's left, shape (2,) [m].
        wheel_radius: [m].
    """

    forward_in_base: _Array
    lateral_in_base: _Array
    up_in_base: _Array
    axle_in_base: _Array
    wheel_joints: tuple[str, str]
    wheel_signs: _Array
    wheel_offsets: _Array
    wheel_radius: float

    @property
    def track(self) -> float:
        """Distance between the drive wheels along the axle [m]."""
        return float(abs(self.wheel_offsets[0] - self.wheel_offsets[1]))

    @property
    def rotation_in_base(self) -> _Array:
        """Columns forward, lateral, up: rotates MIP components into the base, shape (3, 3)."""
        return np.column_stack([self.forward_in_base, self.lateral_in_base, self.up_in_base])

    def base_rotation_in_world(self, slope: float, pitch: float, yaw: float = 0.0) -> _Array:
        """Orientation of the base for a pitch in the sagittal plane, then turned by yaw about the slope normal.

        Args:
            slope: Inclination of the ground [rad].
            pitch: theta [rad]; the body leans theta + slope forward from the slope normal, whatever the yaw.
            yaw: About the slope normal [rad], 0 heads straight uphill.

        Returns:
            Rotation matrix from base to world, shape (3, 3).
        """
        about_normal = pin.AngleAxis(yaw, slope_normal(slope)).toRotationMatrix()
        about_lateral = pin.AngleAxis(pitch, np.array([0.0, 1.0, 0.0])).toRotationMatrix()
        return np.asarray(about_normal @ about_lateral @ self.rotation_in_base.T)

    def pitch_and_yaw(self, slope: float, base_rotation_in_world: ArrayLike) -> tuple[float, float]:
        """Pitch and yaw of a given orientation, the inverse of `base_rotation_in_world`; a roll is ignored.

        Args:
            slope: Inclination of the ground [rad].
            base_rotation_in_world: Rotation matrix from base to world, shape (3, 3).

        Returns:
            theta, with theta + slope in (-pi, pi], and yaw about the slope normal in (-pi, pi] [rad].
        """
        rotation = np.asarray(base_rotation_in_world, dtype=float)
        lateral, up = rotation @ self.lateral_in_base, rotation @ self.up_in_base
        normal = slope_normal(slope)
        heading = np.cross(lateral, normal)
        heading = heading / np.linalg.norm(heading)
        pitch_to_normal = math.atan2(float(up @ heading), float(up @ normal))
        yaw = math.atan2(float(heading[1]), float(heading @ slope_tangent(slope)))
        return pitch_to_normal - slope, yaw


class PlanarPosture(Protocol):
    """What placing and projecting a robot needs to know; a `Reduction` is one."""

    @property
    def frame(self) -> BalanceFrame:
        """The pendulum's axes."""

    @property
    def configuration(self) -> _Array:
        """Posture with the base at the world's origin, shape (nq,)."""

    @property
    def thrust_shares(self) -> _Array:
        """Share of the total thrust that each of the robot's thrusters gives, shape (thrusters,)."""


def slope_tangent(slope: float) -> _Array:
    """Unit vector uphill along the slope, in the world, shape (3,)."""
    return np.array([math.cos(slope), 0.0, math.sin(slope)])


def slope_normal(slope: float) -> _Array:
    """Unit vector out of the slope, in the world, shape (3,)."""
    return np.array([-math.sin(slope), 0.0, math.cos(slope)])


def drive_wheel_joints(robot: Robot, frame: BalanceFrame) -> frozenset[int]:
    """Joints whose bodies turn with a drive wheel: the wheel joints and whatever hangs on them."""
    return frozenset(
        int(joint) for name in frame.wheel_joints for joint in robot.model.subtrees[robot.wheel(name).joint_id]
    )


def balance_frame(robot: Robot, configuration: ArrayLike) -> BalanceFrame:
    """Find the pendulum's axes from the posture, the wheel axes and the thrusters.

    Args:
        robot: A robot with a `[balance]` table.
        configuration: Full configuration with the base at the world's origin, shape (nq,).

    Returns:
        The frame.

    Raises:
        RobotDescriptionError: If the robot does not balance, its drive wheels are not coaxial or differ in radius, or
            the forward direction lies along the axle.
    """
    balance = robot.require_balance()
    q = np.asarray(configuration, dtype=float)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    wheels = (robot.wheel(balance.drive_wheels[0]), robot.wheel(balance.drive_wheels[1]))
    axes = [data.oMi[wheel.joint_id].rotation @ wheel.axis_in_joint for wheel in wheels]
    centres = [data.oMi[wheel.joint_id].translation.copy() for wheel in wheels]
    axle_line = _common_axis(robot, wheels, axes, centres)
    axle = 0.5 * (centres[0] + centres[1])

    hint = _forward_hint(robot, data)
    forward = hint - axle_line * (axle_line @ hint)
    if np.linalg.norm(forward) < 0.1:
        raise RobotDescriptionError(
            f"robot '{robot.name}' has no forward direction in this posture: its thrust cancels or lies along the axle "
            f"of '{wheels[0].joint}' and '{wheels[1].joint}'; give balance.forward a direction across the axle"
        )
    forward = forward / np.linalg.norm(forward)
    up = np.cross(forward, axle_line)
    com_from_axle = pin.centerOfMass(robot.model, data, q) - axle
    if up @ com_from_axle < 0.0:
        up = -up
    lateral = np.cross(up, forward)
    return BalanceFrame(
        forward_in_base=_frozen(forward),
        lateral_in_base=_frozen(lateral),
        up_in_base=_frozen(up),
        axle_in_base=_frozen(axle),
        wheel_joints=(wheels[0].joint, wheels[1].joint),
        wheel_signs=_frozen(np.sign([axis @ lateral for axis in axes])),
        wheel_offsets=_frozen(np.array([(centre - axle) @ lateral for centre in centres])),
        wheel_radius=wheels[0].radius,
    )


def _common_axis(robot: Robot, wheels: tuple[Wheel, Wheel], axes: list[_Array], centres: list[_Array]) -> _Array:
    """Unit vector along the axle, the mean of the two wheels' axes."""
    names = f"drive wheels '{wheels[0].joint}' and '{wheels[1].joint}' of robot '{robot.name}'"
    second = axes[1] if axes[0] @ axes[1] >= 0.0 else -axes[1]
    axis = axes[0] + second
    axis = axis / np.linalg.norm(axis)
    camber = math.acos(min(1.0, float(axis @ axes[0])))
    if camber > _COAXIAL_TOLERANCE:
        raise RobotDescriptionError(
            f"the {names} are not coaxial in the balancing posture: their axes differ by "
            f"{math.degrees(2.0 * camber):.1f} deg"
        )
    between = centres[1] - centres[0]
    if np.linalg.norm(np.cross(axis, between)) > math.sin(_COAXIAL_TOLERANCE) * np.linalg.norm(between):
        raise RobotDescriptionError(f"the {names} are not on one axle in the balancing posture")
    if not math.isclose(wheels[0].radius, wheels[1].radius, rel_tol=1e-6):
        raise RobotDescriptionError(f"the {names} must have one radius, got {wheels[0].radius} and {wheels[1].radius}")
    return np.asarray(axis)


def _forward_hint(robot: Robot, data: pin.Data) -> _Array:
    """Roughly forward, in the base, at most of length 1: as described, or the mean thrust direction, or base x."""
    balance = robot.require_balance()
    if balance.forward is not None:
        described = np.asarray(balance.forward, dtype=float)
        return np.asarray(described / np.linalg.norm(described))
    if not balance.thrusters:
        return np.array([1.0, 0.0, 0.0])
    thrusters = [robot.thruster(frame) for frame in balance.thrusters]
    directions = [data.oMi[thruster.joint_id].rotation @ thruster.direction_in_joint for thruster in thrusters]
    return np.asarray(np.mean(directions, axis=0))


def _frozen(values: ArrayLike) -> _Array:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
