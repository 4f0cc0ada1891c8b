"""The reduced state from what the robot measures: wheel odometry and attitude (never the true axle position).

`BalanceEstimator` is for ideal sensors, which give the attitude exactly; for others see `control/inertial.py`.

phi is the absolute wheel angle: encoder angle + pitch, per wheel; forward travel is r times their mean, the heading
comes from their difference. Rotations are decomposed as yaw about z, roll about x, pitch about y, so that the pitch
turns about the axle.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

__all__ = ["IMU_ENTRIES", "BalanceEstimator", "StateEstimator"]

Array = NDArray[np.float64]

#: Entries of a flat measurement before the wheels': attitude quaternion (x, y, z, w), angular rate (3), proper
#: acceleration (3). Then come the wheels' joint angles without wrapping and the wheels' joint rates.
IMU_ENTRIES = 10

# Entries of an estimate.
_PHI, _PITCH, _PHI_RATE, _PITCH_RATE, _HEADING, _HEADING_RATE, _ROLL = range(7)
_ENTRIES = 7


class StateEstimator(Protocol):
    """What every estimator of a balancing robot offers.

    Attributes:
        slope: Inclination of the ground [rad]; may be set anew while the robot drives.
    """

    slope: float

    def reset(self, measurement: ArrayLike, *, wheel_angle: float = 0.0, heading: float = 0.0) -> None:
        """Start anew at a place: wheel angle and heading, positive left of uphill [rad]."""
        ...

    def relocate(self, measurement: ArrayLike, *, wheel_angle: float, heading: float) -> None:
        """Tell the odometry its place anew in the middle of a run; what is known of attitude and sensors stays."""
        ...

    def update(self, measurement: Array) -> Array:
        """Estimate from the next flat measurement: (wheel angle, pitch, and their rates), shape (4,), a fresh array."""
        ...

    @property
    def state(self) -> Array:
        """Last estimate of the reduced state, shape (4,), a fresh array."""
        ...

    @property
    def pitch(self) -> float:
        """Last estimate of the pitch [rad]."""
        ...

    @property
    def heading(self) -> float:
        """Positive left of uphill [rad]."""
        ...

    @property
    def heading_rate(self) -> float:
        """Rate about the slope normal [rad/s]."""
        ...

    @property
    def roll(self) -> float:
        """Roll about the direction of travel [rad]."""
        ...


@njit(cache=True)
def _estimate(
    measurement: Any, wheels: int, left: int, right: int, sign_left: float, sign_right: float, axes: Any, zero: Any,
    radius_over_track: float, normal_x: float, normal_z: float, out: Any,
) -> None:  # fmt: skip
    x, y, z, w = measurement[0], measurement[1], measurement[2], measurement[3]
    rotation = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    wx, wy, wz = measurement[4], measurement[5], measurement[6]
    forward_z = rotation[2][0] * axes[0, 0] + rotation[2][1] * axes[0, 1] + rotation[2][2] * axes[0, 2]
    lateral_z = rotation[2][0] * axes[1, 0] + rotation[2][1] * axes[1, 1] + rotation[2][2] * axes[1, 2]
    up_z = rotation[2][0] * axes[2, 0] + rotation[2][1] * axes[2, 1] + rotation[2][2] * axes[2, 2]
    pitch = np.arctan2(-forward_z, up_z)
    pitch_rate = wx * axes[1, 0] + wy * axes[1, 1] + wz * axes[1, 2]
    angle_left = sign_left * measurement[IMU_ENTRIES + left] + pitch - zero[0]
    angle_right = sign_right * measurement[IMU_ENTRIES + right] + pitch - zero[1]
    rate_left = sign_left * measurement[IMU_ENTRIES + wheels + left] + pitch_rate
    rate_right = sign_right * measurement[IMU_ENTRIES + wheels + right] + pitch_rate
    out[_PHI] = 0.5 * (angle_left + angle_right)
    out[_PITCH] = pitch
    out[_PHI_RATE] = 0.5 * (rate_left + rate_right)
    out[_PITCH_RATE] = pitch_rate
    out[_HEADING] = radius_over_track * (angle_right - angle_left) + zero[2]
    # The gyro's rate about the slope normal, which wheel slip does not disturb.
    out[_HEADING_RATE] = (
        normal_x * (rotation[0][0] * wx + rotation[0][1] * wy + rotation[0][2] * wz)
        + normal_z * (rotation[2][0] * wx + rotation[2][1] * wy + rotation[2][2] * wz)
    )  # fmt: skip
    out[_ROLL] = np.arcsin(min(1.0, max(-1.0, lateral_z)))


@dataclass(slots=True, eq=False)
class BalanceEstimator:
    """Wheel odometry and measured attitude to the reduced state and the heading.

    Attributes:
        axes_in_base: Forward, lateral (left) and up axes of the pendulum in the base frame, rows, shape (3, 3).
        wheels: Number of wheels in a measurement.
        drive_wheels: Indices of the left and the right drive wheel, seen along forward.
        wheel_signs: Joint rate times this is the rolling rate relative to the body, (left, right).
        wheel_radius: [m].
        track: Distance between the drive wheels [m].
        slope: Inclination of the ground [rad]; the heading turns about its normal.
        state: Last estimate (wheel angle, pitch, and their rates), shape (4,).
    """

    axes_in_base: Array
    wheels: int
    drive_wheels: tuple[int, int]
    wheel_signs: tuple[float, float]
    wheel_radius: float
    track: float
    slope: float
    _estimate: Array = field(init=False, repr=False)
    _zero: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.axes_in_base = np.ascontiguousarray(self.axes_in_base, dtype=float)
        self._estimate = np.zeros(_ENTRIES)
        self._zero = np.zeros(3)

    def reset(self, measurement: ArrayLike, *, wheel_angle: float = 0.0, heading: float = 0.0) -> None:
        """Tell the odometry where it is.

        Args:
            measurement: The measurement at that place.
            wheel_angle: Absolute wheel angle there [rad].
            heading: Heading there, positive left of uphill [rad].
        """
        self._zero[:] = 0.0, 0.0, heading
        values = np.asarray(measurement, dtype=float)
        self.update(values)
        left, right = self.drive_wheels
        pitch = self._estimate[_PITCH]
        self._zero[0] = self.wheel_signs[0] * values[IMU_ENTRIES + left] + pitch - wheel_angle
        self._zero[1] = self.wheel_signs[1] * values[IMU_ENTRIES + right] + pitch - wheel_angle
        self.update(values)

    def relocate(self, measurement: ArrayLike, *, wheel_angle: float, heading: float) -> None:
        """The same as `reset`: with ideal sensors there is nothing else to lose."""
        self.reset(measurement, wheel_angle=wheel_angle, heading=heading)

    def update(self, measurement: Array) -> Array:
        """Estimate from one measurement.

        Args:
            measurement: Flat measurement, shape (10 + 2 wheels,): attitude, angular rate, proper acceleration, wheel
                joint angles without wrapping, wheel joint rates.

        Returns:
            (wheel angle, pitch, and their rates), shape (4,), a fresh array.
        """
        _estimate(
            measurement, self.wheels, self.drive_wheels[0], self.drive_wheels[1], self.wheel_signs[0],
            self.wheel_signs[1], self.axes_in_base, self._zero, self.wheel_radius / self.track,
            -np.sin(self.slope), np.cos(self.slope), self._estimate,
        )  # fmt: skip
        return self._estimate[:4].copy()

    @property
    def state(self) -> Array:
        """Last estimate of the reduced state, shape (4,), a fresh array."""
        return self._estimate[:4].copy()

    @property
    def pitch(self) -> float:
        """Last estimate of the pitch [rad]."""
        return float(self._estimate[_PITCH])

    @property
    def heading(self) -> float:
        """Heading from the wheels' difference, positive left of uphill [rad]."""
        return float(self._estimate[_HEADING])

    @property
    def heading_rate(self) -> float:
        """Rate about the slope normal, from the gyro [rad/s]."""
        return float(self._estimate[_HEADING_RATE])

    @property
    def roll(self) -> float:
        """Roll about the direction of travel [rad]."""
        return float(self._estimate[_ROLL])
