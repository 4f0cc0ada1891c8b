"""Heading hold by differential wheel duty, with gains from pole placement.

On a slope the CoM lies uphill of the axle, so gravity turns any yaw further: about the slope normal a robot on two
rolling wheels is an inverted pendulum. With the yaw psi (positive turns left), the duties of the two wheels
u + delta (right) and u - delta (left), and each wheel's motor giving half of k1 and k2,

    J psi'' = K psi - c psi' + b delta,   b = k1 track / (2 r),   c = k2 track^2 / (4 r^2),

where K is the destabilising stiffness and c the motors' own damping. An integral of the yaw error stands against
constant moments: a CoM beside the sagittal plane, rotors of unequal strength.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from m4_dynamics.errors import InvalidSettingError, require_finite

__all__ = ["HeadingGains", "HeadingHold", "heading_gains", "heading_stiffness", "wheel_duties"]


def heading_stiffness(*, weight: float, slope: float, com_uphill_of_axle: float) -> float:
    """Destabilising stiffness of gravity in yaw: the moment about the slope normal per radian of yaw.

    Args:
        weight: Weight of the whole robot [N].
        slope: Inclination of the ground [rad].
        com_uphill_of_axle: Distance of the whole robot's CoM from the axle, along the slope, positive uphill [m].

    Returns:
        K [N m/rad]; positive drives the yaw away, negative brings it back.
    """
    return weight * math.sin(slope) * com_uphill_of_axle


def heading_gains(
    *,
    yaw_inertia: float,
    track: float,
    wheel_radius: float,
    stiffness: float,
    torque_constant: float,
    back_emf_constant: float,
    natural_frequency: float,
    damping_ratio: float,
    integral_frequency: float = 0.0,
) -> HeadingGains:
    """Gains of delta = -(k_p yaw error + k_d yaw rate + k_i integral of the error) that place all poles of the yaw.

    The closed loop is (s^2 + 2 zeta w s + w^2) (s + w_i).

    Args:
        yaw_inertia: J about the slope normal through the middle of the axle, wheels' spin included [kg m^2].
        track: Distance between the wheels' contact points [m].
        wheel_radius: r [m].
        stiffness: K, see `heading_stiffness` [N m/rad].
        torque_constant: k1 of both motors together [N m].
        back_emf_constant: k2 of both motors together [N m s].
        natural_frequency: w [rad/s].
        damping_ratio: zeta.
        integral_frequency: w_i, the pole of the integral [1/s]; 0 does without it.

    Returns:
        The gains.

    Raises:
        InvalidSettingError: If a number that must be positive is not.
    """
    require_finite("stiffness", stiffness)
    require_finite("back_emf_constant", back_emf_constant)
    if not (math.isfinite(integral_frequency) and integral_frequency >= 0.0):
        raise InvalidSettingError("integral_frequency", integral_frequency, "a finite number >= 0")
    for name, value in (
        ("yaw_inertia", yaw_inertia),
        ("track", track),
        ("wheel_radius", wheel_radius),
        ("torque_constant", torque_constant),
        ("natural_frequency", natural_frequency),
        ("damping_ratio", damping_ratio),
    ):
        if not (math.isfinite(value) and value > 0.0):
            raise InvalidSettingError(name, value, "a finite number > 0")
    leverage = torque_constant * track / (2.0 * wheel_radius)
    motor_damping = back_emf_constant * track**2 / (4.0 * wheel_radius**2)
    second, third = 2.0 * damping_ratio * natural_frequency, natural_frequency**2
    return HeadingGains(
        yaw=(yaw_inertia * (third + second * integral_frequency) + stiffness) / leverage,
        rate=((second + integral_frequency) * yaw_inertia - motor_damping) / leverage,
        integral=yaw_inertia * third * integral_frequency / leverage,
    )


class HeadingGains(NamedTuple):
    """Differential duty per unit of error.

    Attributes:
        yaw: k_p [1/rad].
        rate: k_d [s/rad].
        integral: k_i [1/(rad s)].
    """

    yaw: float
    rate: float
    integral: float = 0.0


@dataclass(slots=True, kw_only=True)
class HeadingHold:
    """Differential duty from yaw error, yaw rate and the integral of the error.

    Attributes:
        gains: See `heading_gains`.
        period: Time between two calls of `control` [s].
        maximum: Largest differential duty; also the share of the duty that `wheel_duties` keeps for the heading.
        standing: Duty that the integral has come to; it waits while the sum is limited, so as not to wind up.
    """

    gains: HeadingGains
    period: float = 5e-3
    maximum: float = 0.3
    standing: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a share of the duty outside (0, 1]."""
        require_finite("heading gains", self.gains, HeadingGains._fields)
        if not 0.0 < self.maximum <= 1.0:
            raise InvalidSettingError("maximum", self.maximum, "a share of the duty in (0, 1]")

    def control(self, yaw_error: float, yaw_rate: float) -> float:
        """Differential duty for one sample.

        Args:
            yaw_error: Yaw minus wanted yaw, positive to the left [rad]; wrapped to half a turn here.
            yaw_rate: Rate of the yaw about the slope normal [rad/s].

        Returns:
            delta in [-maximum, maximum]; the right wheel gets the common duty plus it, the left one minus it.

        Raises:
            NonFiniteError: If error or rate is NaN or infinite.
        """
        if not (math.isfinite(yaw_error) and math.isfinite(yaw_rate)):
            require_finite("yaw", (yaw_error, yaw_rate), ("error", "rate"))
        wrapped = math.remainder(yaw_error, 2.0 * math.pi)
        differential = self.standing - (self.gains.yaw * wrapped + self.gains.rate * yaw_rate)
        if abs(differential) <= self.maximum:
            self.standing -= self.gains.integral * self.period * wrapped
        return min(max(differential, -self.maximum), self.maximum)


def wheel_duties(common: float, differential: float) -> tuple[float, float]:
    """Split a common and a differential duty onto two wheels, each within [-1, 1].

    The heading goes first: without it the robot turns round within a fraction of a second, while the balance outlives a
    slightly smaller duty. The common duty gives way as far as needed.

    Args:
        common: Motor duty u_m of the balance controller.
        differential: Duty of the heading hold, positive turns left.

    Returns:
        Duties of the right and of the left wheel, seen along the direction of travel.
    """
    share = min(max(differential, -1.0), 1.0)
    room = 1.0 - abs(share)
    base = min(max(common, -room), room)
    return base + share, base - share
