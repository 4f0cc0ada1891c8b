"""`m4 inspect`, as a user meets it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from m4_dynamics.cli.main import main
from m4_dynamics.robot.loading import bundled_description


def test_tables_show_everything(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect"]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    for title in (
        "Robot",
        "Bodies",
        "Joints",
        "Wheels",
        "Thrusters",
        "Servos",
        "Contact points",
        "Postures",
        "Assumed",
    ):
        assert f"\n{title}" in f"\n{captured.out}"
    lines = captured.out.splitlines()
    assert any(line.startswith("mass [kg]") and line.split()[-1] == "6" for line in lines)
    standing = next(line for line in lines if "balancing" in line)
    assert float(standing.split()[-1]) == pytest.approx(0.994, abs=1e-3)
    assert "nothing wrong was found" in captured.out


def test_pipe_gets_whole_lines_and_no_colours(capsys: pytest.CaptureFixture[str]) -> None:
    main(["inspect"])
    out = capsys.readouterr().out
    assert "\x1b" not in out
    assert "the limit of the CAD export's wheel joints" in out  # the end of a long reason, on one line


def test_json_holds_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", "--json"]) == 0
    description = json.loads(capsys.readouterr().out)
    assert description["robot"] == "m4"
    assert description["mass_kg"] == pytest.approx(6.0)
    assert description["degrees_of_freedom"] == 18
    assert len(description["bodies"]) == 13
    assert sum(body["mass_kg"] for body in description["bodies"]) == pytest.approx(6.0)
    assert [wheel["joint"] for wheel in description["wheels"] if wheel["drive"]] == [
        "rear_left_wheel",
        "rear_right_wheel",
    ]
    joints = {joint["name"]: joint for joint in description["joints"]}
    assert joints["rear_left_wheel"]["type"] == "continuous"
    assert joints["rear_left_wheel"]["upper"] is None
    assert joints["front_right_hip_frontal"]["type"] == "revolute"
    assert joints["front_right_hip_frontal"]["upper"] == pytest.approx(100.27, abs=0.01)
    heights = {(posture["name"], posture["attitude"]): posture["height_m"] for posture in description["postures"]}
    assert heights["ugv", "base level"] == pytest.approx(0.35, abs=1e-3)
    assert heights["mip", "balancing"] == pytest.approx(0.994, abs=1e-3)
    assert {"motor.torque_constant", "ground.stiffness"} <= {assumed["key"] for assumed in description["assumed"]}
    assert description["findings"] == []


@pytest.fixture
def with_meshes(tmp_path: Path) -> Path:
    """A folder with M4's meshes, for changed copies of its URDF."""
    shutil.copytree(bundled_description().with_name("meshes"), tmp_path / "meshes")
    return tmp_path


def test_bare_urdf(with_meshes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf = with_meshes / "bare.urdf"
    urdf.write_text(bundled_description().with_name("m4.urdf").read_text())
    assert main(["inspect", str(urdf), "--json"]) == 0
    description = json.loads(capsys.readouterr().out)
    assert description["wheels"] == []
    assert description["balance"] is None
    assert main(["inspect", str(urdf)]) == 0
    assert "ground.stiffness" not in capsys.readouterr().out


@pytest.fixture
def broken(with_meshes: Path) -> Path:
    """A URDF that no reader takes."""
    text = bundled_description().with_name("m4.urdf").read_text()
    path = with_meshes / "broken.urdf"
    old = '<joint name="front_left_wheel" type="continuous">'
    assert old in text
    path.write_text(text.replace(old, '<joint name="front_left_wheel" type="rolling">'))
    return path


def test_broken_urdf_says_what_is_missing_and_where(broken: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(broken)]) == 2
    captured = capfd.readouterr()
    assert captured.err == ""  # nor does any reader below print its own complaint
    assert f"Not a usable robot: {broken}" in captured.out
    finding = next(line for line in captured.out.splitlines() if "front_left_wheel" in line)
    assert finding.startswith("error")
    assert "unknown joint type 'rolling'" in finding
    assert "continuous" in finding  # what would be valid


def test_broken_urdf_in_json(broken: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", "--json", str(broken)]) == 2
    description = json.loads(capfd.readouterr().out)
    assert description["robot"] is None
    assert {finding["severity"] for finding in description["findings"]} >= {"error"}


def test_inertia_that_pinocchio_takes_silently(with_meshes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = bundled_description().with_name("m4.urdf").read_text()
    old = 'ixx="0.00105" ixy="0" ixz="0" iyy="0.002"'
    assert old in text
    urdf = with_meshes / "odd.urdf"
    urdf.write_text(text.replace(old, 'ixx="0.00105" ixy="0" ixz="0" iyy="0.02"', 1))
    assert main(["inspect", str(urdf)]) == 0
    out = capsys.readouterr().out
    assert "breaks the triangle inequality" in out
    assert "link 'front_left_wheel_link' (line " in out


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("nowhere.urdf", None, "no such file"),
        ("robot.toml", "[robot]\n", "[robot] urdf is missing"),
        ("robot.toml", '[robot]\nurdf = "robot.urdf"\nsrdf = 3\n', "[robot] srdf must be a non-empty string"),
    ],
)
def test_bad_descriptions_end_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: str | None, message: str
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    assert main(["inspect", str(path)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("m4 inspect: ")
    assert message in captured.err
    assert "Traceback" not in captured.err


def test_other_peoples_robot(example_robots: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(example_robots / "tiago_description/robots/tiago.urdf")]) == 0
    out = capsys.readouterr().out
    assert "base_antenna_left_link" in out
    assert "not positive definite" in out
