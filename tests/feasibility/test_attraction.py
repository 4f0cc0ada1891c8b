"""Regions of attraction: starts are what they say, and what comes back is judged by the truth."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from m4_dynamics.errors import InvalidSettingError, NoTrimExists, ResultFileError
from m4_dynamics.feasibility.attraction import (
    AttractionGrid,
    AttractionJob,
    AttractionSettings,
    attraction_dataset,
    make_attraction_job,
    reach,
)
from m4_dynamics.feasibility.attraction_rollout import (
    ATTRACTION_FIELDS,
    OUTCOMES,
    Outcome,
    Stand,
    Start,
    prepare_start,
    run_start,
)
from m4_dynamics.feasibility.cell import RolloutSettings
from m4_dynamics.feasibility.closed_loop import job_of_store, make_job
from m4_dynamics.feasibility.grid import MapGrid
from m4_dynamics.feasibility.run import run_job
from m4_dynamics.feasibility.store import open_store
from m4_dynamics.full import kernels
from m4_dynamics.robot.robot import Robot

ELAPSED = list(ATTRACTION_FIELDS).index("elapsed")


def small_job(robot: Robot, *, n: int = 5, speeds: tuple[float, ...] = (0.0,), **changes) -> AttractionJob:
    grid = AttractionGrid(speeds, np.radians(np.linspace(-40.0, 40.0, n)), np.radians(np.linspace(-200.0, 200.0, n)))
    settings = AttractionSettings(**{"slope": math.radians(45.0), "plant": "mip", "duration": 2.5, **changes})
    return make_attraction_job(robot, grid, settings)


@pytest.fixture(scope="module")
def stand(m4: Robot) -> Stand:
    return small_job(m4).stand


@pytest.fixture(scope="module")
def full_stand(m4: Robot) -> Stand:
    return small_job(m4, plant="full").stand


def record_of(stand: Stand, start: Start) -> dict[str, float]:
    return dict(zip(ATTRACTION_FIELDS, run_start(stand, start), strict=True))


def outcome_of(stand: Stand, start: Start) -> Outcome:
    return OUTCOMES[int(record_of(stand, start)["outcome"])]


def test_the_equilibrium_stays_where_it_is(stand: Stand) -> None:
    record = record_of(stand, Start(0.0, 0.0, 0.0))
    assert record["outcome"] == OUTCOMES.index(Outcome.RETURNED)
    assert record["settling_time"] == 0.0
    assert record["axle_excursion"] < 1e-6
    assert record["pitch_excursion"] < 1e-6
    assert record["simulated_time"] == pytest.approx(2.505)


def test_a_start_is_judged_by_where_it_ends(stand: Stand) -> None:
    assert outcome_of(stand, Start(0.0, math.radians(10.0), 0.0)) == Outcome.RETURNED
    assert outcome_of(stand, Start(0.0, math.radians(30.0), math.radians(200.0))) == Outcome.FELL
    pushed = record_of(stand, Start(0.4, 0.0, 0.0))
    assert pushed["outcome"] == OUTCOMES.index(Outcome.RETURNED)
    # The axle runs on before it turns round, and the robot is not back before it has.
    assert pushed["axle_excursion"] > 0.02
    assert 0.05 < pushed["settling_time"] < 2.25


def test_a_body_in_the_ground_has_fallen_before_anything_moves(stand: Stand) -> None:
    record = record_of(stand, Start(0.0, math.radians(120.0), 0.0))
    assert record["outcome"] == OUTCOMES.index(Outcome.FELL)
    assert record["simulated_time"] == 0.0


def test_want_of_grip_is_not_a_return_on_the_reduced_model(m4: Robot) -> None:
    """The same start with the same equilibrium: sliding is the ground's doing."""
    start = Start(0.0, math.radians(25.0), 0.0)
    found = {}
    for friction in (0.45, 0.8):
        job = small_job(m4, friction=friction, thrust=24.0)
        found[friction] = record_of(job.stand, start)
        assert bool(job.succeeded(np.array(list(found[friction].values())))) == (friction == 0.8)
    assert found[0.45]["slip_time"] > found[0.8]["slip_time"]


@pytest.mark.parametrize("yaw", [0.0, 0.01])
def test_the_full_model_starts_with_the_motion_asked_for_and_rolls(full_stand: Stand, yaw: float) -> None:
    start = Start(0.35, math.radians(-7.0), 1.2, yaw)
    climb = prepare_start(full_stand, start)
    state = climb.loop.estimator.state
    radius = climb.reduction.parameters.wheel_radius
    wanted = [0.0, climb.trim.pitch + start.pitch_error, start.wheel_speed / radius, start.pitch_rate]
    # Pitch is about the axle; turned by the heading on the slope, upright in the world differs by its square.
    np.testing.assert_allclose(state, wanted, atol=1e-9 + yaw**2)
    assert climb.loop.estimator.heading == pytest.approx(yaw)
    assert climb.plant.time == 0.0
    # The wheels roll: after one time step the contact points have slid by next to nothing.
    climb.plant.stepper.step()
    assert climb.plant.stepper.statistics[:, kernels.SLIP_DISTANCE].max() < 2e-5


def test_full_and_reduced_model_agree_near_the_equilibrium(full_stand: Stand) -> None:
    record = record_of(full_stand, Start(0.1, math.radians(4.0), math.radians(-15.0), 0.005))
    assert record["outcome"] == record["outcome_reduced"] == OUTCOMES.index(Outcome.RETURNED)
    alone = record_of(
        dataclasses.replace(full_stand, plant="mip"),
        Start(0.1, math.radians(4.0), math.radians(-15.0)),
    )
    assert record["pitch_excursion"] == pytest.approx(alone["pitch_excursion"], rel=0.1)
    assert record["axle_excursion"] == pytest.approx(alone["axle_excursion"], rel=0.1)
    assert record["settling_time"] == pytest.approx(alone["settling_time"], abs=0.1)
    assert record["air_time"] == 0.0


def test_headings_depend_on_seed_and_place_alone(m4: Robot) -> None:
    job = small_job(m4, plant="full", starts=2)
    assert job.start((0, 1, 2, 0)) == small_job(m4, plant="full", starts=2).start((0, 1, 2, 0))
    drawn = {job.start((0, 1, 2, 0)).yaw_error, job.start((0, 1, 2, 1)).yaw_error, job.start((0, 2, 2, 0)).yaw_error}
    assert len(drawn | {small_job(m4, plant="full", seed=1).start((0, 1, 2, 0)).yaw_error}) == 4
    assert max(abs(yaw) for yaw in drawn) <= math.radians(0.5)
    assert small_job(m4).start((0, 1, 2, 0)).yaw_error == 0.0


def test_the_map_is_the_same_whatever_computes_it_and_resumes(m4: Robot, tmp_path: Path) -> None:
    job = small_job(m4, speeds=(-0.4, 0.4))
    here = run_job(job, tmp_path / "here.zarr", workers=0)
    for place in ((0, 1, 1, 0), (1, 4, 4, 0), (1, 2, 2, 0)):
        here.records[place] = np.nan
    told: list[float] = []
    run_job(job, tmp_path / "here.zarr", resume=True, workers=0, on_progress=lambda done, _: told.append(done))
    assert told == [47, 48, 49, 50]
    there = run_job(job, tmp_path / "there.zarr", workers=2)
    np.testing.assert_array_equal(here.read()[..., 0], there.read()[..., 0])
    dataset = attraction_dataset(here, job, command="m4 map attraction")
    assert dataset.attrs["sha256_toml"] == m4.file_hashes["toml"]
    assert dataset.attrs["command"] == "m4 map attraction"
    np.testing.assert_array_equal(dataset["returns"], (dataset["outcome"] == 0).all("start"))
    assert all("units" in variable.attrs for variable in dataset.variables.values())
    # Rolling uphill the robot falls uphill less easily: the axle runs under it.
    gained = dataset["returns"].isel(wheel_speed=1).astype(int) - dataset["returns"].isel(wheel_speed=0).astype(int)
    assert int(gained.isel(pitch_error=slice(3, None), pitch_rate=slice(2, 3)).min()) >= 0


def test_stores_of_other_starts_and_other_kinds_are_refused(m4: Robot, tmp_path: Path) -> None:
    job, path = small_job(m4, n=1), tmp_path / "map.zarr"
    before = run_job(job, path, workers=0).read()
    with pytest.raises(ResultFileError, match="--force"):
        run_job(job, path, workers=0)
    with pytest.raises(ResultFileError, match=r"settings\.thrust is null there and 12\.0 here"):
        run_job(small_job(m4, n=1, thrust=12.0), path, resume=True, workers=0)
    climbs = make_job(m4, MapGrid(slope=0.1, thrust=8.0, friction=0.8), RolloutSettings(plant="mip"))
    with pytest.raises(ResultFileError, match="another kind of map: attraction, not closed-loop"):
        run_job(climbs, path, resume=True, workers=0)
    with pytest.raises(ResultFileError, match="another kind of map"):
        job_of_store(open_store(path), m4)
    np.testing.assert_array_equal(open_store(path).read(), before)


def test_reach_is_without_gaps(m4: Robot, tmp_path: Path) -> None:
    job = small_job(m4, n=5)
    dataset = attraction_dataset(run_job(job, tmp_path / "map.zarr", workers=0), job)
    returns = np.array(
        [[0, 0, 0, 0, 0], [0, 1, 1, 0, 0], [0, 1, 1, 1, 0], [0, 0, 1, 0, 0], [0, 0, 0, 0, 0]], dtype=bool
    )
    dataset["returns"][0] = returns
    found = reach(dataset, 0)
    np.testing.assert_allclose(np.degrees(found.pitch), [-20.0, 20.0])
    np.testing.assert_allclose(np.degrees(found.rate), [-100.0, 100.0])
    assert found.share == pytest.approx(6.0 / 25.0)
    assert found.bounded
    dataset["returns"][0, 4, 2] = True  # comes back again, beyond a gap or not
    assert math.degrees(reach(dataset, 0).pitch[1]) == pytest.approx(40.0)
    assert not reach(dataset, 0).bounded
    dataset["returns"][0, 3, 2] = False
    assert math.degrees(reach(dataset, 0).pitch[1]) == pytest.approx(0.0)
    dataset["returns"][0, 2, 2] = False
    assert np.isnan([*reach(dataset, 0).pitch, *reach(dataset, 0).rate]).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"plant": "toy"}, "plant"),
        ({"starts": 2}, "differ in heading alone"),
        ({"duration": math.nan}, "duration"),
        ({"duration": 0.1}, "0.5 to 600"),
        ({"yaw_error_max": -0.1}, "yaw_error_max"),
        ({"seed": -1}, "seed"),
        ({"slope": math.nan}, "slope"),
        ({"friction": 0.0}, "friction"),
    ],
)
def test_bad_settings_are_refused(m4: Robot, changes: dict, message: str) -> None:
    with pytest.raises(InvalidSettingError, match=message):
        small_job(m4, **changes)


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        (((), (0.0,), (0.0,)), "at least one"),
        (((0.0,), (0.1, 0.1), (0.0,)), "increasing"),
        (((0.0,), (math.nan,), (0.0,)), r"pitch_error \[deg\]"),
        (((0.0,), (0.0,), (200.0,)), r"pitch_rate \[deg/s\]"),
        (((50.0,), (0.0,), (0.0,)), r"wheel_speed \[m/s\]"),
    ],
)
def test_bad_axes_are_refused(axes: tuple, message: str) -> None:
    with pytest.raises(InvalidSettingError, match=message):
        AttractionGrid(*axes)


def test_without_an_equilibrium_there_is_no_region(m4: Robot) -> None:
    with pytest.raises(NoTrimExists):
        small_job(m4, slope=math.radians(80.0))
