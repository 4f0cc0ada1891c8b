"""The replay page holds the robot's true motion, asks nothing of the network and stays small."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import umsgpack
import xarray

from m4_dynamics.errors import InvalidSettingError, NonFiniteError, ResultFileError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.arrows import round_scale
from m4_dynamics.view.phases import phases_of
from m4_dynamics.view.replay import replay_html, write_replay_html

Tracks = dict[str, dict[str, tuple[np.ndarray, np.ndarray]]]


def embedded(page: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The page's data and its unpacked commands."""
    data = json.loads(re.search(r'<script id="replay" type="application/json">(.*?)</script>', page, re.S).group(1))
    parts = [base64.b64decode(part) for part in data["parts"]]
    return data, [umsgpack.unpackb(b"".join(parts[part] for part in command)) for command in data["commands"]]


def tracks_of(commands: list[dict[str, Any]]) -> tuple[Tracks, float]:
    """Node -> track -> (times, values) at every instant as the viewer interpolates, and the last time."""
    (animation,) = [command for command in commands if command["type"] == "set_animation"]
    tracks: Tracks = {}
    keys = [track["times"].data for clip in animation["animations"] for track in clip["clip"]["tracks"]]
    instants = np.frombuffer(max(keys, key=len), dtype="<f4") / animation["animations"][0]["clip"]["fps"]
    for clip in animation["animations"]:
        for track in clip["clip"]["tracks"]:
            times = np.frombuffer(track["times"].data, dtype="<f4") / clip["clip"]["fps"]
            values = np.frombuffer(track["values"].data, dtype="<f4").reshape(len(times), -1)
            at_instants = np.column_stack([np.interp(instants, times, column) for column in values.T])
            tracks.setdefault(clip["path"], {})[track["name"].lstrip(".")] = (instants, at_instants)
    return tracks, float(instants[-1])


@pytest.fixture(scope="module")
def page(climb: xarray.Dataset, robot: Robot) -> str:
    return replay_html(climb, robot)


@pytest.fixture(scope="module")
def commands(page: str) -> list[dict[str, Any]]:
    return embedded(page)[1]


def test_every_joint_moves_as_forward_kinematics_says(commands, climb: xarray.Dataset, robot: Robot) -> None:
    tracks, end = tracks_of(commands)
    assert end == pytest.approx(4.0, abs=1e-6)
    data = robot.model.createData()
    for time in (0.0, 1.0, 2.5, 4.0):  # instants that are both samples and frames
        configuration = climb.configuration.sel(time=time, method="nearest").values
        pin.forwardKinematics(robot.model, data, configuration)
        for joint in range(1, robot.model.njoints):
            node = tracks[f"/robot/{robot.model.names[joint]}"]
            times, positions = node["position"]
            frame = int(np.argmin(np.abs(times - time)))
            assert times[frame] == pytest.approx(time, abs=1e-6)
            np.testing.assert_allclose(positions[frame], data.oMi[joint].translation, atol=1e-6)
            x, y, z, w = node["quaternion"][1][frame].astype(float)
            rotation = pin.Quaternion(w, x, y, z).toRotationMatrix()
            np.testing.assert_allclose(rotation, data.oMi[joint].rotation, atol=1e-6)


def test_between_samples_the_motion_is_interpolated_on_its_manifold(make_climb, robot: Robot) -> None:
    coarse = make_climb(2.0, rate=20.0)
    tracks, _ = tracks_of(embedded(replay_html(coarse, robot, frames_per_second=40.0))[1])
    between = pin.interpolate(robot.model, coarse.configuration.values[10], coarse.configuration.values[11], 0.5)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, between)
    for joint in range(1, robot.model.njoints):
        position = tracks[f"/robot/{robot.model.names[joint]}"]["position"][1][21]
        np.testing.assert_allclose(position, data.oMi[joint].translation, atol=1e-6)


def test_every_geometry_stands_in_its_joint(commands, robot: Robot) -> None:
    transforms = {one["path"]: np.array(one["matrix"]).reshape(4, 4).T for one in commands if "matrix" in one}
    objects = {one["path"] for one in commands if one["type"] == "set_object"}
    for geometry in robot.visual_model.geometryObjects:
        path = f"/robot/{robot.model.names[geometry.parentJoint]}/{geometry.name}"
        assert path in objects
        np.testing.assert_allclose(transforms[path], geometry.placement.homogeneous, atol=1e-6)


def test_before_it_plays_everything_stands_where_it_starts(commands, climb: xarray.Dataset, robot: Robot) -> None:
    transforms = {one["path"]: np.array(one["matrix"]).reshape(4, 4).T for one in commands if "matrix" in one}
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, climb.configuration.values[0])
    for joint in range(1, robot.model.njoints):
        expected = data.oMi[joint].homogeneous
        np.testing.assert_allclose(transforms[f"/robot/{robot.model.names[joint]}"], expected, atol=1e-6)


def test_all_clips_end_together(commands) -> None:
    # Clips of different length would run out of step when the animation starts over.
    (animation,) = [command for command in commands if command["type"] == "set_animation"]
    tracks = [track for clip in animation["animations"] for track in clip["clip"]["tracks"]]
    ends = {float(np.frombuffer(track["times"].data, dtype="<f4")[-1]) for track in tracks}
    assert len(ends) == 1


def arrow_at(tracks: Tracks, path: str, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Foot and tip of an arrow as the viewer will draw it; the head's cone is 0.07 m long before scaling."""
    foot = tracks[path]["position"][1][frame].astype(float)
    x, y, z, w = tracks[path]["quaternion"][1][frame].astype(float)
    size = tracks[path]["scale"][1][frame].astype(float)
    assert np.ptp(size) == 0.0
    shaft = float(tracks[f"{path}/shaft"]["scale"][1][frame, 2])
    assert tracks[f"{path}/head"]["position"][1][frame, 2] == pytest.approx(shaft)
    return foot, foot + pin.Quaternion(w, x, y, z).toRotationMatrix()[:, 2] * size[0] * (shaft + 0.07)


def test_arrows_are_the_forces(commands, page: str, climb: xarray.Dataset, robot: Robot) -> None:
    tracks, _ = tracks_of(commands)
    centimetres = float(re.search(r"10 N: ([\d.]+) cm", embedded(page)[0]["scale"]).group(1))
    metres_per_newton = centimetres / 1000.0
    sample = climb.sel(time=1.0, method="nearest")
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, sample.configuration.values)
    for joint in robot.balance.drive_wheels:
        foot, tip = arrow_at(tracks, f"/contact/{joint}", 30)
        np.testing.assert_allclose(foot, sample.contact_position_in_world.sel(wheel=joint), atol=1e-5)
        np.testing.assert_allclose(
            tip - foot, metres_per_newton * sample.contact_force_in_world.sel(wheel=joint), atol=1e-4
        )
    for frame in robot.balance.thrusters:
        foot, tip = arrow_at(tracks, f"/thrust/{frame}", 30)
        np.testing.assert_allclose(foot, data.oMf[robot.thruster(frame).frame_id].translation, atol=1e-5)
        assert np.linalg.norm(tip - foot) == pytest.approx(
            metres_per_newton * float(sample.thrust.sel(thruster=frame)), rel=1e-4
        )
        assert (tip - foot)[0] > 0.0  # uphill


def test_idle_arrows_shrink_to_nothing(commands, robot: Robot) -> None:
    tracks, _ = tracks_of(commands)
    idle = [f"/thrust/{one.frame}" for one in robot.thrusters if one.frame not in robot.balance.thrusters]
    idle += [f"/contact/{one.joint}" for one in robot.wheels if one.joint not in robot.balance.drive_wheels]
    assert len(idle) == 4
    for path in idle:
        assert tracks[path]["scale"][1].max() < 1e-4
        assert np.isfinite(tracks[path]["position"][1]).all()


def test_only_tracks_that_play_are_used(commands) -> None:
    tracks, _ = tracks_of(commands)
    assert {name for node in tracks.values() for name in node} <= {"position", "quaternion", "scale"}


def test_page_is_small_and_asks_nothing_of_the_network(make_climb, robot: Robot, tmp_path: Path) -> None:
    path = write_replay_html(make_climb(12.0), robot, tmp_path / "viewer.html")
    assert [file.name for file in tmp_path.iterdir()] == ["viewer.html"]
    assert path.stat().st_size < 3e6
    page = path.read_text(encoding="utf-8")
    assert not re.search(r'(?:src|href)\s*=\s*["\']?(?!data:)\w+:', page)
    assert "default-src 'none'" in page
    markup = page[: page.index("<script>")] + page[page.index('<script id="replay"') :]
    assert "http" not in re.sub(r"<!--.*?-->", "", markup, flags=re.S).replace("http-equiv", "")


def test_page_says_what_it_shows(page: str) -> None:
    data, _ = embedded(page)
    assert "<title>m4 on a 45° slope</title>" in page
    assert data["conditions"] == ["slope 45°", "friction μₛ 0.8", "controller default", "verdict: climbed"]
    assert [entry["text"] for entry in data["legend"]] == [
        "thrust on the robot",
        "ground on a wheel",
        "friction cone",
        "centre of mass",
        "its trail",
        "reduced model",
        "reference",
    ]
    assert len(data["times"]) == 121
    for readout in data["readouts"]:
        assert len(readout["values"]) == len(data["times"])


def test_readouts_are_the_trajectory(page: str, climb: xarray.Dataset) -> None:
    data, _ = embedded(page)
    values = {readout["label"]: readout["values"][60] for readout in data["readouts"]}
    sample = climb.sel(time=2.0, method="nearest")
    along, normal = sample.ground_force_simulated.values
    assert values["pitch"] == pytest.approx(np.rad2deg(sample.state.values[1]), abs=0.01)
    assert values["thrust"] == pytest.approx(float(sample.thrust.sum()), abs=0.01)
    assert values["friction use"] == pytest.approx(100 * abs(along) / (0.8 * normal), abs=0.1)


def test_a_mission_tells_its_phases(mission_run: xarray.Dataset, robot: Robot) -> None:
    page = replay_html(mission_run, robot)
    data, _ = embedded(page)
    assert "<title>m4: mission short</title>" in page
    assert data["conditions"] == ["slope 20°", "friction μₛ 0.8", "controller default, pid", "verdict: completed"]
    assert [(one["label"], one["start"], one["end"]) for one in data["phases"]] == [
        (phase.label, round(phase.start, 4), round(phase.end, 4)) for phase in phases_of(mission_run)
    ]
    assert embedded(replay_html(mission_run.drop_vars("phase"), robot))[0]["phases"] == []


def test_friction_is_read_out_only_while_it_balances(mission_run: xarray.Dataset, robot: Robot) -> None:
    data, _ = embedded(replay_html(mission_run, robot))
    readouts = {readout["label"]: readout["values"] for readout in data["readouts"]}
    _, raising, _, climbing, *_ = phases_of(mission_run)
    lying, driving = (round(30.0 * (phase.start + 2.0)) for phase in (raising, climbing))
    sample = mission_run.interp(time=driving / 30.0)
    along, normal = sample.ground_force_simulated.values
    assert readouts["friction use"][lying] is None
    assert readouts["with sideways"][lying] is None
    assert readouts["friction use"][driving] == pytest.approx(100.0 * abs(along) / (0.8 * normal), abs=0.1)
    assert readouts["with sideways"][driving] >= readouts["friction use"][driving]
    assert readouts["way from the foot"][driving] == pytest.approx(float(sample.travel), abs=1e-3)
    assert readouts["ground"][0] == 0.0


def test_a_long_mission_makes_a_small_page(mission_run: xarray.Dataset, robot: Robot, tmp_path: Path) -> None:
    """Under 5 MB for 30 s; the paper's manoeuvre of 55 s keeps within that too."""
    duration = float(mission_run.time[-1])
    half = mission_run.isel(time=slice(0, mission_run.sizes["time"] // 2))
    whole, part = (
        write_replay_html(run, robot, tmp_path / "viewer.html").stat().st_size for run in (mission_run, half)
    )
    per_second = (whole - part) / (0.5 * duration)
    assert 0.0 < per_second < 70e3
    assert whole + per_second * (55.0 - duration) < 5e6


def test_short_knocks_do_not_shrink_the_arrows() -> None:
    force = np.full((1000, 3), 20.0)
    usual = round_scale([force])
    force[500:504] *= 10.0
    assert round_scale([force]) == usual
    force[500:600] *= 10.0
    assert round_scale([force]) < usual


def test_names_cannot_break_the_page(climb: xarray.Dataset, robot: Robot) -> None:
    hostile = climb.copy()
    hostile.attrs = {**climb.attrs, "controller": "</script><b onload=alert(1)>"}
    page = replay_html(hostile, robot)
    assert page.count("</script>") == replay_html(climb, robot).count("</script>")
    assert embedded(page)[0]["conditions"][2].endswith("</script><b onload=alert(1)>")


def test_same_run_gives_the_same_page(page: str, climb: xarray.Dataset, robot: Robot) -> None:
    assert replay_html(climb, robot) == page


def test_no_server_is_started(climb: xarray.Dataset, robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    import socket
    import subprocess

    def forbidden(*arguments: object, **options: object) -> None:
        raise AssertionError("a page needs no process and no socket")

    monkeypatch.setattr(subprocess, "Popen", forbidden)
    monkeypatch.setattr(socket, "socket", forbidden)
    replay_html(climb, robot)


def test_what_cannot_be_shown_is_named(climb: xarray.Dataset, robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "viewer.html"
    with pytest.raises(ResultFileError, match="no variable thrust"):
        write_replay_html(climb.drop_vars("thrust"), robot, path)
    with pytest.raises(ResultFileError, match="another robot"):
        write_replay_html(climb.isel(coordinate=slice(0, 19)), robot, path)
    with pytest.raises(InvalidSettingError, match="frames_per_second"):
        write_replay_html(climb, robot, path, frames_per_second=0.0)
    broken = climb.copy(deep=True)
    broken["configuration"][7, 2] = np.nan
    with pytest.raises(NonFiniteError, match="configuration"):
        write_replay_html(broken, robot, path)
    assert list(tmp_path.iterdir()) == []
