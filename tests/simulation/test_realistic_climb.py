"""The climb on a plant with every imperfection, and how well the estimator knows the state on it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from m4_dynamics.control.imu import ImuErrors
from m4_dynamics.simulation.climb import ClimbSettings, prepare_climb
from m4_dynamics.simulation.fidelity import Fidelity
from m4_dynamics.simulation.trajectory import true_motion

STARTS = [(slope, error) for slope in (15.0, 30.0, 45.0) for error in (5.0, -5.0)]


@pytest.mark.parametrize(("slope", "error"), STARTS)
def test_climbs_without_slipping(climb, slope, error):
    summary = climb(slope, error, fidelity=Fidelity.realistic()).summary
    assert summary.verdict == "climbed", summary.reason
    assert len(summary.fidelity) == 8
    assert summary.slip_time_s == 0.0  # allowed 0.1
    assert summary.air_time_s == 0.0
    assert summary.fallbacks == 0
    assert summary.newton_failures == 0
    assert summary.wheel_rms_m <= 0.01  # measured 0.003 to 0.007
    assert summary.pitch_rms_deg <= 0.5
    assert summary.yaw_max_deg <= 0.5
    assert summary.end_speed_m_s <= 1e-2  # the noise of the estimated speed is 4 mm/s
    assert summary.ground_force_rms_over_weight <= 0.02
    assert 23.0 < summary.battery_min_V < 25.2
    assert summary.battery_charge_end < 1.0


@pytest.mark.parametrize(("slope", "error"), STARTS)
def test_the_estimate_is_near_the_truth(climb, slope, error):
    # Without the accelerometer's offset, which no filter can see, 0.1 deg of pitch are left.
    imu = ImuErrors(accelerometer_bias=0.0)
    result = climb(slope, error, fidelity=replace(Fidelity.realistic(seed=1), imu=imu))
    dataset = result.dataset
    settled = dataset.time.to_numpy() > 1.0
    miss = (dataset.state_estimated - dataset.state).to_numpy()[settled]
    assert result.summary.pitch_estimate_rms_deg < 0.15
    assert result.summary.heading_estimate_max_deg < 0.3
    assert miss[:, 2].std() * 0.125 < 5e-3, "speed along the slope [m/s]"
    assert abs(miss[:, 2].mean()) * 0.125 < 1e-3
    assert miss[:, 3].std() < 1.2 * ImuErrors.sample_deviation(imu.gyro_noise, 5e-3)


@pytest.mark.parametrize("seed", range(3))
def test_pitch_and_gyro_offset_lie_within_what_the_filter_expects(m4, seed):
    settings = ClimbSettings(slope=math.radians(30.0), fidelity=Fidelity.realistic(seed=seed), duration=6.0)
    climb = prepare_climb(m4, settings)
    count = len(climb.reference.time)
    expected = np.empty(count)
    for k in range(count):
        climb.loop.advance()
        expected[k] = climb.loop.estimator.pitch_deviation
    recorder, frame = climb.recorder, climb.reduction.frame
    truth = true_motion(
        climb.plant.model, climb.reduction, recorder.configuration[:count], recorder.velocity[:count]
    ).state
    # The accelerometer's offset along the horizontal looks like a tilt: the one error that the filter cannot see.
    offsets = climb.plant.sensors.bias
    forward, _, up = frame.rotation_in_base.T @ offsets[3:]
    seen_as_tilt = -(np.cos(truth[:, 1]) * forward + np.sin(truth[:, 1]) * up) / 9.81
    left_over = (recorder.state_estimated[:count, 1] - truth[:, 1] - seen_as_tilt) / expected
    assert np.abs(left_over).max() < 4.0
    assert np.sqrt((left_over**2).mean()) < 2.0
    gyro_offset = frame.rotation_in_base.T @ offsets[:3]
    np.testing.assert_allclose(climb.loop.estimator.gyro_bias, gyro_offset, atol=1.5e-3)
    assert np.abs(climb.loop.estimator.gyro_bias - gyro_offset).max() < np.abs(gyro_offset).max()


def test_exact_sensors_without_attitude_lose_next_to_nothing(climb):
    given = climb(45.0, 5.0).summary
    estimated = climb(45.0, 5.0, fidelity=Fidelity(attitude_estimated=True)).summary
    assert estimated.pitch_estimate_rms_deg < 0.01
    assert estimated.wheel_rms_m < given.wheel_rms_m + 1e-3


def test_the_rotors_lag_is_known_and_costs_little(climb):
    lagging = climb(45.0, 5.0, fidelity=Fidelity(rotor_time_constant=0.15))
    assert lagging.summary.verdict == "climbed"
    assert lagging.summary.wheel_rms_m <= 0.005
    commanded = lagging.dataset.inputs.sel(reduced_input="thrust").to_numpy()
    given = lagging.dataset.thrust.sum("thruster").to_numpy()
    assert np.abs(given - commanded)[:100].max() > 3.0, "the rotors must have lagged"


def test_summary_and_trajectory_say_what_was_on(climb):
    result = climb(15.0, 5.0, fidelity=Fidelity(encoder_counts=4096, control_delay=1))
    assert result.summary.fidelity == ("encoders of 4096 counts", "control delay of 1 sample")
    assert result.dataset.attrs["fidelity"] == "encoders of 4096 counts, control delay of 1 sample"
    assert "battery_voltage" not in result.dataset
    assert result.summary.battery_min_V is None
    assert climb(15.0, 5.0).dataset.attrs["fidelity"] == "ideal"
