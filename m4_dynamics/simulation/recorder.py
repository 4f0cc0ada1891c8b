"""Raw samples of a closed-loop run, written into arrays that are allocated once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.controller import Diagnostics
from m4_dynamics.full import kernels
from m4_dynamics.simulation.battery import BatteryState
from m4_dynamics.simulation.plant import Plant

__all__ = ["Recorder"]

Array = NDArray[np.float64]


@dataclass(slots=True, eq=False)
class Recorder:
    """One row per control period: the state at its start, the inputs held during it, the contacts at its end.

    Attributes:
        capacity: Largest number of rows.
        count: Rows written.
        current_phase: Written into the rows' `phase`.
        phase_name: What the robot is doing, in a word, for whoever watches.
        balancing: Whether it is balancing on its drive wheels.
        origin: Travel of the axle at which the wheel angle is zero [m]; None takes that of the first row.
        time: [s], and so on; shapes start with `capacity`. Columns of `statistics` are named in `full/kernels.py`; they
            hold the peaks within the period and running sums. Columns of `diagnostics` are those of
            `control.Diagnostics`; `control_seconds` is the wall-clock time that the balance controller took. `thrust`
            and `wheel_duty` are what acts at the period's end, not what was commanded. `battery` holds voltage [V],
            current [A] and charge; it has no rows when the supply is ideal. References are NaN where nothing was
            followed.
        observer: Called with the recorder after every row, and must leave it and the plant as they are; a live view.
        observer_seconds: Wall-clock time that the observer took; it is no part of the simulation's.
    """

    plant: Plant
    capacity: int
    observer: Callable[[Recorder], None] | None = None
    origin: float | None = None
    observer_seconds: float = field(init=False, default=0.0)
    count: int = field(init=False, default=0)
    current_phase: int = field(init=False, default=0)
    phase_name: str = field(init=False, default="")
    balancing: bool = field(init=False, default=True)
    time: Array = field(init=False)
    configuration: Array = field(init=False)
    velocity: Array = field(init=False)
    state_estimated: Array = field(init=False)
    state_reference: Array = field(init=False)
    inputs_reference: Array = field(init=False)
    phase: NDArray[np.int64] = field(init=False)
    heading_estimated: Array = field(init=False)
    inputs: Array = field(init=False)
    differential_duty: Array = field(init=False)
    wheel_duty: Array = field(init=False)
    thrust: Array = field(init=False)
    servo_torque: Array = field(init=False)
    statistics: Array = field(init=False)
    contact_position_in_world: Array = field(init=False)
    point_force_in_world: Array = field(init=False)
    diagnostics: Array = field(init=False)
    control_seconds: Array = field(init=False)
    battery: Array = field(init=False)

    def __post_init__(self) -> None:
        robot = self.plant.model.robot
        n, wheels = self.capacity, len(robot.wheels)
        self.time = np.zeros(n)
        self.configuration = np.zeros((n, robot.model.nq))
        self.velocity = np.zeros((n, robot.model.nv))
        self.state_estimated = np.zeros((n, 4))
        self.state_reference = np.full((n, 4), np.nan)
        self.inputs_reference = np.full((n, 2), np.nan)
        self.phase = np.zeros(n, dtype=np.int64)
        self.heading_estimated = np.zeros(n)
        self.inputs = np.zeros((n, 2))
        self.differential_duty = np.zeros(n)
        self.wheel_duty = np.zeros((n, wheels))
        self.thrust = np.zeros((n, len(robot.thrusters)))
        self.servo_torque = np.zeros((n, len(robot.servos)))
        self.statistics = np.zeros((n, wheels, kernels.STATISTICS_COLUMNS))
        self.contact_position_in_world = np.zeros((n, wheels, 3))
        self.point_force_in_world = np.zeros((n, len(robot.contact_points), 3))
        self.diagnostics = np.zeros((n, len(Diagnostics._fields)))
        self.control_seconds = np.zeros(n)
        self.battery = np.zeros((n if self.plant.battery is not None else 0, len(BatteryState._fields)))

    def contact_forces(self, rows: slice) -> Array:
        """Force of the ground on every wheel in the world, mean over each of the rows.

        Args:
            rows: Which rows, one after the other.

        Returns:
            Shape (rows, wheels, 3) [N].
        """
        first, last, _ = rows.indices(self.count)
        impulse = self.statistics[max(first - 1, 0) : last, :, kernels.IMPULSE_X : kernels.IMPULSE_Z + 1]
        if first == 0:  # the sums start at zero
            impulse = np.concatenate([np.zeros((1, *impulse.shape[1:])), impulse])
        return np.diff(impulse, axis=0) / self.plant.control_period

    def record_decision(
        self,
        state: Array,
        heading: float,
        inputs: Array,
        differential: float,
        diagnostics: Diagnostics,
        seconds: float,
        reference: tuple[Array, Array] | None = None,
    ) -> None:
        """Record what the controller saw, wanted and did; call before the plant steps."""
        k, plant = self.count, self.plant
        self.time[k] = plant.time
        self.configuration[k] = plant.stepper.configuration
        self.velocity[k] = plant.stepper.velocity
        self.state_estimated[k] = state
        self.heading_estimated[k] = heading
        self.inputs[k] = inputs
        self.differential_duty[k] = differential
        if reference is not None:
            self.state_reference[k], self.inputs_reference[k] = reference
        self.diagnostics[k] = diagnostics
        self.control_seconds[k] = seconds

    def record_outcome(self) -> None:
        """Record what the plant did during the period, and close the row."""
        k, stepper = self.count, self.plant.stepper
        self.wheel_duty[k] = stepper.actuation.wheel_duty
        self.thrust[k] = stepper.actuation.thrust
        self.servo_torque[k] = stepper.servo_torque
        self.statistics[k] = stepper.statistics
        stepper.clear_peaks()
        self.contact_position_in_world[k] = stepper.wheel_contact_in_world
        self.point_force_in_world[k] = stepper.point_force_in_world
        self.phase[k] = self.current_phase
        if len(self.battery):
            self.battery[k] = self.plant.battery
        self.count = k + 1
        if self.observer is not None:
            started = perf_counter()
            try:
                self.observer(self)
            finally:
                self.observer_seconds += perf_counter() - started
