"""Composites and strips show true poses at the instants that they name."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import xarray
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.patches import FancyArrowPatch

from m4_dynamics.errors import InvalidSettingError, ResultFileError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.instants import climbing_instants, transformation_instants, way_instants
from m4_dynamics.view.mission_picture import draw_mission, write_mission_picture
from m4_dynamics.view.render.picture import Frame
from m4_dynamics.view.render.stage import METRES_PER_NEWTON, Pose, Stage
from m4_dynamics.view.strips import (
    draw_climb_strip,
    draw_transformation_strip,
    write_climb_strip,
    write_transformation_strip,
)


@pytest.fixture(scope="module")
def composite(mission_run: xarray.Dataset, robot: Robot) -> Figure:
    return draw_mission(mission_run, robot, along=4)


def test_places_along_the_way_are_evenly_spaced(mission_run: xarray.Dataset) -> None:
    instants = way_instants(mission_run, along=5)
    assert [instant.phase for instant in instants[:4]] == ["settle", "settle", "settle", "raise"]
    assert all(instant.on_the_spot for instant in instants[:4])
    way = instants[4:]
    travel = mission_run.travel.values[[instant.sample for instant in way]]
    np.testing.assert_allclose(np.diff(travel), np.ptp(travel) / 4.0, atol=5e-3)
    assert way[0].phase == "approach (PID)"
    assert way[-1].phase == "climb (MPC)"
    assert travel[-1] == pytest.approx(0.7, abs=0.02)
    pitch = np.rad2deg(mission_run.state.values[[instants[3].sample, way[0].sample], 1])
    assert pitch[0] == pytest.approx(-50.0, abs=6.0)  # half way up
    assert pitch[1] == pytest.approx(-10.0, abs=3.0)


def test_transformation_is_told_in_order(mission_run: xarray.Dataset) -> None:
    instants = transformation_instants(mission_run)
    assert [instant.phase for instant in instants] == [
        "settle", "settle", "raise", "raise", "raise", "approach (PID)", "sit", "sit"
    ]  # fmt: skip
    assert np.all(np.diff([instant.sample for instant in instants]) > 0)
    pitch = mission_run.state.values[[instant.sample for instant in instants], 1]
    assert np.all(np.diff(pitch[1:6]) > 0.0)  # it rises
    assert np.all(np.diff(pitch[5:]) < 0.0)  # and sits down


def test_the_climb_starts_at_the_foot(mission_run: xarray.Dataset) -> None:
    instants = climbing_instants(mission_run, along=3)
    travel = mission_run.travel.values[[instant.sample for instant in instants]]
    np.testing.assert_allclose(travel, [0.0, 0.35, 0.7], atol=0.02)


def test_runs_without_such_phases_are_named(climb: xarray.Dataset, mission_run: xarray.Dataset) -> None:
    with pytest.raises(ResultFileError, match="changes its shape"):
        transformation_instants(climb)
    with pytest.raises(ResultFileError, match="travel or slope"):
        way_instants(climb, along=3)
    lying = mission_run.isel(time=mission_run.phase.values < 2)
    with pytest.raises(ResultFileError, match="never balanced"):
        way_instants(lying, along=3)
    with pytest.raises(ResultFileError, match="never climbed"):
        climbing_instants(mission_run.isel(time=mission_run.phase.values < 3), along=3)


def test_composite_names_every_instant(composite: Figure, mission_run: xarray.Dataset) -> None:
    words = [text.get_text() for text in composite.axes[0].texts]
    instants = way_instants(mission_run, along=4)
    times = [word.split(" s")[0] for word in words if re.match(r"[\d.]+ s", word)]
    assert times == [f"{instant.time:.1f}" for instant in instants]
    for phase in ("settle", "raise", "approach (PID)", "climb (MPC)"):
        assert sum(word.endswith(phase) for word in words) == 1
    assert "on the spot, drawn side by side" in words


def test_poses_on_the_spot_stand_side_by_side(composite: Figure, mission_run: xarray.Dataset, robot: Robot) -> None:
    stage = Stage(mission_run, robot)
    instants = way_instants(mission_run, along=4)
    balls = [line.get_xydata()[0] for line in composite.axes[0].lines if line.get_marker() == "o"]
    assert len(balls) == len(instants)
    for instant, ball in zip(instants, balls, strict=True):
        com = mission_run.com_in_world.values[instant.sample]
        shift = (ball - stage.camera.project(com))[0] / stage.camera.axes[0, 0]
        assert shift < -0.5 if instant.on_the_spot else shift == pytest.approx(0.0, abs=1e-6)
        # A shift along x moves the picture along the projected x axis alone.
        np.testing.assert_allclose(stage.camera.project(com + np.array([shift, 0.0, 0.0])), ball, atol=1e-6)
    assert np.all(np.diff([ball[0] for ball in balls]) > 0.3)


def test_arrows_are_the_forces(mission_run: xarray.Dataset, robot: Robot) -> None:
    stage = Stage(mission_run, robot)
    axes = Figure().subplots()
    sample = way_instants(mission_run, along=4)[-1].sample
    ground = stage.ground(-0.5, 1.5)
    stage.draw(axes, [Pose(sample)], Frame(-0.5, 1.5, -0.5, 1.8), ground, resolution=30)
    arrows = [
        np.subtract(arrow._posA_posB[1], arrow._posA_posB[0])
        for arrow in axes.patches
        if isinstance(arrow, FancyArrowPatch)
    ]
    now = mission_run.isel(time=sample)
    expected = [
        METRES_PER_NEWTON * stage.camera.project(now.contact_force_in_world.sel(wheel=joint).values)
        for joint in ("rear_left_wheel", "rear_right_wheel")
    ]
    assert len(arrows) >= 2
    np.testing.assert_allclose(arrows[:2], expected, atol=1e-6)
    assert stage.thrust(sample) == pytest.approx(float(now.thrust.sum()))


def test_level_ground_goes_on_before_the_terrain_begins(mission_run: xarray.Dataset, robot: Robot) -> None:
    profile = Stage(mission_run, robot).ground(-30.0, 1.0).profile
    np.testing.assert_allclose(profile[0], [-30.0, 0.0])
    np.testing.assert_allclose(profile[-1], [1.0, np.tan(np.deg2rad(20.0))])


def test_strips_number_their_pictures(mission_run: xarray.Dataset, robot: Robot) -> None:
    for figure, instants in (
        (draw_transformation_strip(mission_run, robot), transformation_instants(mission_run)),
        (draw_climb_strip(mission_run, robot, pictures=3), climbing_instants(mission_run, along=3)),
    ):
        assert len(figure.axes) == len(instants)
        for order, (axes, instant) in enumerate(zip(figure.axes, instants, strict=True)):
            number, words, *thrust = [text.get_text() for text in axes.texts]
            assert number == str(order + 1)
            assert words == f"{instant.time:.1f} s   {instant.phase}"
            total = float(mission_run.thrust.isel(time=instant.sample).sum())
            assert thrust == ([f"{total:.1f} N"] if total > 0.05 else [])


@pytest.mark.parametrize("write", [write_mission_picture, write_transformation_strip, write_climb_strip])
def test_picture_is_written_and_not_blank(write, mission_run: xarray.Dataset, robot: Robot, tmp_path: Path) -> None:
    path = write(mission_run, robot, tmp_path / "picture.png")
    assert [file.name for file in tmp_path.iterdir()] == ["picture.png"]
    image = imread(path)
    assert len(np.unique(image.reshape(-1, image.shape[2]), axis=0)) > 2000
    assert path.stat().st_size < 2e6


def test_numbers_of_poses_are_checked(mission_run: xarray.Dataset, robot: Robot) -> None:
    with pytest.raises(InvalidSettingError, match="along"):
        draw_mission(mission_run, robot, along=1)
    with pytest.raises(InvalidSettingError, match="pictures"):
        draw_climb_strip(mission_run, robot, pictures=50)
