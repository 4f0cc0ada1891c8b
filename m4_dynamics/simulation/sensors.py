"""What the robot can measure: an IMU on the base and an encoder on every wheel.

A measurement is one flat array, so that it can be made, disturbed and read in microseconds. The plant's `Fidelity` says
whether its entries are exact or quantised and noisy, and whether the attitude is among them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from m4_dynamics.control.estimator import IMU_ENTRIES
from m4_dynamics.control.imu import ImuErrors
from m4_dynamics.simulation.fidelity import Fidelity

__all__ = ["Measurement", "Sensors", "measure"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """A readable view of one measurement.

    Attributes:
        time: [s].
        attitude: Orientation of the base in the world, quaternion (x, y, z, w), shape (4,); NaN if it is not measured.
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


@njit(cache=True)
def _disturb(
    exact: Any, normals: Any, deviations: Any, bias: Any, attitude_given: bool, resolution: float, period: float,
    out: Any,
) -> None:  # fmt: skip
    """Turn an exact measurement into an imperfect one; `out` holds the last one before.

    Args:
        exact: Shape (10 + 2 wheels,).
        normals: Independent standard normal numbers, shape (9,): gyro, accelerometer, wandering of the gyro's offset.
        deviations: Standard deviations of a gyro sample, of an accelerometer sample, of the offset's step.
        bias: Offsets of gyro and accelerometer, shape (6,); the gyro's wander.
        attitude_given: Whether the attitude is measured.
        resolution: Angle of one encoder count [rad], or 0.
        period: Time between samples [s].
        out: Overwritten.
    """
    for i in range(4):
        out[i] = exact[i] if attitude_given else np.nan
    for i in range(3):
        bias[i] += deviations[2] * normals[6 + i]
        out[4 + i] = exact[4 + i] + bias[i] + deviations[0] * normals[i]
        out[7 + i] = exact[7 + i] + bias[3 + i] + deviations[1] * normals[3 + i]
    wheels = (exact.shape[0] - IMU_ENTRIES) // 2
    for i in range(wheels):
        angle, rate = IMU_ENTRIES + i, IMU_ENTRIES + wheels + i
        if resolution > 0.0:
            counted = resolution * np.floor(exact[angle] / resolution + 0.5)
            out[rate] = (counted - out[angle]) / period
            out[angle] = counted
        else:
            out[angle] = exact[angle]
            out[rate] = exact[rate]


@dataclass(slots=True, eq=False)
class Sensors:
    """Imperfect sensors at work: what they add to an exact measurement.

    Attributes:
        fidelity: Which imperfections.
        period: Time between samples [s].
        bias: Present offsets of gyro [rad/s] and accelerometer [m/s^2], shape (6,).
    """

    fidelity: Fidelity
    period: float
    bias: Array = field(init=False)
    _generator: np.random.Generator = field(init=False, repr=False)
    _deviations: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        imu = self.fidelity.imu
        self._deviations = np.zeros(3)
        if imu is not None:
            self._deviations[:] = (
                ImuErrors.sample_deviation(imu.gyro_noise, self.period),
                ImuErrors.sample_deviation(imu.accelerometer_noise, self.period),
                imu.gyro_bias_walk * np.sqrt(self.period),
            )
        self.reset()

    def reset(self) -> None:
        """Start anew, with the offsets and the noise of the seed."""
        imu = self.fidelity.imu
        self._generator = np.random.default_rng(self.fidelity.seed)
        self.bias = np.zeros(6)
        if imu is not None:
            self.bias[:3] = imu.gyro_bias * self._generator.standard_normal(3)
            self.bias[3:] = imu.accelerometer_bias * self._generator.standard_normal(3)

    def disturb(self, exact: Array, measurement: Array) -> None:
        """Make an imperfect measurement.

        Args:
            exact: The exact one, shape (10 + 2 wheels,).
            measurement: The last imperfect one, overwritten with the new one.
        """
        _disturb(
            exact, self._generator.standard_normal(9), self._deviations, self.bias,
            not self.fidelity.attitude_estimated, self.fidelity.encoder_resolution, self.period, measurement,
        )  # fmt: skip
