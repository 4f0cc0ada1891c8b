"""The battery's voltage law, its charge, and the power it is asked for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.power import PowerModel, power_needed
from m4_dynamics.simulation.battery import Battery, Supply

WHEELS = np.array([0, 1])
NO_MOTORS = np.zeros((0, 2))


def supply_power(supply: Supply, thrust: np.ndarray, duration: float) -> None:
    supply.draw(thrust, np.zeros(0), NO_MOTORS, np.zeros(0), np.zeros(0, dtype=np.int64), duration)


@given(charge=st.floats(0.01, 1.0), power=st.floats(0.0, 3000.0), resistance=st.floats(0.0, 0.03))
def test_voltage_and_current_obey_ohms_law_and_the_load(charge, power, resistance):
    battery = Battery(resistance=resistance)
    voltage = battery.voltage_under_load(charge, power)
    current = power / voltage
    assert voltage + resistance * current == pytest.approx(battery.rest_voltage(charge), rel=1e-9)
    assert voltage >= 0.5 * battery.rest_voltage(charge)


def test_a_pack_gives_no_more_than_it_has():
    battery = Battery(resistance=0.05)
    most = battery.rest_voltage(1.0) ** 2 / (4.0 * 0.05)
    assert battery.voltage_under_load(1.0, 10.0 * most) == pytest.approx(0.5 * battery.rest_voltage(1.0))
    supply = Supply(Battery(resistance=0.05))
    supply_power(supply, np.array([1e4]), 0.0)
    assert supply.state.voltage * supply.state.current == pytest.approx(most)


def test_rest_voltage_is_that_of_a_lithium_polymer_pack_and_rises_with_charge():
    battery = Battery()
    assert battery.full_voltage == pytest.approx(6 * 4.2)
    voltages = [battery.rest_voltage(charge) for charge in np.linspace(0.0, 1.0, 101)]
    assert np.all(np.diff(voltages) > 0.0)
    assert 3.7 < battery.rest_voltage(0.5) / 6 < 3.95


def test_charge_is_the_integral_of_the_current():
    supply = Supply(Battery(base_power=200.0))
    taken, steps, dt = 0.0, 2000, 0.05
    for _ in range(steps):
        supply_power(supply, np.zeros(0), dt)
        taken += supply.state.current * dt
    assert supply.state.charge == pytest.approx(1.0 - taken / (3600.0 * 4.0), rel=1e-12)
    # About 200 W at about 24 V for 100 s.
    assert taken == pytest.approx(200.0 / 24.0 * 100.0, rel=0.05)


def test_an_empty_pack_stays_empty():
    supply = Supply(Battery(charge=0.001))
    for _ in range(100):
        supply_power(supply, np.array([20.0, 20.0]), 1.0)
    assert supply.state.charge == 0.0


def test_power_is_that_of_the_power_model():
    parameters = MipParameters(
        mass_body=5.0, mass_wheel=1.0, inertia_body=0.3, inertia_wheel=0.004, com_in_body=(0.0, 0.4),
        thrust_point_in_body=(0.1, 0.7), wheel_radius=0.125, torque_constant=6.0, back_emf_constant=0.4,
    )  # fmt: skip
    rotor = PowerModel(thruster_count=2, rotor_radius=0.12, figure_of_merit=0.7)
    battery = Battery(resistance=0.0, base_power=0.0, power=rotor)
    rng = np.random.default_rng(0)
    for _ in range(50):
        thrust, duty, rate = rng.uniform(0.0, 40.0), rng.uniform(-1.0, 1.0), rng.uniform(-12.0, 12.0)
        supply = Supply(battery)
        motors = np.tile([0.5 * parameters.torque_constant, 0.5 * parameters.back_emf_constant], (2, 1))
        supply.draw(np.full(2, 0.5 * thrust), np.full(2, duty), motors, np.full(2, rate), WHEELS, 1.0)
        torque = parameters.torque_constant * duty - parameters.back_emf_constant * rate
        expected = float(power_needed(parameters, rotor, thrust, torque, rate))
        assert supply.state.voltage * supply.state.current == pytest.approx(expected, rel=1e-12, abs=1e-9)
