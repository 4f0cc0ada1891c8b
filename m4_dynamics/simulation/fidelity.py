"""How faithful the plant is to a real robot: one switch for each thing that the paper's simulation leaves out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.imu import ImuErrors
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.battery import Battery

__all__ = ["Fidelity"]

#: More samples than this are not a delay but a fault.
_DELAY_MAX = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Fidelity:
    """Switches of the plant's fidelity. All are off by default: the paper's plant, measured exactly and at once.

    Figures that no publication gives are assumed, for the reason stated here, in `ImuErrors` or in `Battery`.

    Attributes:
        rotor_time_constant: First-order lag of every rotor [s]; None takes the robot's own figure (0 for M4, as in the
            paper). 0.15 is the sibling robot ATMO's.
        servo_speed_limit: Whether a servo's target moves no faster than its velocity limit. Torque limits always act.
        motor_limits: Whether a wheel's motor driver keeps the winding's torque within the effort limit of the joint,
            and drives no faster than its velocity limit (both from the URDF). Beyond the duty law these act where a
            motor is thrown into reverse, and downhill.
        encoder_counts: Counts per turn of a wheel; angles are whole counts, rates are their differences. 0 measures
            exactly. 4096 is a 12-bit magnetic encoder on the wheel's shaft.
        imu: Noise and offsets of gyro and accelerometer; None measures exactly.
        attitude_estimated: Whether the attitude has to be estimated; the measurement's attitude is then NaN. Otherwise
            it is given, exactly.
        control_delay: Whole samples between a command and its effect. 1: computing takes the sample.
        battery: The pack that feeds rotors and motors; None is a constant voltage.
        seed: Seed of noise and offsets.
    """

    rotor_time_constant: float | None = None
    servo_speed_limit: bool = False
    motor_limits: bool = False
    encoder_counts: int = 0
    imu: ImuErrors | None = None
    attitude_estimated: bool = False
    control_delay: int = 0
    battery: Battery | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        lag = self.rotor_time_constant
        if lag is not None and not (math.isfinite(lag) and lag >= 0.0):
            raise InvalidSettingError("rotor_time_constant [s]", lag, "a finite time >= 0, or None")
        if self.encoder_counts < 0:
            raise InvalidSettingError("encoder_counts", self.encoder_counts, "counts per turn, or 0 for none")
        if not 0 <= self.control_delay <= _DELAY_MAX:
            raise InvalidSettingError("control_delay", self.control_delay, f"0 to {_DELAY_MAX} samples")
        if self.seed < 0:
            raise InvalidSettingError("seed", self.seed, "a whole number >= 0")

    @classmethod
    def ideal(cls) -> Fidelity:
        """The paper's plant: everything off."""
        return cls()

    @classmethod
    def realistic(cls, *, seed: int = 0) -> Fidelity:
        """Everything on, with the figures of `ImuErrors` and `Battery`.

        Args:
            seed: Seed of noise and offsets.

        Returns:
            The switches.
        """
        return cls(
            rotor_time_constant=0.15,
            servo_speed_limit=True,
            motor_limits=True,
            encoder_counts=4096,
            imu=ImuErrors(),
            attitude_estimated=True,
            control_delay=1,
            battery=Battery(),
            seed=seed,
        )

    @property
    def encoder_resolution(self) -> float:
        """Angle of one encoder count [rad]; 0 when it measures exactly."""
        return 2.0 * math.pi / self.encoder_counts if self.encoder_counts else 0.0

    def rotor_time_constants(self, robot: Robot) -> NDArray[np.float64]:
        """First-order lag of each of a robot's rotors, shape (thrusters,) [s]: the switch's, else the robot's own."""
        own = [thruster.time_constant for thruster in robot.thrusters]
        override = self.rotor_time_constant
        return np.array(own if override is None else [override] * len(own), dtype=np.float64)

    @property
    def senses_exactly(self) -> bool:
        """Whether every entry of a measurement is exact."""
        return self.encoder_counts == 0 and self.imu is None and not self.attitude_estimated

    @property
    def switches(self) -> tuple[str, ...]:
        """What is on, each in a few words with its figure."""
        words = []
        if self.rotor_time_constant is not None:
            words.append(f"rotor lag {self.rotor_time_constant:g} s")
        if self.servo_speed_limit:
            words.append("servo speed limits")
        if self.motor_limits:
            words.append("motor limits")
        if self.encoder_counts:
            words.append(f"encoders of {self.encoder_counts} counts")
        if self.imu is not None:
            words.append("IMU noise and offsets")
        if self.attitude_estimated:
            words.append("attitude estimated")
        if self.control_delay:
            words.append(f"control delay of {self.control_delay} sample{'s' if self.control_delay > 1 else ''}")
        if self.battery is not None:
            words.append(f"battery at {100.0 * self.battery.charge:.0f} %")
        return tuple(words)
