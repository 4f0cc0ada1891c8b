"""Errors of an inertial measurement unit, as its simulation makes them and as the estimator expects them."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from m4_dynamics.errors import InvalidSettingError

__all__ = ["ImuErrors"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuErrors:
    """White noise, offsets, and their wandering; the same on each of the three axes.

    The defaults are those of a small MEMS unit on a vibrating frame. All are assumed: nothing is published for M4.

    Attributes:
        gyro_noise: Density of the angular-rate noise [rad/s/sqrt(Hz)]. Data sheets of the class used on small flying
            robots say 2.4e-4 (0.014 deg/s/sqrt(Hz)); twice that with rotors turning.
        gyro_bias: Standard deviation of the offset at the start [rad/s]. 0.2 deg/s is what a change of about 10 K after
            the last calibration leaves, at the usual 0.015 deg/s/K and some hysteresis.
        gyro_bias_walk: Growth of the offset's standard deviation [rad/s/sqrt(s)]. 1e-4 is 0.02 deg/s in ten seconds, a
            unit that warms up.
        accelerometer_noise: Density of the noise of the proper acceleration [m/s^2/sqrt(Hz)]. Data sheets say 1.7e-3
            (175 micro-g); ten times that, since rotors shake the frame by tenths of m/s^2.
        accelerometer_bias: Standard deviation of the offset [m/s^2]. 5 milli-g, left by a calibration on six faces.
    """

    gyro_noise: float = 5.0e-4
    gyro_bias: float = math.radians(0.2)
    gyro_bias_walk: float = 1.0e-4
    accelerometer_noise: float = 1.7e-2
    accelerometer_bias: float = 0.05

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidSettingError(f"IMU {entry.name}", value, "a finite number >= 0")

    @staticmethod
    def sample_deviation(density: float, period: float) -> float:
        """Standard deviation of one sample of white noise that fills the band up to half the sampling rate.

        Args:
            density: [unit/sqrt(Hz)].
            period: Time between samples [s].

        Returns:
            [unit].
        """
        return density / math.sqrt(2.0 * period)
