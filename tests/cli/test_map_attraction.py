"""`m4 map attraction` from the outside."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from m4_dynamics.cli.main import main
from m4_dynamics.feasibility.files import load_map

SMALL = (
    *("--plant", "mip", "--workers", "0", "--duration", "2"),
    *("--pitch-range=-40:40:5", "--rate-range=-200:200:5", "--wheel-speed=-0.3,0.3"),
)


def test_region_is_written_and_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "attraction", "--slope", "30", *SMALL, "--out", str(tmp_path), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["rollouts"] == sum(said["outcomes"].values()) == 50
    assert said["outcomes"]["returned"] >= 10
    assert said["outcomes"]["fell"] >= 2
    assert [row["wheel_speed_m_s"] for row in said["regions"]] == [-0.3, 0.3]
    low, high = said["regions"][0]["pitch_error_deg"]
    assert low <= 0.0 <= high
    assert "reduced_model" not in said
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "map.html").read_text()
    assert "Plotly.newPlot" in page
    assert "initial speed of the wheels" in page
    dataset = load_map(tmp_path)
    assert dataset.attrs["kind"] == "attraction"
    assert len(dataset.attrs["sha256_toml"]) == 64

    assert main(["map", "attraction", "--slope", "30", *SMALL, "--out", str(tmp_path)]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["map", "attraction", "--slope", "30", *SMALL, "--out", str(tmp_path), "--resume"]) == 0
    assert "equilibrium on 30 deg" in capsys.readouterr().out
    assert main(["map", "attraction", "--slope", "31", *SMALL, "--out", str(tmp_path), "--resume"]) == 2
    assert "settings.slope is" in capsys.readouterr().err
    assert (load_map(tmp_path)["elapsed"] == dataset["elapsed"]).all()
    assert main(["map", "closed-loop", "--plant", "mip", "--out", str(tmp_path), "--resume"]) == 2
    assert "another kind of map" in capsys.readouterr().err


def test_full_model_beside_the_reduced_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--pitch-range=-3:3:2", "--rate-range=0", "--duration", "1.5", "--workers", "0", "--slope", "20"]
    assert main(["map", "attraction", *options, "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "Full and reduced model" in out
    assert load_map(tmp_path)["returns"].all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--slope", "85"], "no trim on a slope"),
        (["--slope", "nan"], "slope"),
        (["--thrust", "60"], "thrust"),
        (["--pitch-range", "0:200:3"], "pitch_error [deg]"),
        (["--pitch-range", "10:5:3"], "increasing"),
        (["--rate-range", "fast"], "START:STOP:COUNT"),
        (["--wheel-speed", "20"], "wheel_speed [m/s]"),
        (["--duration", "0"], "duration"),
        (["--plant", "mip", "--starts", "3"], "differ in heading alone"),
        (["--resume", "--force"], "one of them"),
        (["--workers", "-1", "--plant", "mip"], "workers"),
    ],
)
def test_bad_options_say_what_would_be_valid(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    assert main(["map", "attraction", "--out", str(tmp_path), *options]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert not (tmp_path / "map.nc").exists()
