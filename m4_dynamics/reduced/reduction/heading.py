"""Linear yaw dynamics about the slope normal while the robot rolls on its two wheels.

On a slope the CoM sits uphill of the axle and the wheels are free to roll apart, so gravity turns the robot away from
straight uphill: with small yaw angle psi and differential duty delta (right wheel u_m + delta, left wheel u_m - delta)

    J psi'' = K psi - D psi' + k1 (d / 2r) delta.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from m4_dynamics.reduced.reduction.frame import slope_normal, slope_tangent
from m4_dynamics.reduced.reduction.placement import configuration_on_slope
from m4_dynamics.reduced.reduction.reduce import Reduction
from m4_dynamics.robot.robot import Robot

__all__ = ["HeadingDynamics", "heading_dynamics"]


class HeadingDynamics(NamedTuple):
    """Coefficients of the yaw equation at one slope, pitch and speed.

    Attributes:
        yaw_inertia: J, about the slope normal through the midpoint of the contacts, the opposite spin of the wheels
            included [kg m^2].
        gravity_stiffness: K, destabilising if positive: weight times the CoM's distance uphill of the axle times
            sin(slope) [N m/rad].
        damping: D, of back-EMF and of the CoM's distance ahead of a rolling axle [N m s/rad].
        duty_gain: k1 d / 2r, yaw moment per differential duty [N m].
        track: d, distance between the drive wheels [m].
        wheel_radius: r [m].
    """

    yaw_inertia: float
    gravity_stiffness: float
    damping: float
    duty_gain: float
    track: float
    wheel_radius: float

    @property
    def growth_rate(self) -> float:
        """Fastest growth of a heading error without control [1/s]; 0 on level ground."""
        half = 0.5 * self.damping / self.yaw_inertia
        discriminant = half**2 + self.gravity_stiffness / self.yaw_inertia
        return -half + math.sqrt(discriminant) if discriminant > 0.0 else -half


def heading_dynamics(
    robot: Robot, reduction: Reduction, *, slope: float, pitch: float, speed: float = 0.0
) -> HeadingDynamics:
    """Yaw dynamics about straight uphill.

    Args:
        robot: The robot.
        reduction: Its reduction.
        slope: Inclination of the ground [rad].
        pitch: theta [rad].
        speed: Along the slope [m/s].

    Returns:
        The coefficients.
    """
    model, data = robot.model, robot.model.createData()
    pin.ccrba(model, data, configuration_on_slope(robot, reduction, slope=slope, pitch=pitch), np.zeros(model.nv))
    frame, parameters = reduction.frame, reduction.parameters
    normal = slope_normal(slope)
    com_from_contact = np.array(data.com[0])  # the midpoint of the contacts is the world's origin
    off_normal = np.cross(normal, com_from_contact)
    composite = float(normal @ data.Ig.inertia @ normal + data.Ig.mass * off_normal @ off_normal)
    spread = frame.track / (2.0 * frame.wheel_radius)  # wheel angle per yaw angle, opposite on both sides
    com_uphill = float(com_from_contact @ slope_tangent(slope))
    return HeadingDynamics(
        yaw_inertia=composite + parameters.inertia_wheel * spread**2,
        gravity_stiffness=data.Ig.mass * parameters.gravity * com_uphill * math.sin(slope),
        damping=parameters.back_emf_constant * spread**2 + data.Ig.mass * com_uphill * speed,
        duty_gain=parameters.torque_constant * spread,
        track=frame.track,
        wheel_radius=frame.wheel_radius,
    )
