"""`m4 map static` from the outside."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from m4_dynamics.cli.main import main
from m4_dynamics.feasibility.files import load_map

SCOOTER = Path(__file__).parents[1] / "data" / "scooter" / "scooter.toml"
SMALL = ("--slope", "0:80:33", "--thrust", "0:40:21", "--friction", "0.5,0.8")


def test_map_is_written_with_pictures_and_provenance(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "static", *SMALL, "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "steepest slope [deg]" in out
    assert "friction" in out
    for name in ("map.png", "curves.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    dataset = load_map(tmp_path)
    assert dataset.sizes["slope"] == 33
    assert len(dataset.attrs["sha256_urdf"]) == 64
    assert dataset.attrs["version"]
    assert all("units" in variable.attrs for variable in dataset.data_vars.values())


def test_json_holds_the_curves(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "static", *SMALL, "--speed", "0,0.3", "--out", str(tmp_path), "--json"]) == 0
    curves = json.loads(capsys.readouterr().out)["curves"]
    assert [row["speed_m_s"] for row in curves] == [0.0, 0.3]
    steepest = {row["friction"]: row["steepest_slope_deg"] for row in curves[0]["by_friction"]}
    assert 40.0 < steepest[0.5] < steepest[0.8] < 70.0


def test_a_map_is_overwritten_only_with_force(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "static", *SMALL, "--out", str(tmp_path)]) == 0
    before = (tmp_path / "map.nc").read_bytes()
    assert main(["map", "static", "--slope", "0:10:5", "--out", str(tmp_path)]) == 2
    assert "--force" in capsys.readouterr().err
    assert (tmp_path / "map.nc").read_bytes() == before
    assert main(["map", "static", "--slope", "0:10:5", "--out", str(tmp_path), "--force"]) == 0
    assert load_map(tmp_path).sizes["slope"] == 5


#: A disk that takes no more than 2 kB a file.
FULL_DISK = """
import resource, sys
from m4_dynamics.cli.main import main
resource.setrlimit(resource.RLIMIT_FSIZE, (2048, 2048))
sys.exit(main(sys.argv[1:]))
"""


def test_a_full_disk_leaves_what_was_there(tmp_path: Path) -> None:
    assert main(["map", "static", *SMALL, "--out", str(tmp_path)]) == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    command = [
        sys.executable,
        "-c",
        FULL_DISK,
        "map",
        "static",
        "--slope",
        "0:70:71",
        "--out",
        str(tmp_path),
        "--force",
    ]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert "cannot write" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_robot_without_thrusters(tmp_path: Path) -> None:
    assert main(["map", "static", str(SCOOTER), "--slope", "0:60:61", "--out", str(tmp_path)]) == 0
    assert load_map(tmp_path).sizes["thrust"] == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--slope", "0:95:20"], "slope"),
        (["--slope", "0:80"], "START:STOP:COUNT"),
        (["--slope", "0:80:0"], "count from 1"),
        (["--slope", "80:0:5"], "increasing"),
        (["--thrust", "nan"], "--thrust"),
        (["--thrust", "few"], "--thrust"),
        (["--friction", "-0.5"], "friction"),
        (["--posture-angle", "0:90:3"], "--posture-joint"),
        (["--posture-angle", "0:10:2", "--posture-joint", "elbow"], "elbow"),
        (["--posture", "lotus"], "lotus"),
        (["--figure-of-merit", "0"], "figure_of_merit"),
    ],
)
def test_bad_options_say_what_would_be_valid(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    assert main(["map", "static", *options, "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert not (tmp_path / "map.nc").exists()
