"""The trajectory file: labelled, whole, and read back as it was; the summary's figures from made-up runs."""

from __future__ import annotations

import json
import math

import numpy as np
import pinocchio as pin
import pytest
import xarray

from m4_dynamics.errors import ResultFileError
from m4_dynamics.simulation.trajectory import load_trajectory, save_trajectory
from m4_dynamics.simulation.verdict import summarise_climb


def test_every_variable_has_unit_and_meaning(climb):
    dataset = climb(45.0, 5.0).dataset
    for name, variable in dataset.data_vars.items():
        assert variable.attrs["units"], name
        assert variable.attrs["long_name"], name
    assert dataset.time.attrs["units"] == "s"


def test_true_motion_is_that_of_the_configuration(climb, m4):
    dataset = climb(45.0, 5.0).dataset
    model, data = m4.model, m4.model.createData()
    for k in (0, 137, 1500):
        q = dataset.configuration.to_numpy()[k]
        pin.forwardKinematics(model, data, q)
        centres = [data.oMi[m4.wheel(name).joint_id].translation for name in dataset.attrs["drive_wheels"]]
        np.testing.assert_allclose(dataset.axle_position_in_world.to_numpy()[k], np.mean(centres, axis=0), atol=1e-12)
        np.testing.assert_allclose(dataset.com_in_world.to_numpy()[k], pin.centerOfMass(model, data, q), atol=1e-12)


def test_true_rates_are_derivatives_of_true_angles(climb):
    dataset = climb(45.0, 5.0).dataset
    state, time = dataset.state.to_numpy(), dataset.time.to_numpy()
    differences = (state[2:, :2] - state[:-2, :2]) / (time[2:] - time[:-2])[:, None]
    np.testing.assert_allclose(differences[100:], state[101:-1, 2:], atol=5e-3)


def test_drive_wheel_duties_count_forward(climb):
    dataset = climb(45.0, 5.0).dataset
    driven = dataset.wheel_duty.sel(wheel=dataset.attrs["drive_wheels"])
    np.testing.assert_allclose(driven.mean("wheel"), dataset.inputs.sel(reduced_input="duty"), atol=1e-12)


def test_written_and_read_back(climb, tmp_path):
    dataset = climb(45.0, 5.0).dataset
    path = save_trajectory(dataset, tmp_path / "trajectory.nc")
    xarray.testing.assert_identical(load_trajectory(path).drop_attrs(), dataset.drop_attrs())
    assert load_trajectory(tmp_path).attrs["slope_deg"] == pytest.approx(45.0)
    assert [file.name for file in tmp_path.iterdir()] == ["trajectory.nc"]


def test_unreadable_files_are_named(tmp_path):
    with pytest.raises(ResultFileError, match="no trajectory at"):
        load_trajectory(tmp_path)
    (tmp_path / "trajectory.nc").write_bytes(b"not a NetCDF file")
    with pytest.raises(ResultFileError, match="not a readable trajectory"):
        load_trajectory(tmp_path)
    with pytest.raises(ResultFileError, match="cannot write"):
        save_trajectory(xarray.Dataset(), tmp_path / "missing" / "trajectory.nc")


def test_summary_is_json_without_nan(climb):
    text = json.dumps(climb(45.0, 5.0).summary.as_dict(), allow_nan=False)
    keys = json.loads(text).keys()
    assert {
        "verdict", "slope_deg", "friction_static", "max_friction_use", "min_normal_force_N", "slip_time_s",
        "slip_distance_m", "max_slip_speed_m_s", "wheel_rms_m", "pitch_rms_deg", "yaw_max_deg", "climbed_m",
        "ground_force_rms_over_weight", "steady_cost", "fallbacks", "mpc_step_us", "real_time_factor",
    } <= keys  # fmt: skip


def altered(dataset: xarray.Dataset, **changes: np.ndarray) -> xarray.Dataset:
    return dataset.assign({name: (dataset[name].dims, values) for name, values in changes.items()})


def test_verdict_slipped_from_the_slip_time(climb):
    dataset = climb(45.0, 5.0).dataset
    slip_time = dataset.slip_time.to_numpy().copy()
    slip_time[600:640, :] = 5e-3
    summary = summarise_climb(altered(dataset, slip_time=slip_time), ended=None, controller="default")
    assert (summary.verdict, round(summary.slip_time_s, 6)) == ("slipped", 0.2)


def test_slip_before_half_a_second_is_not_judged(climb):
    dataset = climb(45.0, 5.0).dataset
    slip_time = dataset.slip_time.to_numpy().copy()
    slip_time[:100, :] = 5e-3
    assert summarise_climb(altered(dataset, slip_time=slip_time), ended=None, controller="x").verdict == "climbed"


def test_verdict_lagged_from_the_distance(climb):
    dataset = climb(45.0, 5.0).dataset
    state = dataset.state.to_numpy().copy()
    state[:, 0] *= 0.5
    summary = summarise_climb(altered(dataset, state=state), ended=None, controller="x")
    assert summary.verdict == "lagged"
    assert summary.climbed_m == pytest.approx(0.9, abs=0.01)
    assert any("behind its reference" in remark for remark in summary.remarks)


def test_tracking_figures_are_root_mean_squares_after_the_first_second(climb):
    dataset = climb(45.0, 5.0).dataset
    state = dataset.state_reference.to_numpy().copy()
    state[:200] += 100.0  # the first second does not count
    state[200:, 0] += 0.08 * np.where(np.arange(len(state) - 200) % 2, 1.0, -1.0)
    state[200:, 1] += math.radians(0.5)
    summary = summarise_climb(altered(dataset, state=state), ended=None, controller="x")
    assert summary.wheel_rms_m == pytest.approx(0.08 * 0.125)
    assert summary.pitch_rms_deg == pytest.approx(0.5)


def test_a_run_that_ends_early_keeps_its_reason(climb):
    dataset = climb(45.0, 5.0).dataset.isel(time=slice(0, 60))
    summary = summarise_climb(dataset, ended="fell: it leaned over", controller="x")
    assert (summary.verdict, summary.reason) == ("fell", "it leaned over")
    assert summary.wheel_rms_m is None  # nothing was simulated after the first second
