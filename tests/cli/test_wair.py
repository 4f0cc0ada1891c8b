"""`m4 wair` from the command line: files, exit codes, sentences instead of tracebacks."""

from __future__ import annotations

import json

import pytest

from m4_dynamics.cli.main import main
from m4_dynamics.simulation.trajectory import load_trajectory

RESULTS = {"trajectory.nc", "summary.json", "states.png", "ground_forces.png", "viewer.html", "report.html"}


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wair") / "new" / "folder"
    assert main(["wair", "--slope", "45", "--out", str(folder)]) == 0
    return folder


def test_writes_every_result_and_nothing_else(run_folder):
    assert {path.name for path in run_folder.iterdir()} == RESULTS


def test_summary_and_trajectory_tell_the_same_story(run_folder):
    summary = json.loads((run_folder / "summary.json").read_text())
    dataset = load_trajectory(run_folder)
    assert summary["verdict"] == dataset.attrs["verdict"] == "climbed"
    assert summary["slope_deg"] == pytest.approx(45.0)
    assert summary["steady_cost"] == pytest.approx(float(dataset.tracking_cost.sel(time=slice(1.0 - 1e-9, None)).sum()))
    assert summary["provenance"]["command"].startswith("m4 wair --slope 45 ")
    assert set(summary["mpc_step_us"]) == {"median", "p99"}


def test_prints_the_table_in_full_when_piped(tmp_path, capsys):
    assert main(["wair", "--slope", "15", "--no-viewer", "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    for word in ("worst friction use", "least normal force", "wheel position RMS", "steady tracking cost", "fallbacks",
                 "real-time factor", "climbed"):  # fmt: skip
        assert word in out
    assert not (tmp_path / "viewer.html").exists()


def test_realistic_says_what_was_on(tmp_path, capsys):
    arguments = ["wair", "--slope", "15", "--realistic", "--seed", "2", "--no-viewer", "--out", str(tmp_path)]
    assert main(arguments) == 0
    out = capsys.readouterr().out
    for word in (
        "realistic plant",
        "rotor lag 0.15 s",
        "IMU noise",
        "battery at 100 %",
        "pitch estimate",
        "charge left",
    ):
        assert word in out
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert len(summary["fidelity"]) == 8
    assert summary["provenance"]["command"].endswith("--realistic --seed 2")
    assert load_trajectory(tmp_path).attrs["seed"] == 2


def test_json_is_the_summary(tmp_path, capsys):
    assert main(["wair", "--slope", "15", "--no-viewer", "--json", "--out", str(tmp_path)]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((tmp_path / "summary.json").read_text())


def test_a_slope_that_cannot_be_climbed_says_why(tmp_path, capsys):
    assert main(["wair", "--slope", "80", "--friction", "0.3", "--out", str(tmp_path)]) == 2
    captured = capsys.readouterr()
    assert "infeasible" in captured.err
    assert "friction" in captured.err
    assert captured.out.startswith("written: ")  # no table of dashes
    assert "Traceback" not in captured.err
    assert json.loads((tmp_path / "summary.json").read_text())["verdict"] == "infeasible"
    assert {path.name for path in tmp_path.iterdir()} == {"summary.json", "report.html"}


def test_the_papers_controller_shows_its_weakness(tmp_path, capsys):
    assert main(["wair", "--slope", "45", "--controller", "paper", "--no-viewer", "--out", str(tmp_path)]) == 1
    out = capsys.readouterr().out
    assert "wheel tracking is poor" in out
    assert "cost climbs" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--slope", "95"], "slope"),
        (["--slope", "nan"], "slope"),
        (["--slope", "30", "--friction", "-1"], "friction_static"),
        (["--slope", "30", "--thrust", "lots"], "--thrust"),
        (["--slope", "30", "--thrust", "-3"], "thrust"),
        (["--slope", "30", "--duration", "2"], "duration"),
        (["--slope", "30", "--speed", "nan"], "speed"),
        (["no_such_robot.toml", "--slope", "30"], "no_such_robot.toml"),
    ],
)
def test_bad_input_is_named_without_a_traceback(tmp_path, capsys, arguments, words):
    assert main(["wair", *arguments, "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("m4 wair: ")
    assert words in error


def test_an_unwritable_folder_fails_before_the_work(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["wair", "--slope", "30", "--out", str(tmp_path / "file" / "below")]) == 2
    assert "cannot make the folder" in capsys.readouterr().err
