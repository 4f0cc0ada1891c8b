"""A lithium-polymer pack whose voltage falls with its charge and with the current drawn.

At rest a pack of n cells has the voltage n E(charge), E a fixed curve. Under a load of power P its inner resistance R
takes part of it: V = n E - R I with V I = P, so

    V = n E / 2 + sqrt((n E / 2)^2 - R P),   I = P / V,   charge' = -I / capacity.

A motor's duty acts in proportion to V: the voltage on its winding is duty times V. A rotor at a given throttle turns in
proportion to V, and its thrust goes with the square of that. Both are right at the full pack's rest voltage.

The power drawn is that of `reduced/power.py`: rotors by momentum theory, motors by their work and winding losses,
nothing fed back; and a constant for everything else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.reduced.power import PowerModel

__all__ = ["Battery", "BatteryState", "Supply"]

Array = NDArray[np.float64]

#: Rest voltage of one cell [V] at charges of 0, 10 ... 100 %: the usual table for lithium-polymer cells, which differ
#: by a few hundredths of a volt from maker to maker (assumed).
_CHARGES = np.linspace(0.0, 1.0, 11)
_REST_VOLTAGES = np.array([3.27, 3.69, 3.73, 3.77, 3.79, 3.84, 3.87, 3.95, 4.02, 4.11, 4.20])

# Entries of the state that the kernel keeps.
_VOLTAGE, _CURRENT, _CHARGE = range(3)


class BatteryState(NamedTuple):
    """What a pack is doing.

    Attributes:
        voltage: At its terminals [V].
        current: Drawn from it [A].
        charge: What is left, 1 full, 0 empty.
    """

    voltage: float
    current: float
    charge: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Battery:
    """A pack and what it feeds; the defaults are M4's, a 6S pack of 4000 mAh (paper, section II).

    What no publication gives is assumed, for the reason stated.

    Attributes:
        cells: Cells in series.
        capacity: [A h].
        charge: At the start, 1 full. Full, because a climb is flown on a fresh pack.
        resistance: Of the whole pack with its leads [ohm]. Assumed: 3 milliohm a cell, as new packs of this size rated
            for 40 C have, and 12 milliohm of leads and connectors.
        base_power: Of computer, receiver and holding servos [W]. Assumed: an embedded computer's.
        power: Figures of the rotors; those are assumed too, see `PowerModel`. Its number of rotors is not used.
    """

    cells: int = 6
    capacity: float = 4.0
    charge: float = 1.0
    resistance: float = 0.03
    base_power: float = 15.0
    power: PowerModel = field(default_factory=lambda: PowerModel(thruster_count=1))

    def __post_init__(self) -> None:
        if self.cells < 1:
            raise InvalidSettingError("battery cells", self.cells, "a whole number >= 1")
        for name, least in (("capacity", 1e-6), ("resistance", 0.0), ("base_power", 0.0)):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= least):
                raise InvalidSettingError(f"battery {name}", value, f"a finite number >= {least:g}")
        if not 0.0 < self.charge <= 1.0:
            raise InvalidSettingError("battery charge", self.charge, "a share of the capacity in (0, 1]")

    @property
    def full_voltage(self) -> float:
        """Rest voltage of the full pack, at which duties and thrusts are as commanded [V]."""
        return float(self.cells * _REST_VOLTAGES[-1])

    def rest_voltage(self, charge: float) -> float:
        """Voltage without load [V] at a charge between 0 and 1."""
        return float(self.cells * np.interp(charge, _CHARGES, _REST_VOLTAGES))

    def voltage_under_load(self, charge: float, power: float) -> float:
        """Voltage at the terminals [V] while a power [W] is drawn.

        A pack gives (n E)^2 / 4 R at most; who asks for more gets that, at half the rest voltage.
        """
        half = 0.5 * self.rest_voltage(charge)
        return half + math.sqrt(max(half * half - self.resistance * power, 0.0))


@njit(cache=True)
def electric_power(
    thrust: Any, thrust_power: float, wheel_duty: Any, wheel_motor: Any, wheel_rate: Any, wheel_velocity_indices: Any
) -> float:
    """Power of all rotors and motors [W]; the same formulas as `reduced/power.py`.

    Args:
        thrust: Of each rotor, shape (thrusters,) [N].
        thrust_power: Power of a rotor over its thrust to 1.5 [W/N^1.5].
        wheel_duty: Duty of each motor, shape (wheels,).
        wheel_motor: Stall torque and back-EMF constant of each motor, shape (wheels, 2) [N m, N m s].
        wheel_rate: v, shape (nv,).
        wheel_velocity_indices: Where each wheel stands in v, shape (wheels,).
    """
    total = 0.0
    for i in range(thrust.shape[0]):
        total += thrust_power * max(thrust[i], 0.0) ** 1.5
    for i in range(wheel_duty.shape[0]):
        stall_torque, back_emf = wheel_motor[i, 0], wheel_motor[i, 1]
        rate = wheel_rate[wheel_velocity_indices[i]]
        torque = stall_torque * wheel_duty[i] - back_emf * rate
        losses = torque * torque / back_emf if back_emf > 0.0 else 0.0
        total += max(torque * rate + losses, 0.0)
    return total


@dataclass(slots=True, eq=False)
class Supply:
    """A battery in use.

    Attributes:
        battery: The pack.
    """

    battery: Battery
    _state: Array = field(init=False, repr=False)
    _thrust_power: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        rotor = self.battery.power
        disc_area = math.pi * rotor.rotor_radius**2
        self._thrust_power = 1.0 / (rotor.figure_of_merit * math.sqrt(2.0 * rotor.air_density * disc_area))
        self._state = np.zeros(3)
        self.reset()

    @property
    def state(self) -> BatteryState:
        """Voltage, current and charge now."""
        return BatteryState(*self._state.tolist())

    @property
    def values(self) -> Array:
        """The same as a live array, shape (3,)."""
        return self._state

    @property
    def ratio(self) -> float:
        """Voltage over that of the full pack at rest."""
        return float(self._state[_VOLTAGE]) / self.battery.full_voltage

    def reset(self) -> None:
        """Put the pack in as it was at the start, without a load."""
        charge = self.battery.charge
        self._state[:] = self.battery.rest_voltage(charge), 0.0, charge

    def draw(
        self, thrust: Array, wheel_duty: Array, wheel_motor: Array, velocity: Array, wheel_velocity_indices: Any,
        duration: float,
    ) -> None:  # fmt: skip
        """Feed rotors and motors for a while; see `electric_power` for the arguments.

        Args:
            thrust: What the rotors give [N].
            wheel_duty: What acts on the motors.
            wheel_motor: Their constants.
            velocity: v, shape (nv,).
            wheel_velocity_indices: Where the wheels stand in v.
            duration: How long [s].
        """
        battery, state = self.battery, self._state
        power = battery.base_power + electric_power(
            thrust, self._thrust_power, wheel_duty, wheel_motor, velocity, wheel_velocity_indices
        )
        before = float(state[_CHARGE])
        voltage = battery.voltage_under_load(before, power)
        current = power / voltage
        if battery.resistance > 0.0:
            current = min(current, (battery.rest_voltage(before) - voltage) / battery.resistance)
        state[:] = voltage, current, max(before - current * duration / (3600.0 * battery.capacity), 0.0)
