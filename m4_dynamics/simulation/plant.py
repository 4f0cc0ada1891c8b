"""The full model as a plant with a control rate: reset, step, measure. People's own controllers plug in here.

plant = Plant(FullModel.build(load_robot(), incline_terrain(slope)))
measurement = plant.reset(configuration)
while plant.time < 10.0:
    plant.command.wheel_duty[:] = ...
    measurement = plant.step()
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.control.estimator import IMU_ENTRIES
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.full import kernels
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.stepping import Actuation, ImplicitStepper
from m4_dynamics.simulation.actuators import Actuators, drive_at_once
from m4_dynamics.simulation.battery import BatteryState
from m4_dynamics.simulation.fidelity import Fidelity
from m4_dynamics.simulation.sensors import Measurement, Sensors, measure

__all__ = ["Plant"]

Array = NDArray[np.float64]


@dataclass(slots=True, eq=False)
class Plant:
    """The full model, stepped at a fixed control rate.

    Duties are limited to [-1, 1] and thrusts to what the thrusters give. Whatever else sets a real robot apart from the
    paper's is a switch of the `Fidelity`.

    Attributes:
        model: The full model; its terrain and ground law are the plant's.
        control_period: Time between two measurements [s].
        time_step: Integration step; a whole number of them must fit into the control period [s].
        thrust_scale: Thrust given over thrust commanded, one for all thrusters or shape (thrusters,); other than 1 is
            an error that no controller knows of.
        fidelity: What sets actuators and sensors apart from ideal ones; the default is nothing.
        command: What the actuators are told until it is written anew: servo targets, duties, brakes, thrusts, a push.
        stepper: The integrator, with the state, contact forces, counters, and what the actuators do.
        measurement: The last measurement as a flat array, shape (10 + 2 wheels,); see `measurement_now`.
        sensors: What makes the measurement imperfect, or None.
    """

    model: FullModel
    control_period: float = 5e-3
    time_step: float = 1e-3
    thrust_scale: float | Array = 1.0
    fidelity: Fidelity = field(default_factory=Fidelity)
    command: Actuation = field(init=False)
    stepper: ImplicitStepper = field(init=False)
    measurement: Array = field(init=False)
    sensors: Sensors | None = field(init=False)
    _actuators: Actuators | None = field(init=False, repr=False)
    _substeps: int = field(init=False, repr=False)
    _exact: Array = field(init=False, repr=False)
    _previous_velocity: Array = field(init=False, repr=False)
    _thrust_limit: Array = field(init=False, repr=False)
    _thrust_scale: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.stepper = ImplicitStepper(self.model, self.time_step)
        self._substeps = round(self.control_period / self.time_step)
        if self._substeps < 1 or abs(self._substeps * self.time_step - self.control_period) > 1e-9:
            raise InvalidSettingError(
                "control_period [s]", self.control_period, f"a whole number of time steps of {self.time_step:g} s"
            )
        fidelity = self.fidelity
        self._thrust_limit = np.array([thruster.maximum_thrust for thruster in self.model.robot.thrusters], dtype=float)
        scale = np.asarray(self.thrust_scale, dtype=float)
        self._thrust_scale = np.broadcast_to(scale, self._thrust_limit.shape).copy()
        acts_at_once = (
            not (fidelity.servo_speed_limit or fidelity.motor_limits or fidelity.control_delay)
            and fidelity.battery is None
            and not fidelity.rotor_time_constants(self.model.robot).any()
        )
        self._actuators = None if acts_at_once else Actuators(self.model, fidelity, self.time_step, self._thrust_scale)
        self.sensors = None if fidelity.senses_exactly else Sensors(fidelity, self.control_period)
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

    @property
    def battery(self) -> BatteryState | None:
        """Voltage, current and charge of the battery; None if the supply is ideal."""
        actuators = self._actuators
        return None if actuators is None or actuators.supply is None else actuators.supply.state

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
        actuation = self.stepper.actuation
        if self._actuators is None:
            # Servo targets, brakes and pushes act as they are commanded; duties and thrusts are limited first.
            actuation.servo_targets = self.command.servo_targets
            actuation.wheel_brake = self.command.wheel_brake
            actuation.external_wrench = self.command.external_wrench
        else:
            self._actuators.reset(self.command, actuation)
        if self.sensors is not None:
            self.sensors.reset()
        self.measurement = np.zeros_like(self._exact)
        return self.measure_held()

    def settle_actuators(self) -> None:
        """Bring rotors, servo targets and delayed commands where they are when the command has been held for long.

        A robot that is let go has its rotors running already. Ideal actuators need no settling.
        """
        if self._actuators is not None:
            self._actuators.settle(self.command, self.stepper.actuation, self.stepper.velocity)

    def step(self) -> Array:
        """Advance by one control period with the present command.

        Returns:
            The measurement at its end, flat, shape (10 + 2 wheels,); see `control.estimator` for its layout.

        Raises:
            SimulationDivergedError: A velocity is NaN or unbounded.
        """
        stepper, command, actuators = self.stepper, self.command, self._actuators
        self._previous_velocity[:] = stepper.velocity
        actuation = stepper.actuation
        if actuators is None:
            drive_at_once(
                command.wheel_duty,
                command.thrust,
                self._thrust_limit,
                self._thrust_scale,
                actuation.wheel_duty,
                actuation.thrust,
            )
            stepper.step(self._substeps)
        else:
            wanted = actuators.take(command)
            for _ in range(self._substeps):
                actuators.advance(wanted, actuation, stepper.velocity)
                stepper.step()
            actuators.draw(actuation, stepper.velocity, self.control_period)
        stepper.require_bounded()
        return self._measure()

    def measure_held(self) -> Array:
        """Measure again at this instant, as if somebody held the robot: nothing accelerates.

        Returns:
            The measurement, flat; noisy sensors give another one at every call.
        """
        self._previous_velocity = self.stepper.velocity.copy()
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
            self.sensors.disturb(self._exact, self.measurement)
        return self.measurement
