"""`m4 map closed-loop` from the outside."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from m4_dynamics.cli.main import main
from m4_dynamics.feasibility.files import load_map

SMALL = ("--slope", "10:50:3", "--thrust", "4,16,40", "--plant", "mip", "--workers", "0")


def test_map_is_written_and_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "closed-loop", *SMALL, "--out", str(tmp_path), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["rollouts"] == 9
    assert said["verdicts"]["climbed"] >= 4
    assert said["verdicts"]["infeasible"] == 3
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "map.html").read_text()
    assert "Plotly.newPlot" in page
    assert "cdn" not in page.split("<body>")[0].lower()
    dataset = load_map(tmp_path)
    assert dataset.attrs["plant"] == "mip"
    assert len(dataset.attrs["sha256_toml"]) == 64
    assert all("units" in variable.attrs for variable in dataset.data_vars.values())

    assert main(["map", "closed-loop", *SMALL, "--out", str(tmp_path)]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["map", "closed-loop", *SMALL, "--out", str(tmp_path), "--resume"]) == 0
    assert "Agreement" in capsys.readouterr().out
    assert main(["map", "closed-loop", *SMALL, "--out", str(tmp_path), "--resume", "--seed", "5"]) == 2
    assert "settings.seed is 0 there and 5 here" in capsys.readouterr().err
    assert (load_map(tmp_path)["elapsed"] == dataset["elapsed"]).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--workers", "-1"], "workers"),
        (["--duration", "1"], "two ramps"),
        (["--duration", "nan"], "duration"),
        (["--starts", "0"], "starts"),
        (["--slope", "45:40:3"], "increasing"),
        (["--resume", "--force"], "one of them"),
    ],
)
def test_bad_options_say_what_would_be_valid(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    assert main(["map", "closed-loop", "--plant", "mip", "--out", str(tmp_path), *options]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error


def test_from_a_cell_to_its_replay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "closed-loop", *SMALL, "--seed", "3", "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    assert main(["map", "replay", str(tmp_path), "--slope", "31", "--thrust", "15"]) == 0
    assert "cell at 30 deg, 16 N" in capsys.readouterr().out
    folder = tmp_path / "cell-30-16-0.8-0"
    assert (folder / "viewer.html").stat().st_size > 100_000
    summary = json.loads((folder / "summary.json").read_text())
    dataset = load_map(tmp_path).sel(thrust=16.0).isel(slope=1, friction=0, start=0)
    assert summary["slope_deg"] == pytest.approx(30.0)
    assert math.radians(summary["pitch_error_deg"]) == pytest.approx(float(dataset["pitch_error"]))
    assert summary["verdict"] == "climbed"

    assert main(["map", "replay", str(tmp_path), "--slope", "30", "--thrust", "40"]) == 2
    assert "nothing to replay" in capsys.readouterr().err
    assert main(["map", "replay", str(tmp_path), "--slope", "85", "--thrust", "16"]) == 2
    assert "on the map, 10 to 50" in capsys.readouterr().err
    assert main(["map", "replay", str(tmp_path / "nowhere"), "--slope", "30", "--thrust", "16"]) == 2
    assert "there is no store" in capsys.readouterr().err


def test_an_unknown_option_is_refused_by_the_kind_of_map_that_got_it(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["map", "closed-loop", "--thrusts", "9"])
    assert stopped.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith("usage: m4 map closed-loop")
    assert "unrecognized arguments: --thrusts" in error
