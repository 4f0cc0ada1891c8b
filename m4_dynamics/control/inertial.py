"""The reduced state from imperfect sensors: inertial navigation, held to the ground by wheel odometry.

Gyro and accelerometer are integrated to attitude and velocity of the sensor. Kinematics say where the sensor must be:
a wheel that rolls carries the axle along the ground, the body carries the sensor above the axle, and nothing moves
sideways. The difference corrects everything: an error of the tilt shows as an acceleration that the wheels do not
confirm, g times the tilt. So the accelerometer tells the vertical although the robot accelerates, without
differentiating the encoders, and the wheel rate comes from the accelerometer in the short run and from the encoders in
the long, without the steps of counts over a sample. The difference of the two wheels' angles holds the heading.

The gains are those of a Kalman filter: noise densities go in (`ImuErrors`, the encoder's resolution), gains come out at
every sample; no gain is chosen. What is linearised is the error, in three independent groups
(`control/inertial_kernels.py`); the estimate itself follows the exact kinematics. An offset of the accelerometer along
the ground cannot be told from a tilt, with these sensors: 0.05 m/s^2 leave 0.3 deg of pitch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.control import inertial_kernels as kernels
from m4_dynamics.control.imu import ImuErrors
from m4_dynamics.errors import InvalidSettingError

__all__ = ["InertialEstimator"]

Array = NDArray[np.float64]

#: What the odometry of one wheel leaves open at every sample, beside the encoder's counts: give of legs and tyres,
#: roughness of the ground; standard deviation [m] (assumed).
ODOMETRY_NOISE = 5e-4


@dataclass(slots=True, eq=False)
class InertialEstimator:
    """Gyro, accelerometer and wheel odometry to the reduced state, heading and roll.

    It offers what the ideal `BalanceEstimator` does. A measured attitude, where there is one, is taken as it is; where
    it is NaN it is estimated, together with the gyro's offset.

    Attributes:
        axes_in_base: Forward, lateral (left) and up axes of the pendulum in the base frame, rows, shape (3, 3).
        wheels: Number of wheels in a measurement.
        drive_wheels: Indices of the left and the right drive wheel, seen along forward.
        wheel_signs: Joint rate times this is the rolling rate relative to the body, (left, right).
        wheel_radius: [m].
        track: Distance between the drive wheels [m].
        slope: Inclination of the ground [rad]; the heading turns about its normal, the axle moves along it.
        axle_in_base: Midpoint of the drive wheels in the base frame, at whose origin the sensor sits, shape (3,) [m].
        errors: What to expect of gyro and accelerometer.
        encoder_resolution: Angle of one encoder count [rad].
        period: Time between samples [s].
        gravity: [m/s^2].
    """

    axes_in_base: Array
    wheels: int
    drive_wheels: tuple[int, int]
    wheel_signs: tuple[float, float]
    wheel_radius: float
    track: float
    slope: float
    axle_in_base: Array
    errors: ImuErrors = field(default_factory=ImuErrors)
    encoder_resolution: float = 0.0
    period: float = 5e-3
    gravity: float = 9.81
    _estimate: Array = field(init=False, repr=False)
    _zero: Array = field(init=False, repr=False)
    _design: Array = field(init=False, repr=False)
    _sensor: Array = field(init=False, repr=False)
    _rotation: Array = field(init=False, repr=False)
    _bias: Array = field(init=False, repr=False)
    _vertical_bias: Array = field(init=False, repr=False)
    _drift: Array = field(init=False, repr=False)
    _velocity: Array = field(init=False, repr=False)
    _previous: Array = field(init=False, repr=False)
    _longitudinal: Array = field(init=False, repr=False)
    _lateral: Array = field(init=False, repr=False)
    _vertical: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("wheel_radius", "track", "period", "gravity"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InvalidSettingError(name, value, "a finite number > 0")
        if not (math.isfinite(self.encoder_resolution) and self.encoder_resolution >= 0.0):
            raise InvalidSettingError("encoder_resolution", self.encoder_resolution, "a finite angle >= 0")
        self.axes_in_base = np.ascontiguousarray(self.axes_in_base, dtype=float)
        self._sensor = -self.axes_in_base @ np.asarray(self.axle_in_base, dtype=float)
        self._estimate = np.zeros(kernels.ESTIMATE_ENTRIES)
        self._zero = np.zeros(3)
        self._rotation = np.eye(3)
        self._design = np.zeros(kernels.DESIGN_ENTRIES)
        self._bias, self._drift, self._velocity = np.zeros(3), np.zeros(3), np.zeros(3)
        self._vertical_bias, self._previous = np.zeros(1), np.zeros(5)
        self._longitudinal, self._lateral, self._vertical = np.zeros((4, 4)), np.zeros((6, 6)), np.zeros((3, 3))

    def reset(self, measurement: ArrayLike, *, wheel_angle: float = 0.0, heading: float = 0.0) -> None:
        """Start anew: level by the accelerometer, as at rest, speed by the encoders, odometry as told.

        One sample is rough. Samples of a robot that is held still, given to `update` before it is let go, level it
        as well as the sensors can, and find the gyro's offset.

        Args:
            measurement: The measurement at that place.
            wheel_angle: Absolute wheel angle there [rad].
            heading: Heading there, positive left of uphill [rad].
        """
        values = np.array(measurement, dtype=float)
        given = bool(np.isfinite(values[:4]).all())
        rate, force = self.axes_in_base @ values[4:7], self.axes_in_base @ values[7:10]
        if given:
            kernels.attitude(values, self.axes_in_base, self._rotation)
        else:
            kernels.level(force, heading, self.slope, self._rotation)
        self._prepare(given)
        left, right = self.drive_wheels
        relative = self.wheel_signs[0] * values[10 + left], self.wheel_signs[1] * values[10 + right]
        pitch = math.atan2(-self._rotation[2, 0], self._rotation[2, 2])
        self._zero[:] = relative[0] + pitch - wheel_angle, relative[1] + pitch - wheel_angle, heading
        self._previous[:] = *rate, *relative
        self._bias[:] = 0.0
        self._vertical_bias[:] = 0.0
        self._drift[:] = self._rotation @ self._sensor
        joint_rates = values[10 + self.wheels + left], values[10 + self.wheels + right]
        wheel_rate = 0.5 * float(np.dot(self.wheel_signs, joint_rates)) + float(rate[1])
        swing = self._rotation @ np.cross(rate, self._sensor)
        self._velocity[:] = self.wheel_radius * wheel_rate * self._travel() + swing
        self._read_out(rate, relative)
        self._estimate[kernels.HEADING] = heading

    def relocate(self, measurement: ArrayLike, *, wheel_angle: float, heading: float) -> None:
        """Tell the odometry its place anew in the middle of a run; level, speed and the gyro's offset stay.

        Args:
            measurement: The measurement at that place, already given to `update`.
            wheel_angle: Absolute wheel angle there [rad].
            heading: Heading there, positive left of uphill [rad].
        """
        values = np.asarray(measurement, dtype=float)
        relative = [sign * values[10 + wheel] for sign, wheel in zip(self.wheel_signs, self.drive_wheels, strict=True)]
        if math.isnan(values[0]):
            # The vertical is known from inside, so the body turns about it.
            before = self._rotation.copy()
            kernels.level(before[2], heading, self.slope, self._rotation)
            turn = self._rotation @ before.T
            self._velocity[:] = turn @ self._velocity
            self._drift[:] = turn @ self._drift
        self._zero[:] = relative[0] + self.pitch - wheel_angle, relative[1] + self.pitch - wheel_angle, heading
        self._read_out(self._previous[:3], (relative[0], relative[1]))
        self._estimate[kernels.HEADING] = heading

    def _prepare(self, given: bool) -> None:
        """Variances of one sample, and of the start."""
        errors, dt, radius = self.errors, self.period, self.wheel_radius
        acceleration = ImuErrors.sample_deviation(errors.accelerometer_noise, dt)
        rate = ImuErrors.sample_deviation(errors.gyro_noise, dt)
        # Rounding to whole counts, evenly spread; the mean of two wheels has half the variance.
        count = self.encoder_resolution**2 / 12.0
        design = self._design
        design[kernels.ACCELERATION_VARIANCE] = acceleration**2
        design[kernels.RATE_VARIANCE] = 0.0 if given else rate**2
        design[kernels.BIAS_STEP_VARIANCE] = 0.0 if given else errors.gyro_bias_walk**2 * dt
        # The accelerometer's offset turns with the body: it is as good as new after a second.
        design[kernels.VERTICAL_BIAS_STEP_VARIANCE] = errors.accelerometer_bias**2 * dt
        design[kernels.TRAVEL_VARIANCE] = 0.5 * (radius**2 * count + ODOMETRY_NOISE**2)
        design[kernels.SIDEWAYS_VARIANCE] = ODOMETRY_NOISE**2
        design[kernels.HEADING_VARIANCE] = 2.0 * (radius**2 * count + ODOMETRY_NOISE**2) / self.track**2
        design[kernels.WHEEL_RADIUS], design[kernels.TRACK] = radius, self.track
        design[kernels.GRAVITY], design[kernels.PERIOD] = self.gravity, dt
        tilt = 0.0 if given else (acceleration / self.gravity) ** 2 + (errors.accelerometer_bias / self.gravity) ** 2
        bias = 0.0 if given else errors.gyro_bias**2
        turn = 0.0 if given else design[kernels.HEADING_VARIANCE]
        speed = count * (radius / dt) ** 2
        sensor = self._rotation @ self._sensor
        left = self._rotation[:2, 1] / math.hypot(*self._rotation[:2, 1])
        ahead = float(sensor[0] * left[1] - sensor[1] * left[0])
        normal_ahead, normal_up = -math.sin(self.slope) * float(left[1]), math.cos(self.slope)
        travel_ahead = float(self._travel()[:2] @ (left[1], -left[0]))
        # Where the first sample puts the sensor follows from its tilt, and its speed from the gyro: place = -H tilt,
        # speed = H offset, in the lateral filter with the turn that the told heading leaves open.
        arm = -(radius * travel_ahead + float(sensor[2]))
        start = np.array([[1.0, 0.0, -arm, 0.0], [0.0, 1.0, 0.0, arm], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
        self._longitudinal[:] = start @ np.diag([design[kernels.TRAVEL_VARIANCE], speed, tilt, bias]) @ start.T
        start = np.eye(6)
        start[3, 2:4] = -normal_ahead / normal_up, 1.0 / normal_up
        start[0] += -float(sensor[2]) * start[2] + ahead * start[3]
        start[1] += float(sensor[2]) * start[4] - ahead * start[5]
        self._lateral[:] = start @ np.diag([design[kernels.SIDEWAYS_VARIANCE], speed, tilt, turn, bias, bias]) @ start.T
        self._vertical[:] = np.diag(
            [design[kernels.TRAVEL_VARIANCE], speed, errors.accelerometer_bias**2 + acceleration**2]
        )

    def _travel(self) -> Array:
        """Direction of travel: lateral axis x slope normal, in the world, shape (3,)."""
        return np.cross(self._rotation[:, 1], (-math.sin(self.slope), 0.0, math.cos(self.slope)))

    def update(self, measurement: Array) -> Array:
        """Estimate from the next measurement.

        Args:
            measurement: Flat measurement, shape (10 + 2 wheels,), see `control/estimator.py`; the wheels' joint rates
                are not used.

        Returns:
            (wheel angle, pitch, and their rates), shape (4,), a fresh array.
        """
        kernels.navigate(
            measurement, self.wheels, self.drive_wheels[0], self.drive_wheels[1], self.wheel_signs[0],
            self.wheel_signs[1], self.axes_in_base, self._sensor, self.slope, self._zero, self._design, self._rotation,
            self._bias, self._vertical_bias, self._drift, self._velocity, self._previous, self._longitudinal,
            self._lateral, self._vertical, self._estimate,
        )  # fmt: skip
        return self._estimate[:4].copy()

    def _read_out(self, rate: Array, relative: tuple[float, float]) -> None:
        kernels.read_out(
            self._rotation, self._bias, self._velocity, rate, self._sensor, self.slope, relative[0] - self._zero[0],
            relative[1] - self._zero[1], self.wheel_radius, self._estimate,
        )  # fmt: skip

    @property
    def state(self) -> Array:
        """Last estimate of the reduced state, shape (4,), a fresh array."""
        return self._estimate[:4].copy()

    @property
    def pitch(self) -> float:
        """Last estimate of the pitch [rad]."""
        return float(self._estimate[kernels.PITCH])

    @property
    def heading(self) -> float:
        """Heading from gyro and odometry, positive left of uphill [rad]."""
        return float(self._estimate[kernels.HEADING])

    @property
    def heading_rate(self) -> float:
        """Rate about the slope normal, from the gyro less its offset [rad/s]."""
        return float(self._estimate[kernels.HEADING_RATE])

    @property
    def roll(self) -> float:
        """Roll about the direction of travel [rad]."""
        return float(self._estimate[kernels.ROLL])

    @property
    def gyro_bias(self) -> Array:
        """Estimated offset of the gyro about the forward, lateral and up axes, shape (3,) [rad/s]."""
        return self._bias.copy()

    @property
    def pitch_deviation(self) -> float:
        """Standard deviation of the pitch that the filter expects of itself, the accelerometer's offset aside [rad]."""
        return math.sqrt(float(self._longitudinal[2, 2]))
