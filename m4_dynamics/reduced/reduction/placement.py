"""Full configurations and velocities of a robot that stands or rolls on a slope, from a few reduced figures."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.errors import require_finite
from m4_dynamics.reduced.reduction.frame import PlanarPosture, slope_normal, slope_tangent
from m4_dynamics.robot.robot import Robot

__all__ = ["configuration_on_slope", "velocity_on_slope"]

_Array = NDArray[np.float64]


def configuration_on_slope(
    robot: Robot,
    reduction: PlanarPosture,
    *,
    slope: float,
    position_along_slope: float = 0.0,
    pitch: float = 0.0,
    yaw: float = 0.0,
    penetration: float = 0.0,
) -> _Array:
    """Stand the robot with both drive wheels on a slope through the world's origin, climbing towards +x.

    Args:
        robot: The robot.
        reduction: Its reduction, which holds the posture.
        slope: Inclination of the ground [rad].
        position_along_slope: Of the axle's midpoint, from the origin uphill [m].
        pitch: theta [rad], the lean in the robot's sagittal plane less the slope (with yaw = 0: from the vertical).
        yaw: Turn about the slope normal [rad]; 0 heads straight uphill.
        penetration: Depth of the rims below the surface [m]; 0 touches it.

    Returns:
        Configuration q, shape (nq,). The wheels have rolled by position / r from where they stood at 0 m and pitch 0.

    Raises:
        NonFiniteError: If an argument is NaN or infinite.
    """
    labels = ("slope", "position_along_slope", "pitch", "yaw", "penetration")
    require_finite("placement", (slope, position_along_slope, pitch, yaw, penetration), labels)
    frame = reduction.frame
    turn = np.zeros(robot.model.nv)
    for name, sign in zip(frame.wheel_joints, frame.wheel_signs, strict=True):
        turn[robot.wheel(name).index_v] = sign * (position_along_slope / frame.wheel_radius - pitch)
    q = np.asarray(pin.integrate(robot.model, np.array(reduction.configuration), turn))
    rotation = frame.base_rotation_in_world(slope, pitch, yaw)
    height = frame.wheel_radius - penetration
    axle_in_world = position_along_slope * slope_tangent(slope) + height * slope_normal(slope)
    q[0:3] = axle_in_world - rotation @ frame.axle_in_base
    q[3:7] = pin.Quaternion(rotation).coeffs()
    return q


def velocity_on_slope(
    robot: Robot,
    reduction: PlanarPosture,
    *,
    slope: float,
    pitch: float = 0.0,
    yaw: float = 0.0,
    speed: float = 0.0,
    pitch_rate: float = 0.0,
    yaw_rate: float = 0.0,
) -> _Array:
    """Velocity of the robot rolling without slip on a slope, legs held.

    Args:
        robot: The robot.
        reduction: Its reduction.
        slope: Inclination of the ground [rad].
        pitch: theta [rad].
        yaw: About the slope normal [rad].
        speed: Of the axle's midpoint along the heading [m/s].
        pitch_rate: theta' [rad/s].
        yaw_rate: About the slope normal [rad/s]; the wheels roll apart accordingly.

    Returns:
        Velocity v with the base twist in base axes, shape (nv,).

    Raises:
        NonFiniteError: If an argument is NaN or infinite.
    """
    labels = ("slope", "pitch", "yaw", "speed", "pitch_rate", "yaw_rate")
    require_finite("motion", (slope, pitch, yaw, speed, pitch_rate, yaw_rate), labels)
    frame = reduction.frame
    rotation = frame.base_rotation_in_world(slope, pitch, yaw)
    normal, lateral = slope_normal(slope), rotation @ frame.lateral_in_base
    heading = np.cross(lateral, normal)
    angular = pitch_rate * lateral + yaw_rate * normal
    linear = speed * heading + np.cross(angular, -rotation @ frame.axle_in_base)

    velocity = np.zeros(robot.model.nv)
    velocity[0:3], velocity[3:6] = rotation.T @ linear, rotation.T @ angular
    for name, sign, offset in zip(frame.wheel_joints, frame.wheel_signs, frame.wheel_offsets, strict=True):
        wheel_rate = (speed - yaw_rate * offset) / frame.wheel_radius
        velocity[robot.wheel(name).index_v] = sign * (wheel_rate - pitch_rate)
    return velocity
