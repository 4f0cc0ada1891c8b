"""The scene of a run that still goes on is the replay's at the same instant, and watching changes nothing."""

from __future__ import annotations

import numpy as np
import pytest
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from m4_dynamics.mission.loading import load_mission
from m4_dynamics.mission.runner import run_mission
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.recorder import Recorder
from m4_dynamics.view.arrows import round_scale
from m4_dynamics.view.frames import sample_frames
from m4_dynamics.view.growing_trail import GrowingTrail
from m4_dynamics.view.live_scene import LiveScene
from m4_dynamics.view.overlays import overlays_of
from m4_dynamics.view.scene import placing_commands, scene_motions
from m4_dynamics.view.three import Command

EVERY = 0.5  # [s] between the instants compared
RATE = 1.0 / EVERY

Matrices = dict[str, NDArray[np.float64]]


def placed(commands: list[Command]) -> Matrices:
    """Node -> where it is put in its parent."""
    return {one["path"]: np.array(one["matrix"]).reshape(4, 4).T for one in commands if one["type"] == "set_transform"}


@pytest.fixture(scope="module")
def watched(robot: Robot) -> tuple[xarray.Dataset, list[tuple[str, Matrices]]]:
    """A mission with a scene beside it: its trajectory, and name of the phase and scene at regular instants."""
    scenes: list[LiveScene] = []
    seen: list[tuple[str, Matrices]] = []

    def watch(recorder: Recorder) -> None:
        if not scenes:
            scenes.append(LiveScene(robot, recorder))
        row = recorder.count - 1
        if row % round(EVERY / recorder.plant.control_period) == 0:
            seen.append((recorder.phase_name, placed(scenes[0].frame())))

    return run_mission(robot, load_mission("wair15"), observer=watch).dataset, seen


def test_a_mission_is_the_same_whether_somebody_watches_or_not(
    robot: Robot, watched: tuple[xarray.Dataset, list[tuple[str, Matrices]]]
) -> None:
    alone = run_mission(robot, load_mission("wair15")).dataset
    for name in set(alone.data_vars) - {"control_time"}:
        # The optimiser repeats to rounding, whether somebody watches or not.
        np.testing.assert_allclose(watched[0][name].values, alone[name].values, atol=1e-6, err_msg=str(name))


def test_every_node_is_where_the_replay_has_it(
    robot: Robot, watched: tuple[xarray.Dataset, list[tuple[str, Matrices]]]
) -> None:
    dataset, seen = watched
    frames = sample_frames(dataset, robot, frames_per_second=RATE)
    scale = round_scale([np.array([[0.0, 0.0, robot.mass * robot.gravity]])])
    motions = scene_motions(robot, frames, overlays_of(dataset, robot, frames), metres_per_newton=scale)
    motions = [one for one in motions if not one.path.startswith("/trail")]
    phases = [str(name) for name in dataset.attrs["phases"]]
    standing = 0
    for index, (phase, live) in enumerate(seen):
        assert phase == phases[int(dataset["phase"].sel(time=frames.time[index], method="nearest"))]
        for path, matrix in placed(placing_commands(motions, index)).items():
            if np.abs(matrix[:3, :3]).max() > 1e-4:  # else it is hidden, and where does not matter
                np.testing.assert_allclose(live[path], matrix, atol=1e-6, err_msg=f"{path} at {frames.time[index]} s")
                standing += path.startswith(("/reduced", "/ghost"))
            else:
                assert np.abs(live[path][:3, :3]).max() <= 1e-4, path
    assert len(seen) > 60
    assert standing > 200  # the pendulum and the reference were among what was compared


def test_the_trail_ends_at_the_centre_of_mass(watched: tuple[xarray.Dataset, list[tuple[str, Matrices]]]) -> None:
    dataset, seen = watched
    pieces = [seen[-1][1][path] for path in seen[-1][1] if path.startswith("/trail/")]
    ends = np.array([piece[:3, 3] + piece[:3, 2] for piece in pieces])
    last = dataset["com_in_world"].sel(time=EVERY * (len(seen) - 1), method="nearest").values
    assert np.linalg.norm(ends - last, axis=1).min() < 1e-9
    # Each piece goes on where another one ended.
    gaps = [np.linalg.norm(ends - piece[:3, 3], axis=1).min() for piece in pieces[1:]]
    assert max(gaps) < 1e-9


@settings(max_examples=30, deadline=None)
@given(
    angles=st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=60),
    step=st.floats(1e-3, 0.05),
)
def test_a_trail_passes_all_points_and_takes_its_oldest_piece_again(angles: list[float], step: float) -> None:
    heading = np.cumsum(angles)
    points = np.cumsum(step * np.column_stack([np.cos(heading), np.zeros(len(heading)), np.sin(heading)]), axis=0)
    whole, short = GrowingTrail("/trail", pieces=200, tolerance=0.004), GrowingTrail("/trail", pieces=3)
    for point in points:
        whole.extend(point)
        short.extend(point)
    pieces = np.array(list(placed(whole.placing_commands()).values()))
    starts, steps = pieces[:, :3, 3], pieces[:, :3, 2]
    lengths = np.maximum((steps * steps).sum(axis=1), 1e-12)
    share = np.clip(((points[:, None] - starts) * steps).sum(axis=2) / lengths, 0.0, 1.0)
    away = np.linalg.norm(points[:, None] - starts - share[..., None] * steps, axis=2).min(axis=1)
    assert away.max() <= 0.004 + 1e-4
    few = placed(short.placing_commands())
    assert len(few) <= 3
    assert min(np.linalg.norm(piece[:3, 3] + piece[:3, 2] - points[-1]) for piece in few.values()) < 1e-4
