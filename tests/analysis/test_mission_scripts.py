"""Each script runs on a finished run, writes pictures that are not blank and prints what they show."""

from __future__ import annotations

import re
import runpy
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from m4_dynamics.simulation.climb import ClimbSettings, run_climb
from m4_dynamics.simulation.trajectory import save_trajectory

ANALYSIS = Path(__file__).parents[2] / "analysis"
SCOOTER = Path(__file__).parents[1] / "data" / "scooter" / "scooter.toml"
SCRIPTS = {
    "mission_states": ["mission_states.png"],
    "mission_constraints": ["mission_constraints.png"],
    "mission_composite": ["mission_composite.png"],
    "experiment_strips": ["m4_experiment.png", "wair_experiment.png"],
}

Run = Callable[..., str]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs a script as its users do; returns what it printed."""

    def run_script(name: str, *arguments: object) -> str:
        script = ANALYSIS / f"{name}.py"
        monkeypatch.setattr(sys, "argv", [str(script), *map(str, arguments)])
        runpy.run_path(str(script), run_name="__main__")
        return capsys.readouterr().out

    return run_script


def assert_pictures(folder: Path, names: list[str]) -> None:
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)
    for name in names:
        image = imread(folder / name)
        assert len(np.unique(image.reshape(-1, image.shape[2]), axis=0)) > 100


@pytest.mark.parametrize("name", SCRIPTS)
def test_script_draws_a_finished_run(name: str, run: Run, mission_folder: Path, tmp_path: Path) -> None:
    out = run(name, mission_folder, "--out", tmp_path / "pictures")
    assert_pictures(tmp_path / "pictures", SCRIPTS[name])
    assert [Path(line.split()[1]).name for line in out.splitlines() if line.startswith("wrote")] == SCRIPTS[name]


def test_constraints_are_printed(run: Run, mission_folder: Path, tmp_path: Path) -> None:
    out = run("mission_constraints", mission_folder, "--out", tmp_path)
    shares = [float(share) for share in re.findall(r"([\d.]+) % of the weight", out)]
    assert len(shares) == 2
    assert max(shares) < 3.0


def test_without_a_run_the_mission_is_run(run: Run, tmp_path: Path) -> None:
    out = run("mission_states", "--mission", "uprighting", "--out", tmp_path)
    assert out.startswith("mission uprighting: completed")
    assert_pictures(tmp_path, ["mission_states.png"])


def test_scripts_draw_another_robots_climb(run: Run, tmp_path: Path) -> None:
    from m4_dynamics.robot.loading import load_robot

    result = run_climb(load_robot(SCOOTER), ClimbSettings(slope=np.deg2rad(10.0), duration=6.0))
    assert result.dataset is not None
    folder = tmp_path / "run"
    folder.mkdir()
    save_trajectory(result.dataset, folder / "trajectory.nc")
    for name in SCRIPTS:
        run(name, folder, "--robot", SCOOTER, "--out", tmp_path / "pictures")
    # It has no phases in which it changes its shape, and no body but its wheels.
    names = {picture for pictures in SCRIPTS.values() for picture in pictures} - {"m4_experiment.png"}
    assert_pictures(tmp_path / "pictures", sorted(names))


def test_a_missing_run_is_named(run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        run("mission_composite", tmp_path / "nowhere")
    assert ended.value.code == 2
    assert "no trajectory" in capsys.readouterr().err


def test_rover_and_climb_are_compared(run: Run, tmp_path: Path) -> None:
    out = run("rover_cannot_climb", "--slopes", 45, "--frictions", 0.8, "--speeds", 0.3, "--out", tmp_path)
    (row,) = [line.split() for line in out.splitlines() if line.strip().startswith("45")]
    assert row[3] == "slipped"
    assert row[6:9] == ["38.7", "46.6", "climbed"]
    assert_pictures(tmp_path, ["rover_cannot_climb.png"])
