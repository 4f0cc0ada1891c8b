"""The full model as a plant with a control rate: reset, step, measure. People's own controllers plug in here.

plant = Plant(FullModel.build(load_robot(), incline_terrain(slope)))
measurement = plant.reset(configuration)
while plant.time < 10.0:
    plant.command.wheel_duty[:] = ...
    measurement = plant.step()
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.control.estimator import IMU_ENTRIES
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.full import kernels
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.stepping import Actuation, ImplicitStepper
from m4_dynamics.simulation.sensors import Measurement, SensorModel, disturb, measure

__all__ = ["Plant"]

Array = NDArray[np.float64]


@njit(cache=True)
def _drive_actuators(
    duty_command: Any, thrust_command: Any, thrust_limit: Any, lag: Any, duty: Any, thrust: Any
) -> None:
    """Limit the commands; the thrust follows with the rotor's lag (the part of the way it goes in one sample)."""
    for i in range(duty.shape[0]):
        duty[i] = min(1.0, max(-1.0, duty_command[i]))
    for i in range(thrust.shape[0]):
        wanted = min(thrust_limit[i], max(0.0, thrust_command[i]))
        thrust[i] += lag[i] * (wanted - thrust[i])


@dataclass(slots=True, eq=False)
class Plant:
    """The full model, stepped at a fixed control rate.

    Duties are limited to [-1, 1] and thrusts to what the thrusters give; thrust follows with the rotors' time constant
    (0: at once, the paper's ideal rotor).

    Attributes:
        model: The full model; its terrain and ground law are the plant's.
        control_period: Time between two measurements [s].
        time_step: Integration step; a whole number of them must fit into the control period [s].
        sensors: Imperfections of the sensors; None measures exactly.
        command: What the actuators are told until it is written anew: servo targets, duties, brakes, thrusts, a push.
        stepper: The integrator, with the state, contact forces, counters, and what the actuators do.
        measurement: The last measurement as a flat array, shape (10 + 2 wheels,); see `measurement_now`.
    """

    model: FullModel
    control_period: float = 5e-3
    time_step: float = 1e-3
    sensors: SensorModel | None = None
    command: Actuation = field(init=False)
    stepper: ImplicitStepper = field(init=False)
    measurement: Array = field(init=False)
    _substeps: int = field(init=False, repr=False)
    _exact: Array = field(init=False, repr=False)
    _previous_velocity: Array = field(init=False, repr=False)
    _generator: np.random.Generator = field(init=False, repr=False)
    _thrust_limit: Array = field(init=False, repr=False)
    _rotor_lag: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.stepper = ImplicitStepper(self.model, self.time_step)
        self._substeps = round(self.control_period / self.time_step)
        if self._substeps < 1 or abs(self._substeps * self.time_step - self.control_period) > 1e-9:
            raise InvalidSettingError(
                "control_period [s]", self.control_period, f"a whole number of time steps of {self.time_step:g} s"
            )
        thrusters = self.model.robot.thrusters
        self._thrust_limit = np.array([thruster.maximum_thrust for thruster in thrusters], dtype=float)
        constants = np.array([thruster.time_constant for thruster in thrusters], dtype=float)
        lagging = np.where(constants > 0.0, constants, 1.0)
        self._rotor_lag = np.where(constants > 0.0, -np.expm1(-self.control_period / lagging), 1.0)
        self._exact = np.zeros(IMU_ENTRIES + 2 * len(self.model.robot.wheels))
        self.reset(self.stepper.configuration)

    @property
    def time(self) -> float:
        """Time since reset [s]."""
        return self.stepper.time

    @property
    def configuration(self) -> Array:
        """True configuration q, shape (nq,)."""
        return self.stepper.configuration

    @property
    def velocity(self) -> Array:
        """True velocity v, shape (nv,)."""
        return self.stepper.velocity

    @property
    def measurement_now(self) -> Measurement:
        """The last measurement, with names."""
        return Measurement.from_array(self.time, self.measurement)

    def reset(self, configuration: ArrayLike, velocity: ArrayLike | None = None) -> Array:
        """Start anew from a state; servos hold its joint angles, wheels and thrusters are off.

        Args:
            configuration: q, shape (nq,).
            velocity: v, shape (nv,); at rest when None.

        Returns:
            The first measurement, flat.

        Raises:
            InvalidSettingError: A shape is wrong.
            NonFiniteError: An entry is NaN or infinite.
        """
        self.stepper.reset(configuration, velocity)
        self.command = Actuation.idle(self.model, self.stepper.configuration)
        # Servo targets, brakes and pushes reach the actuators as they are; duties and thrusts are limited first.
        actuation = self.stepper.actuation
        actuation.servo_targets = self.command.servo_targets
        actuation.wheel_brake = self.command.wheel_brake
        actuation.external_wrench = self.command.external_wrench
        self._generator = np.random.default_rng(self.sensors.seed if self.sensors is not None else 0)
        self._previous_velocity = self.stepper.velocity.copy()
        self.measurement = np.zeros_like(self._exact)
        return self._measure()

    def step(self) -> Array:
        """Advance by one control period with the present command.

        Returns:
            The measurement at its end, flat, shape (10 + 2 wheels,); see `control.estimator` for its layout.

        Raises:
            SimulationDivergedError: A velocity is NaN or unbounded.
        """
        self._previous_velocity[:] = self.stepper.velocity
        actuation = self.stepper.actuation
        _drive_actuators(
            self.command.wheel_duty, self.command.thrust, self._thrust_limit, self._rotor_lag, actuation.wheel_duty,
            actuation.thrust,
        )  # fmt: skip
        self.stepper.step(self._substeps)
        self.stepper.require_bounded()
        return self._measure()

    def _measure(self) -> Array:
        wheel_angles = self.stepper.statistics[:, kernels.JOINT_ANGLE]
        measure(
            self.stepper.configuration, self.stepper.velocity, self._previous_velocity, wheel_angles,
            self.model.wheel_velocity_indices, self.control_period, self.model.robot.gravity, self._exact,
        )  # fmt: skip
        if self.sensors is None:
            self.measurement[:] = self._exact
        else:
            wheels = len(self.model.wheel_joints)
            measured_before = self.measurement[IMU_ENTRIES : IMU_ENTRIES + wheels].copy()
            self.measurement[:] = disturb(
                self.sensors, self._generator, self._exact, measured_before, self.control_period
            )
        return self.measurement
