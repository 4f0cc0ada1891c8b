"""Real actuators: late, slow, limited, and fed by a battery.

They stand between the command and what acts on the full model. Within a control period the command is held; rotors,
servo targets and motor drivers move at every integration step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from m4_dynamics.full.model import FullModel
from m4_dynamics.full.stepping import Actuation
from m4_dynamics.simulation.battery import Supply
from m4_dynamics.simulation.fidelity import Fidelity

__all__ = ["Actuators", "drive_at_once"]

Array = NDArray[np.float64]


@njit(cache=True)
def drive_at_once(
    duty_command: Any, thrust_command: Any, thrust_limit: Any, thrust_scale: Any, duty: Any, thrust: Any
) -> None:
    """Ideal actuators: duties limited to [-1, 1], thrusts to what the thrusters give (times an error of theirs)."""
    for i in range(duty.shape[0]):
        duty[i] = min(1.0, max(-1.0, duty_command[i]))
    for i in range(thrust.shape[0]):
        thrust[i] = thrust_scale[i] * min(thrust_limit[i], max(0.0, thrust_command[i]))


@njit(cache=True)
def limited_duty(
    duty: float, rate: float, stall_torque: float, back_emf: float, torque_limit: float, speed_limit: float
) -> float:
    """Duty that a motor driver lets through.

    It keeps the winding's torque, stall_torque * duty - back_emf * rate, within the limit, and lets the motor coast
    where the torque would drive it beyond its speed limit.

    Args:
        duty: What is asked for.
        rate: Of the joint [rad/s].
        stall_torque: [N m].
        back_emf: [N m s].
        torque_limit: [N m], or infinity.
        speed_limit: [rad/s], or infinity.
    """
    if stall_torque <= 0.0:
        return duty
    coasting = back_emf * rate / stall_torque
    reach = torque_limit / stall_torque
    highest = coasting if rate >= speed_limit else coasting + reach
    lowest = coasting if rate <= -speed_limit else coasting - reach
    return min(max(duty, lowest), highest)


@njit(cache=True)
def _advance(
    wanted_duty: Any, wanted_thrust: Any, wanted_targets: Any, voltage_ratio: float, velocity: Any,
    wheel_velocity_indices: Any, wheel_motor: Any, wheel_limits: Any, thrust_limit: Any, thrust_scale: Any,
    rotor_share: Any, servo_stride: Any, duty: Any, thrust: Any, targets: Any,
) -> None:  # fmt: skip
    """Move every actuator on by one integration step.

    Args:
        wanted_duty: What has been asked for, shape (wheels,).
        wanted_thrust: Shape (thrusters,) [N].
        wanted_targets: Shape (servos,) [rad].
        voltage_ratio: Supply voltage over that of the full pack.
        velocity: v, shape (nv,).
        wheel_velocity_indices: Where each wheel stands in v.
        wheel_motor: Stall torque and back-EMF constant, shape (wheels, 2) [N m, N m s].
        wheel_limits: Torque and speed limit, shape (wheels, 2) [N m, rad/s].
        thrust_limit: Largest thrusts [N].
        thrust_scale: Thrust given over thrust asked for, shape (thrusters,).
        rotor_share: Part of its way that each rotor goes in one step.
        servo_stride: Largest change of each servo's target in one step [rad].
        duty: Overwritten: what acts on the motors.
        thrust: Overwritten: what the rotors give.
        targets: Overwritten: what the servos hold.
    """
    for i in range(duty.shape[0]):
        supplied = voltage_ratio * min(1.0, max(-1.0, wanted_duty[i]))
        duty[i] = limited_duty(
            supplied, velocity[wheel_velocity_indices[i]], wheel_motor[i, 0], wheel_motor[i, 1], wheel_limits[i, 0],
            wheel_limits[i, 1],
        )  # fmt: skip
    for i in range(thrust.shape[0]):
        aim = thrust_scale[i] * voltage_ratio * voltage_ratio * min(thrust_limit[i], max(0.0, wanted_thrust[i]))
        thrust[i] += rotor_share[i] * (aim - thrust[i])
    for i in range(targets.shape[0]):
        stride = servo_stride[i]
        targets[i] += min(max(wanted_targets[i] - targets[i], -stride), stride)


@dataclass(slots=True, eq=False)
class Actuators:
    """Actuators with the imperfections that a `Fidelity` asks for.

    Attributes:
        model: The full model that they act on.
        fidelity: Which imperfections.
        time_step: Integration step [s].
        thrust_scale: Thrust given over thrust asked for, shape (thrusters,).
        supply: The battery in use, or None.
    """

    model: FullModel
    fidelity: Fidelity
    time_step: float
    thrust_scale: Array
    supply: Supply | None = field(init=False)
    _wheel_limits: Array = field(init=False, repr=False)
    _thrust_limit: Array = field(init=False, repr=False)
    _rotor_share: Array = field(init=False, repr=False)
    _servo_stride: Array = field(init=False, repr=False)
    _line: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        robot, fidelity = self.model.robot, self.fidelity
        self.supply = Supply(fidelity.battery) if fidelity.battery is not None else None
        self._wheel_limits = np.full((len(robot.wheels), 2), math.inf)
        if fidelity.motor_limits:
            for row, wheel in zip(self._wheel_limits, robot.wheels, strict=True):
                limits = robot.model.effortLimit[wheel.index_v], robot.model.velocityLimit[wheel.index_v]
                row[:] = [limit if limit > 0.0 else math.inf for limit in limits]
        self._thrust_limit = np.array([thruster.maximum_thrust for thruster in robot.thrusters], dtype=float)
        constants = fidelity.rotor_time_constants(robot)
        lagging = np.where(constants > 0.0, constants, 1.0)
        self._rotor_share = np.where(constants > 0.0, -np.expm1(-self.time_step / lagging), 1.0)
        speeds = [servo.velocity_limit if fidelity.servo_speed_limit else math.inf for servo in robot.servos]
        self._servo_stride = self.time_step * np.array(speeds, dtype=float)
        self._line = np.zeros((fidelity.control_delay + 1, 0))

    def reset(self, command: Actuation, actuation: Actuation) -> None:
        """Start anew: battery as it was, rotors at rest, every actuator where the command has it.

        Args:
            command: What is asked for.
            actuation: What acts on the model; its arrays are replaced.
        """
        if self.supply is not None:
            self.supply.reset()
        actuation.servo_targets = command.servo_targets.copy()
        actuation.wheel_brake = command.wheel_brake.copy()
        actuation.external_wrench = command.external_wrench  # not a command: the world pushes at once
        actuation.wheel_duty[:] = 0.0
        actuation.thrust[:] = 0.0
        self._line = np.tile(_flat(command), (self.fidelity.control_delay + 1, 1))

    def settle(self, command: Actuation, actuation: Actuation, velocity: Array) -> None:
        """Bring the actuators where they are when the command has been held for long.

        Args:
            command: What has been asked for.
            actuation: What acts on the model; overwritten.
            velocity: v, shape (nv,).
        """
        self._line[:] = _flat(command)
        actuation.servo_targets[:] = command.servo_targets
        actuation.wheel_brake[:] = command.wheel_brake
        # Load and voltage depend on each other; a few rounds settle both.
        for _ in range(1 if self.supply is None else 20):
            _advance(
                command.wheel_duty, command.thrust, command.servo_targets, self.voltage_ratio, velocity,
                self.model.wheel_velocity_indices, self.model.wheel_motor, self._wheel_limits, self._thrust_limit,
                self.thrust_scale, np.ones_like(self._rotor_share), self._servo_stride, actuation.wheel_duty,
                actuation.thrust, actuation.servo_targets,
            )  # fmt: skip
            self.draw(actuation, velocity, 0.0)

    def take(self, command: Actuation) -> tuple[Array, Array, Array, Array]:
        """Put a command in at the end of the delay line and get what comes out: duty, brake, thrust, servo targets."""
        line = self._line
        line[:-1] = line[1:]
        line[-1] = _flat(command)
        due = line[0]
        wheels, thrusters = len(command.wheel_duty), len(command.thrust)
        ends = wheels, 2 * wheels, 2 * wheels + thrusters
        return due[: ends[0]], due[ends[0] : ends[1]], due[ends[1] : ends[2]], due[ends[2] :]

    def advance(self, wanted: tuple[Array, Array, Array, Array], actuation: Actuation, velocity: Array) -> None:
        """Move every actuator on by one integration step.

        Args:
            wanted: What `take` gave.
            actuation: What acts on the model; overwritten.
            velocity: v, shape (nv,).
        """
        duty, brake, thrust, targets = wanted
        actuation.wheel_brake[:] = brake
        _advance(
            duty, thrust, targets, self.voltage_ratio, velocity, self.model.wheel_velocity_indices,
            self.model.wheel_motor, self._wheel_limits, self._thrust_limit, self.thrust_scale, self._rotor_share,
            self._servo_stride, actuation.wheel_duty, actuation.thrust, actuation.servo_targets,
        )  # fmt: skip

    @property
    def voltage_ratio(self) -> float:
        """Supply voltage over that of the full pack at rest."""
        return 1.0 if self.supply is None else self.supply.ratio

    def draw(self, actuation: Actuation, velocity: Array, duration: float) -> None:
        """Take from the battery what the actuators need.

        Args:
            actuation: What acts on the model.
            velocity: v, shape (nv,).
            duration: For how long [s].
        """
        if self.supply is not None:
            self.supply.draw(
                actuation.thrust, actuation.wheel_duty, self.model.wheel_motor, velocity,
                self.model.wheel_velocity_indices, duration,
            )  # fmt: skip


def _flat(command: Actuation) -> Array:
    return np.concatenate((command.wheel_duty, command.wheel_brake, command.thrust, command.servo_targets))
