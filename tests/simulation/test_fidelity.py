"""Each switch of the plant's fidelity does what it says: against closed forms, one at a time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m4_dynamics.control.estimator import IMU_ENTRIES
from m4_dynamics.control.imu import ImuErrors
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.terrain import flat_terrain
from m4_dynamics.simulation.actuators import limited_duty
from m4_dynamics.simulation.battery import Battery
from m4_dynamics.simulation.climb import ClimbSettings, prepare_climb, run_climb
from m4_dynamics.simulation.fidelity import Fidelity
from m4_dynamics.simulation.plant import Plant

PERIOD = 5e-3


def standing(m4):
    q = m4.posture("ugv").configuration.copy()
    q[2] = 0.2939
    return q


def plant_with(m4, fidelity, *, height=0.0):
    plant = Plant(FullModel.build(m4, flat_terrain()), fidelity=fidelity)
    q = standing(m4)
    q[2] += height
    plant.reset(q)
    return plant


def test_everything_is_off_by_default():
    assert Fidelity() == Fidelity.ideal()
    assert Fidelity().switches == ()
    assert Fidelity().senses_exactly
    assert len(Fidelity.realistic().switches) == 8
    assert not Fidelity.realistic().senses_exactly


def test_switches_that_do_not_bite_change_nothing(m4):
    # Both ways through the plant, at once and step by step, must be the same motion where no limit is met.
    settings = ClimbSettings(slope=math.radians(30.0), duration=5.5, controller="lqr", pitch_error=0.01)
    plain = run_climb(m4, settings).dataset
    limited = run_climb(m4, replace(settings, fidelity=Fidelity(motor_limits=True))).dataset
    np.testing.assert_allclose(limited.configuration, plain.configuration, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(limited.wheel_duty, plain.wheel_duty, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("time_constant", [0.03, 0.15])
def test_rotor_lag_is_first_order_up_and_down(m4, time_constant):
    plant = plant_with(m4, Fidelity(rotor_time_constant=time_constant))
    plant.command.thrust[:] = 5.0
    for k in range(1, 41):
        plant.step()
        expected = 5.0 * (1.0 - math.exp(-k * PERIOD / time_constant))
        np.testing.assert_allclose(plant.stepper.actuation.thrust, expected, rtol=1e-12)
    top = plant.stepper.actuation.thrust.copy()
    plant.command.thrust[:] = 0.0
    for _ in range(20):
        plant.step()
    np.testing.assert_allclose(plant.stepper.actuation.thrust, top * math.exp(-20 * PERIOD / time_constant), rtol=1e-12)


def test_rotor_lag_overrides_the_robots_own(m4):
    own = replace(m4, thrusters=tuple(replace(thruster, time_constant=0.1) for thruster in m4.thrusters))
    for fidelity, expected in ((Fidelity(), 1.0 - math.exp(-1.0)), (Fidelity(rotor_time_constant=0.0), 1.0)):
        plant = plant_with(own, fidelity)
        plant.command.thrust[:] = 5.0
        for _ in range(20):
            plant.step()
        np.testing.assert_allclose(plant.stepper.actuation.thrust, 5.0 * expected, rtol=1e-12)


def test_servo_targets_slew_at_the_velocity_limit(m4):
    plant = plant_with(m4, Fidelity(servo_speed_limit=True))
    start = plant.command.servo_targets.copy()
    limits = np.array([servo.velocity_limit for servo in m4.servos])
    signs = np.where(np.arange(len(limits)) % 2, -1.0, 1.0)
    plant.command.servo_targets += signs * 0.1
    for k in range(1, 31):
        plant.step()
        moved = plant.stepper.actuation.servo_targets - start
        np.testing.assert_allclose(moved, signs * np.minimum(limits * k * PERIOD, 0.1), atol=1e-12)


def test_servo_targets_jump_without_the_limit(m4):
    plant = plant_with(m4, Fidelity())
    plant.command.servo_targets += 0.1
    wanted = plant.command.servo_targets.copy()
    plant.step()
    np.testing.assert_array_equal(plant.stepper.actuation.servo_targets, wanted)


@settings(deadline=None)  # the first call compiles
@given(
    duty=st.floats(-1.0, 1.0),
    rate=st.floats(-30.0, 30.0),
    torque_limit=st.floats(0.1, 5.0),
    speed_limit=st.floats(1.0, 20.0),
)
def test_motor_driver_keeps_torque_and_speed_limits(duty, rate, torque_limit, speed_limit):
    stall, emf = 3.0, 0.2
    let_through = limited_duty(duty, rate, stall, emf, torque_limit, speed_limit)
    asked, given_torque = stall * duty - emf * rate, stall * let_through - emf * rate
    assert abs(given_torque) <= torque_limit + 1e-9
    if abs(rate) >= speed_limit:
        assert given_torque * rate <= 1e-9, "no torque drives it faster"
    if abs(asked) <= torque_limit and (abs(rate) < speed_limit or asked * rate <= 0.0):
        assert let_through == pytest.approx(duty, abs=1e-12)
    # What is taken away never turns the torque round.
    assert asked * given_torque >= -1e-9


def test_motor_limits_hold_a_plugged_wheel_to_its_effort_limit(m4):
    # A wheel in the air spins backwards at 10 rad/s, then gets full duty: 3 N m of stall torque, 2 N m of back-EMF.
    for limits, torque in ((False, 5.0), (True, 3.0)):
        plant = Plant(FullModel.build(m4, flat_terrain()), fidelity=Fidelity(motor_limits=limits), control_period=1e-3)
        q, v = standing(m4), np.zeros(m4.model.nv)
        q[2] += 5.0
        wheel = m4.wheels[0]
        v[wheel.index_v] = -10.0
        plant.reset(q, v)
        plant.command.wheel_duty[0] = 1.0
        plant.step()
        duty = plant.stepper.actuation.wheel_duty[0]
        assert 3.0 * duty + 0.2 * 10.0 == pytest.approx(torque, abs=1e-9)


def test_encoder_counts_are_whole_and_near(m4):
    plant = plant_with(m4, Fidelity(encoder_counts=512))
    exact = plant_with(m4, Fidelity())
    resolution = 2.0 * math.pi / 512
    wheels = len(m4.wheels)
    before = plant.measurement[IMU_ENTRIES : IMU_ENTRIES + wheels].copy()
    for _ in range(200):
        for one in (plant, exact):
            one.command.wheel_duty[:] = 0.15
            one.step()
        counted = plant.measurement[IMU_ENTRIES : IMU_ENTRIES + wheels]
        truth = exact.measurement[IMU_ENTRIES : IMU_ENTRIES + wheels]
        np.testing.assert_allclose(counted / resolution, np.round(counted / resolution), atol=1e-9)
        assert np.abs(counted - truth).max() <= 0.5 * resolution + 1e-9
        np.testing.assert_allclose(plant.measurement[IMU_ENTRIES + wheels :], (counted - before) / PERIOD, atol=1e-12)
        before = counted.copy()
    assert np.abs(truth).min() > 10 * resolution


def test_imu_noise_has_the_stated_density_and_offsets(m4):
    errors = ImuErrors(gyro_noise=2e-3, gyro_bias=0.05, gyro_bias_walk=0.0, accelerometer_noise=0.03)
    plant = plant_with(m4, Fidelity(imu=errors, seed=5))
    exact = plant_with(m4, Fidelity())
    samples = np.array([plant.measure_held()[4:10].copy() for _ in range(4000)]) - exact.measure_held()[4:10]
    # White noise of density n in the band up to half the rate f has the variance n^2 f / 2.
    deviations = np.array([2e-3] * 3 + [0.03] * 3) * math.sqrt(0.5 / PERIOD)
    np.testing.assert_allclose(samples.std(axis=0), deviations, rtol=5.0 / math.sqrt(2.0 * 4000))
    np.testing.assert_allclose(samples.mean(axis=0), plant.sensors.bias, atol=5.0 * deviations.max() / math.sqrt(4000))
    assert abs(np.corrcoef(samples[:-1, 0], samples[1:, 0])[0, 1]) < 0.08, "white"
    np.testing.assert_array_equal(plant.measurement[:4], exact.measurement[:4])


def test_offsets_are_drawn_and_wander_as_stated(m4):
    errors = ImuErrors(gyro_bias=0.05, gyro_bias_walk=0.02, accelerometer_bias=0.3)
    starts, wandered = [], []
    plant = plant_with(m4, Fidelity(imu=errors))
    for seed in range(60):
        plant.sensors.fidelity = Fidelity(imu=errors, seed=seed)
        plant.sensors.reset()
        starts.append(plant.sensors.bias.copy())
        for _ in range(200):
            plant.measure_held()
        wandered.append(plant.sensors.bias - starts[-1])
    first, moved = np.array(starts), np.array(wandered)
    # 180 draws: a standard deviation within four of its own deviations, 1 / sqrt(360) each.
    assert first[:, :3].std() == pytest.approx(0.05, rel=0.21)
    assert first[:, 3:].std() == pytest.approx(0.3, rel=0.21)
    assert moved[:, :3].std() == pytest.approx(0.02, rel=0.21)  # after one second
    assert np.all(moved[:, 3:] == 0.0)


def test_same_seed_same_noise_other_seed_other_noise(m4):
    runs = []
    for seed in (3, 3, 4):
        plant = plant_with(m4, Fidelity.realistic(seed=seed))
        plant.command.wheel_duty[:] = 0.1
        runs.append(np.array([plant.step().copy() for _ in range(100)]))
    np.testing.assert_array_equal(runs[0], runs[1])
    assert np.nanmax(np.abs(runs[0] - runs[2])) > 1e-3


def test_an_attitude_that_is_not_measured_cannot_be_read(m4):
    plant = plant_with(m4, Fidelity(attitude_estimated=True))
    plant.step()
    assert np.isnan(plant.measurement[:4]).all()
    assert np.isfinite(plant.measurement[4:]).all()


@pytest.mark.parametrize("delay", [1, 3])
def test_commands_act_after_exactly_the_delay(m4, delay):
    plant = plant_with(m4, Fidelity(control_delay=delay))
    rng = np.random.default_rng(2)
    duties, thrusts = rng.uniform(-0.2, 0.2, (20, 4)), rng.uniform(0.0, 3.0, (20, 4))
    for k in range(20):
        plant.command.wheel_duty[:], plant.command.thrust[:] = duties[k], thrusts[k]
        plant.command.servo_targets[0] = 0.001 * k
        plant.step()
        actuation = plant.stepper.actuation
        if k < delay:
            assert not actuation.wheel_duty.any()
        else:
            np.testing.assert_array_equal(actuation.wheel_duty, duties[k - delay])
            np.testing.assert_array_equal(actuation.thrust, thrusts[k - delay])
            assert actuation.servo_targets[0] == 0.001 * (k - delay)


def test_a_push_is_not_delayed(m4):
    late, ideal = plant_with(m4, Fidelity(control_delay=3), height=5.0), plant_with(m4, Fidelity(), height=5.0)
    for plant in (late, ideal):
        plant.command.external_wrench[0] = 60.0
        plant.step()
    np.testing.assert_allclose(late.velocity, ideal.velocity, rtol=0.0, atol=1e-12)
    assert late.velocity[0] > 0.04


def test_settled_actuators_are_where_a_long_command_brings_them(m4):
    settled, waited = (plant_with(m4, Fidelity.realistic()) for _ in range(2))
    for plant in (settled, waited):
        plant.command.thrust[:] = 2.0
        plant.command.servo_targets += 0.05
    settled.settle_actuators()
    for _ in range(400):
        waited.step()
    np.testing.assert_allclose(
        settled.stepper.actuation.servo_targets, waited.stepper.actuation.servo_targets, atol=1e-12
    )
    np.testing.assert_allclose(settled.stepper.actuation.thrust, waited.stepper.actuation.thrust, rtol=1e-3)
    assert settled.battery.voltage == pytest.approx(waited.battery.voltage, rel=1e-3)
    assert settled.battery.charge == 1.0


def test_sagging_battery_weakens_duty_and_thrust(m4):
    plant = plant_with(m4, Fidelity(battery=Battery(charge=0.3)))
    plant.command.wheel_duty[:] = 0.1
    plant.command.thrust[:] = 3.0
    plant.step()
    ratio = plant.battery.voltage / Battery().full_voltage
    assert 0.8 < ratio < 0.95
    plant.step()
    np.testing.assert_allclose(plant.stepper.actuation.wheel_duty, 0.1 * ratio, rtol=1e-12)
    np.testing.assert_allclose(plant.stepper.actuation.thrust, 3.0 * ratio**2, rtol=1e-12)


def test_the_recorder_keeps_battery_and_actual_thrust(m4):
    climb = prepare_climb(m4, ClimbSettings(slope=math.radians(45.0), fidelity=Fidelity.realistic()))
    for _ in range(60):
        climb.loop.advance()
    recorder = climb.recorder
    assert recorder.battery[:60, 0].min() > 20.0
    assert np.all(np.diff(recorder.battery[:60, 2]) < 0.0)
    # The thrust on record is the rotors', which lags behind the commanded one by their time constant.
    commanded, given_thrust = recorder.inputs[:60, 1], recorder.thrust[:60].sum(axis=1)
    ratio = recorder.battery[:60, 0] / Battery().full_voltage
    share = 1.0 - math.exp(-PERIOD / 0.15)
    expected = given_thrust[1:-1] + share * (ratio[1:-1] ** 2 * commanded[1:-1] - given_thrust[1:-1])
    np.testing.assert_allclose(given_thrust[2:], expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Fidelity(rotor_time_constant=-0.1), "rotor_time_constant"),
        (lambda: Fidelity(rotor_time_constant=math.nan), "rotor_time_constant"),
        (lambda: Fidelity(encoder_counts=-1), "encoder_counts"),
        (lambda: Fidelity(control_delay=-1), "control_delay"),
        (lambda: Fidelity(seed=-1), "seed"),
        (lambda: ImuErrors(gyro_noise=-1.0), "gyro_noise"),
        (lambda: ImuErrors(accelerometer_bias=math.inf), "accelerometer_bias"),
        (lambda: Battery(charge=0.0), "charge"),
        (lambda: Battery(capacity=0.0), "capacity"),
        (lambda: Battery(resistance=math.nan), "resistance"),
    ],
)
def test_figures_that_cannot_be_meant_are_refused(make, message):
    with pytest.raises(InvalidSettingError, match=message):
        make()
