"""Sweeps: the same map whatever computes it, and nothing lost or done twice when something dies."""

from __future__ import annotations

import errno
import math
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import distributed
import numpy as np
import pytest

from m4_dynamics.errors import InvalidSettingError, ResultFileError, SchedulerError
from m4_dynamics.feasibility.cell import FIELDS, VERDICTS, CellIndex, RolloutSettings, start_errors
from m4_dynamics.feasibility.closed_loop import closed_loop_dataset, job_of_store, make_job
from m4_dynamics.feasibility.disagreement import Effect, agreement
from m4_dynamics.feasibility.grid import MapGrid
from m4_dynamics.feasibility.rollout import RolloutJob, cell_settings, run_cell
from m4_dynamics.feasibility.run import run_job
from m4_dynamics.feasibility.store import open_store
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import run_climb

VERDICT, ELAPSED = list(FIELDS).index("verdict"), list(FIELDS).index("elapsed")
ROOT = Path(__file__).resolve().parents[2]


def small_job(robot: Robot, **changes) -> RolloutJob:
    grid = MapGrid(slope=np.radians([10.0, 30.0, 50.0]), thrust=[4.0, 16.0, 28.0, 40.0], friction=0.8)
    return make_job(robot, grid, RolloutSettings(**{"plant": "mip", **changes}))


class Progress(list[float]):
    """The numbers of rollouts done, as they are told."""

    def __call__(self, done: float, expected: float) -> None:
        assert done <= expected
        self.append(done)


@pytest.fixture(scope="module")
def alone(m4: Robot, tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """Records of the small job, computed in this process."""
    path = tmp_path_factory.mktemp("alone") / "map.zarr"
    return run_job(small_job(m4, starts=2), path, workers=0).read()


def test_robots_and_jobs_travel(m4: Robot) -> None:
    job = pickle.loads(pickle.dumps(small_job(m4)))
    assert job.robot.file_hashes == m4.file_hashes
    assert job.robot.posture("mip").name == "mip"
    index = CellIndex(0, 1, 1, 0)
    here, there = run_cell(small_job(m4), index), run_cell(job, index)
    np.testing.assert_array_equal(np.delete(here, ELAPSED), np.delete(there, ELAPSED))


def test_a_start_depends_on_seed_and_cell_alone() -> None:
    settings = RolloutSettings(seed=3, starts=2)
    index = CellIndex(0, 4, 7, 1)
    assert start_errors(settings, index) == start_errors(settings, index)
    others = [
        start_errors(RolloutSettings(seed=4), index),
        start_errors(settings, index._replace(start=0)),
        start_errors(settings, index._replace(slope=5)),
    ]
    assert len({start_errors(settings, index), *others}) == 4
    drawn = [start_errors(settings, CellIndex(0, i, j, 0)) for i in range(20) for j in range(20)]
    assert max(abs(one.pitch) for one in drawn) <= math.radians(5.0)
    assert {one.pitch > 0.0 for one in drawn} == {True, False}


def test_the_map_says_what_is_known(m4: Robot, alone: np.ndarray) -> None:
    words = [[VERDICTS[int(code)].value for code in row] for row in alone[0, :, :, 0, VERDICT]]
    assert words[0] == ["climbed", "climbed", "climbed", "infeasible"]
    assert words[1][1:] == ["climbed", "climbed", "infeasible"]
    assert words[2][0] in ("fell", "slipped")


def test_worker_processes_give_the_same_map_and_one_may_die(
    m4: Robot, alone: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A real scheduler with two worker processes on loopback, one of them killed while it works."""
    from distributed import Client, LocalCluster

    job = small_job(m4, starts=2)
    monkeypatch.setattr("m4_dynamics.feasibility.rollout.BATCHES", {"mip": 1, "full": 1})
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        killed = []

        def kill_one(done: float, expected: float) -> None:
            if done >= 4 and not killed:
                victim = next(iter(client.run(os.getpid).values()))
                os.kill(victim, signal.SIGKILL)
                killed.append(victim)

        store = run_job(job, tmp_path / "map.zarr", scheduler=cluster.scheduler_address, on_progress=kill_one)
        assert len(killed) == 1
    records = store.read()
    np.testing.assert_array_equal(records[..., VERDICT], alone[..., VERDICT])
    # The optimiser repeats to rounding only, and a fall magnifies rounding: figures are compared where it climbed.
    climbed = alone[..., VERDICT] == 0
    figures = [list(FIELDS).index(name) for name in ("climbed", "goal", "friction_used", "pitch_error", "pitch_rms")]
    np.testing.assert_allclose(records[climbed][:, figures], alone[climbed][:, figures], rtol=1e-6, atol=1e-6)


SCRIPT = """
import sys
from pathlib import Path
import numpy as np
from m4_dynamics.feasibility.cell import RolloutSettings
from m4_dynamics.feasibility.closed_loop import make_job
from m4_dynamics.feasibility.grid import MapGrid
from m4_dynamics.feasibility.run import run_job
from m4_dynamics.robot.loading import load_robot

grid = MapGrid(slope=np.radians([10.0, 30.0, 50.0]), thrust=[4.0, 16.0, 28.0, 40.0], friction=0.8)
job = make_job(load_robot(), grid, RolloutSettings(plant="mip", starts=2))
run_job(job, Path(sys.argv[1]), workers=0)
"""


def test_a_killed_run_resumes_without_doing_a_cell_twice(m4: Robot, alone: np.ndarray, tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    process = subprocess.Popen([sys.executable, "-c", SCRIPT, str(path)], cwd=ROOT)
    deadline = time.monotonic() + 60.0
    try:
        while time.monotonic() < deadline and process.poll() is None:
            if len(list(path.glob("records/c/0/*/*/*/*"))) >= 8:
                break
            time.sleep(0.005)
        assert process.poll() is None, "it was done before it could be killed"
    finally:
        process.kill()
        process.wait()
    before = open_store(path).read()
    done = ~np.isnan(before[..., VERDICT])
    assert 8 <= done.sum() < done.size
    job, computed = small_job(m4, starts=2), Progress()
    store = run_job(job, path, resume=True, workers=0, on_progress=computed)
    assert computed[0] == done.sum()
    after = store.read()
    # A record that was there has even the computing time that it had: it was not computed again.
    np.testing.assert_array_equal(after[done], before[done])
    np.testing.assert_array_equal(after[..., VERDICT], alone[..., VERDICT])
    assert store.missing() == []
    again = Progress()
    run_job(job, path, resume=True, workers=0, on_progress=again)
    assert again == [done.size]


def test_a_store_of_something_else_is_refused_and_kept(m4: Robot, scooter: Robot, tmp_path: Path) -> None:
    grid = MapGrid(slope=[0.1], thrust=[8.0], friction=0.8)
    job = make_job(m4, grid, RolloutSettings(plant="mip"))
    path = tmp_path / "map.zarr"
    before = run_job(job, path, workers=0).read()
    with pytest.raises(ResultFileError, match="--resume"):
        run_job(job, path, workers=0)
    other = make_job(m4, grid, RolloutSettings(plant="mip", seed=1))
    with pytest.raises(ResultFileError, match=r"settings\.seed is 0 there and 1 here"):
        run_job(other, path, resume=True, workers=0)
    finer = make_job(m4, MapGrid(slope=[0.1, 0.2], thrust=[8.0], friction=0.8), RolloutSettings(plant="mip"))
    with pytest.raises(ResultFileError, match=r"grid\.slope"):
        run_job(finer, path, resume=True, workers=0)
    with pytest.raises(ResultFileError, match=r"provenance\.robot"):
        job_of_store(open_store(path), scooter)
    np.testing.assert_array_equal(open_store(path).read(), before)
    assert job_of_store(open_store(path), m4).identity() == job.identity()
    replaced = run_job(other, path, force=True, workers=0)
    assert replaced.identity["settings"]["seed"] == 1
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "dear.txt").write_text("dear")
    with pytest.raises(ResultFileError, match="as the store of a sweep"):
        run_job(job, tmp_path / "letters", force=True, workers=0)
    assert (tmp_path / "letters" / "dear.txt").exists()


def test_a_full_disk_keeps_what_is_done(m4: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import zarr

    job, path = small_job(m4), tmp_path / "map.zarr"
    original, written = zarr.Array.__setitem__, []

    def fills_up(self, selection, value) -> None:
        if isinstance(selection, tuple) and len(selection) == 4:
            if len(written) == 3:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            written.append(selection)
        original(self, selection, value)

    monkeypatch.setattr(zarr.Array, "__setitem__", fills_up)
    with pytest.raises(ResultFileError, match=r"No space left.*--resume"):
        run_job(job, path, workers=0)
    monkeypatch.undo()
    assert (~np.isnan(open_store(path).read()[..., VERDICT])).sum() == 3
    assert run_job(job, path, resume=True, workers=0).missing() == []


def test_a_store_is_replaced_only_by_one_that_is_written_and_has_workers(
    m4: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import zarr

    grid = MapGrid(slope=[0.1], thrust=[8.0], friction=0.8)
    path = tmp_path / "map.zarr"
    before = run_job(make_job(m4, grid, RolloutSettings(plant="mip")), path, workers=0).read()
    other = make_job(m4, grid, RolloutSettings(plant="mip", seed=1))
    monkeypatch.setattr("m4_dynamics.feasibility.sweep._CONNECT_TIMEOUT", 0.5)
    with pytest.raises(SchedulerError):
        run_job(other, path, force=True, scheduler="tcp://127.0.0.1:9")
    np.testing.assert_array_equal(open_store(path).read(), before)

    def full(self, *_, **__) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(zarr.Group, "create_array", full)
        with pytest.raises(ResultFileError, match="No space left"):
            run_job(other, path, force=True, workers=0)
    np.testing.assert_array_equal(open_store(path).read(), before)
    assert run_job(other, path, force=True, workers=0).identity["settings"]["seed"] == 1
    assert [entry.name for entry in tmp_path.iterdir()] == ["map.zarr"]


def test_an_unreachable_scheduler_is_an_error_in_words(
    m4: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("m4_dynamics.feasibility.sweep._CONNECT_TIMEOUT", 0.5)
    with pytest.raises(SchedulerError, match=r"cannot reach the scheduler tcp://127\.0\.0\.1:9"):
        run_job(small_job(m4), tmp_path / "map.zarr", scheduler="tcp://127.0.0.1:9")
    with pytest.raises((InvalidSettingError, SchedulerError), match="scheduler"):
        run_job(small_job(m4), tmp_path / "other.zarr", scheduler="carrier-pigeon://coop")
    # No client that failed is left behind for others to find.
    with pytest.raises(ValueError, match="No clients found"):
        distributed.default_client()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"plant": "toy"}, "plant"),
        ({"starts": 0}, "starts"),
        ({"seed": -1}, "seed"),
        ({"duration": 2.0}, "two ramps"),
        ({"speed": math.inf}, "speed"),
        ({"pitch_error_max": -0.1}, "pitch_error_max"),
        ({"controller": "hope"}, "controller"),
    ],
)
def test_bad_settings_are_refused(changes: dict, message: str) -> None:
    with pytest.raises(InvalidSettingError, match=message):
        RolloutSettings(**changes)


@pytest.fixture(scope="module")
def full_job(m4: Robot) -> RolloutJob:
    grid = MapGrid(slope=np.radians([20.0, 45.0, 60.0]), thrust=[0.0, 8.0, 20.0], friction=0.8)
    return make_job(m4, grid, RolloutSettings())


def test_full_model_map_with_its_disagreements(full_job: RolloutJob, tmp_path: Path) -> None:
    store = run_job(full_job, tmp_path / "map.zarr", workers=0)
    dataset = closed_loop_dataset(store, full_job)
    climbs = dataset["climbs"].isel(friction=0)
    assert climbs.to_numpy()[:, 2].tolist() == [True, True, False]
    assert not climbs.to_numpy()[2].any()
    # On the thrusters' bound a controller cannot push less: the statics do not see that.
    effect = dataset["disagreement"].isel(friction=0).to_numpy()
    assert effect[0, 0] == Effect.THRUST_BOUND
    # At 45 deg and 8 N the ground's grip just suffices for rest; the plan yields into its margin and climbs.
    assert climbs.to_numpy()[1, 1]
    assert effect[1, 1] == Effect.NONE
    assert (effect == Effect.UNEXPLAINED).sum() == 0
    shares = agreement(dataset)
    assert shares.reduced == 1.0
    assert sum(shares.effects.values()) == round((1.0 - shares.agreeing) * shares.cells)


def test_a_cell_of_the_map_is_the_climb_that_it_says(full_job: RolloutJob) -> None:
    index = CellIndex(0, 1, 2, 0)
    ((_, record),) = full_job.run([index])
    result = run_climb(full_job.robot, cell_settings(full_job, index))
    named = dict(zip(FIELDS, record, strict=True))
    assert VERDICTS[int(named["verdict"])] == result.summary.verdict
    assert named["climbed"] == pytest.approx(result.summary.climbed_m, abs=1e-5)
    assert named["pitch_error"] == pytest.approx(math.radians(result.summary.pitch_error_deg))


def test_adaptive_map_on_rollouts(m4: Robot, tmp_path: Path) -> None:
    axes = {"slope": np.radians(np.linspace(0.0, 72.0, 9)), "thrust": np.linspace(2.0, 40.0, 9), "friction": 0.8}
    maps = {}
    for adaptive in (False, True):
        job = make_job(m4, MapGrid(**axes), RolloutSettings(plant="mip", adaptive=adaptive))
        store = run_job(job, tmp_path / f"{adaptive}.zarr", workers=0)
        maps[adaptive] = closed_loop_dataset(store, job)
        again = Progress()
        run_job(
            job,
            tmp_path / f"{adaptive}.zarr",
            resume=True,
            workers=0,
            on_progress=again,
        )
        assert set(again) == {float((maps[adaptive]["verdict"] >= 0).sum())}
    full, found = maps[False], maps[True]
    assert (found["verdict"] >= 0).sum() < (full["verdict"] >= 0).sum()
    np.testing.assert_array_equal(found["climbs"], full["climbs"])
    run = found["verdict"] >= 0
    assert (found["verdict"].where(run) == full["verdict"].where(run)).where(run, True).all()
    assert not ((found["disagreement"] > 0) & ~run.all("start")).any()
