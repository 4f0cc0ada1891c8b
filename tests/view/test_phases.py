"""Phases are what the trajectory says: contiguous, in order, each sample in one of them."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import xarray

from m4_dynamics.errors import ResultFileError
from m4_dynamics.simulation.trajectory import load_trajectory, save_trajectory
from m4_dynamics.view.phases import balancing_samples, corner_times, phases_of, predictive_samples


def test_phases_follow_each_other_over_the_whole_run(mission_run: xarray.Dataset) -> None:
    phases = phases_of(mission_run)
    assert [phase.name for phase in phases] == ["settle", "raise", "approach", "climb", "back", "sit"]
    assert [phase.kind for phase in phases] == ["morph", "raise", "balance", "balance", "balance", "sit"]
    assert [phase.label for phase in phases][2:4] == ["approach (PID)", "climb (MPC)"]
    assert phases[0].first == 0
    assert phases[-1].last == mission_run.sizes["time"]
    assert phases[-1].end == float(mission_run.time[-1])
    for before, after in itertools.pairwise(phases):
        assert before.last == after.first
        assert before.end == after.start == float(mission_run.time[after.first])
    for order, phase in enumerate(phases):
        assert (mission_run.phase.values[phase.first : phase.last] == order).all()


def test_it_balances_and_predicts_in_the_right_phases(mission_run: xarray.Dataset) -> None:
    phase = mission_run.phase.values
    np.testing.assert_array_equal(balancing_samples(mission_run), (phase >= 2) & (phase <= 4))
    np.testing.assert_array_equal(predictive_samples(mission_run), (phase >= 3) & (phase <= 4))


def test_a_corner_is_met_where_the_wheels_touch_both_sides(mission_run: xarray.Dataset) -> None:
    up, down = corner_times(mission_run)
    for time in (up, down):
        # In a concave corner the wheel touches the level ground r tan(b / 2) before the foot.
        axle = mission_run.axle_position_in_world.sel(time=time, method="nearest").values
        assert axle[0] == pytest.approx(-0.125 * np.tan(np.deg2rad(10.0)), abs=5e-3)
        assert axle[2] == pytest.approx(0.125, abs=2e-3)
    assert up < down


def test_a_climb_has_no_phases(climb: xarray.Dataset) -> None:
    assert phases_of(climb) == ()
    assert balancing_samples(climb).all()
    assert predictive_samples(climb).all()
    assert not predictive_samples(climb.assign_attrs(controller="lqr")).any()
    assert corner_times(climb).size == 0


def test_a_single_phase_survives_its_file(mission_run: xarray.Dataset, tmp_path: Path) -> None:
    # A list of one comes back from the file as a plain string.
    alone = mission_run.isel(time=mission_run.phase.values == 3)
    names = {key: [mission_run.attrs[key][3]] for key in ("phases", "phase_kinds", "phase_controllers")}
    alone = alone.assign(phase=0 * alone.phase).assign_attrs(names)
    (phase,) = phases_of(load_trajectory(save_trajectory(alone, tmp_path / "trajectory.nc")))
    assert phase.label == "climb (MPC)"
    assert phase.last == alone.sizes["time"]


def test_part_of_a_phase_keeps_its_samples(mission_run: xarray.Dataset) -> None:
    climb = phases_of(mission_run)[3]
    part = climb.within(climb.start + 1.0, climb.end + 1.0)
    assert (part.start, part.end) == (climb.start + 1.0, climb.end)
    assert (part.first, part.last, part.name) == (climb.first, climb.last, climb.name)


def test_phases_that_do_not_fit_are_refused(mission_run: xarray.Dataset) -> None:
    with pytest.raises(ResultFileError, match="don't fit together"):
        phases_of(mission_run.assign_attrs(phases=["one", "two"]))
