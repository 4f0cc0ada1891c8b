"""What the robot can measure: an IMU on the base and an encoder on every wheel.

A measurement is one flat array, so that it can be made, disturbed and read in microseconds. Without a sensor model the
entries are exact; a `SensorModel` adds quantisation, noise and bias, seeded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from m4_dynamics.control.estimator import IMU_ENTRIES
from m4_dynamics.errors import InvalidSettingError

__all__ = ["Measurement", "SensorModel", "disturb", "measure"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """A readable view of one measurement.

    Attributes:
        time: [s].
        attitude: Orientation of the base in the world, quaternion (x, y, z, w), shape (4,).
        angular_rate_in_base: Shape (3,) [rad/s].
        proper_acceleration_in_base: What an accelerometer reads, mean over the last sample, shape (3,) [m/s^2].
        wheel_angle: Joint angles counted without wrapping, shape (wheels,) [rad].
        wheel_rate: Joint rates, shape (wheels,) [rad/s].
    """

    time: float
    attitude: Array
    angular_rate_in_base: Array
    proper_acceleration_in_base: Array
    wheel_angle: Array
    wheel_rate: Array

    @classmethod
    def from_array(cls, time: float, values: Array) -> Measurement:
        """Copy a flat measurement into its parts; layout: IMU, wheel angles, wheel rates."""
        wheels = (len(values) - IMU_ENTRIES) // 2
        return cls(
            time=time,
            attitude=values[0:4].copy(),
            angular_rate_in_base=values[4:7].copy(),
            proper_acceleration_in_base=values[7:10].copy(),
            wheel_angle=values[IMU_ENTRIES : IMU_ENTRIES + wheels].copy(),
            wheel_rate=values[IMU_ENTRIES + wheels :].copy(),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorModel:
    """Imperfections of the sensors; every default is the ideal sensor.

    Attributes:
        encoder_resolution: Angle of one encoder count; the rate is the count difference over one sample [rad].
        attitude_noise: Standard deviation of roll, pitch and yaw of the attitude solution [rad].
        gyro_noise: Standard deviation of one angular-rate sample [rad/s].
        gyro_bias: Constant offset of every angular rate [rad/s].
        accelerometer_noise: Standard deviation of one acceleration sample [m/s^2].
        seed: Seed of the noise.
    """

    encoder_resolution: float = 0.0
    attitude_noise: float = 0.0
    gyro_noise: float = 0.0
    gyro_bias: float = 0.0
    accelerometer_noise: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("encoder_resolution", "attitude_noise", "gyro_noise", "accelerometer_noise"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidSettingError(name, value, "a finite number >= 0")
        if not math.isfinite(self.gyro_bias):
            raise InvalidSettingError("gyro_bias", self.gyro_bias, "a finite number")


@njit(cache=True)
def measure(
    configuration: Any, velocity: Any, previous_velocity: Any, wheel_angles: Any, wheel_velocity_indices: Any,
    period: float, gravity: float, out: Any,
) -> None:  # fmt: skip
    """Fill an exact measurement.

    Args:
        configuration: q, shape (nq,).
        velocity: v now, shape (nv,).
        previous_velocity: v one sample ago, shape (nv,).
        wheel_angles: Joint angles without wrapping, shape (wheels,) [rad].
        wheel_velocity_indices: Index of each wheel's joint in v.
        period: Time between samples [s].
        gravity: [m/s^2].
        out: Filled, shape (10 + 2 wheels,).
    """
    for i in range(4):
        out[i] = configuration[3 + i]
    x, y, z, w = out[0], out[1], out[2], out[3]
    wx, wy, wz = velocity[3], velocity[4], velocity[5]
    out[4], out[5], out[6] = wx, wy, wz
    # Proper acceleration = v' + omega x v - R^T g, all in base axes.
    vx, vy, vz = velocity[0], velocity[1], velocity[2]
    out[7] = (vx - previous_velocity[0]) / period + wy * vz - wz * vy + gravity * 2.0 * (x * z - w * y)
    out[8] = (vy - previous_velocity[1]) / period + wz * vx - wx * vz + gravity * 2.0 * (y * z + w * x)
    out[9] = (vz - previous_velocity[2]) / period + wx * vy - wy * vx + gravity * (1.0 - 2.0 * (x * x + y * y))
    wheels = wheel_angles.shape[0]
    for i in range(wheels):
        out[IMU_ENTRIES + i] = wheel_angles[i]
        out[IMU_ENTRIES + wheels + i] = velocity[wheel_velocity_indices[i]]


def disturb(
    model: SensorModel, generator: np.random.Generator, exact: Array, previous_wheel_angles: Array, period: float
) -> Array:
    """A measurement as imperfect sensors would give it.

    Args:
        model: The imperfections.
        generator: Source of the noise.
        exact: Exact measurement, shape (10 + 2 wheels,).
        previous_wheel_angles: Measured wheel angles of the sample before, shape (wheels,) [rad].
        period: Time between samples [s].

    Returns:
        The disturbed measurement, same shape.
    """
    out = exact.copy()
    wheels = (len(exact) - IMU_ENTRIES) // 2
    if model.attitude_noise > 0.0:
        half = 0.5 * model.attitude_noise * generator.standard_normal(3)
        x, y, z, w = exact[:4]
        # Quaternion product with the small rotation (half, 1).
        out[:3] = (
            x + w * half[0] + y * half[2] - z * half[1],
            y + w * half[1] + z * half[0] - x * half[2],
            z + w * half[2] + x * half[1] - y * half[0],
        )
        out[3] = w - x * half[0] - y * half[1] - z * half[2]
        out[:4] /= np.linalg.norm(out[:4])
    out[4:7] += model.gyro_bias + model.gyro_noise * generator.standard_normal(3)
    out[7:10] += model.accelerometer_noise * generator.standard_normal(3)
    if model.encoder_resolution > 0.0:
        angles = model.encoder_resolution * np.round(
            exact[IMU_ENTRIES : IMU_ENTRIES + wheels] / model.encoder_resolution
        )
        out[IMU_ENTRIES : IMU_ENTRIES + wheels] = angles
        out[IMU_ENTRIES + wheels :] = (angles - previous_wheel_angles) / period
    return out
