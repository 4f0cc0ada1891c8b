"""`m4 reduce` from the outside."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from m4_dynamics.cli.main import main

SCOOTER = Path(__file__).parents[1] / "data" / "scooter" / "scooter.toml"


def run_json(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict:
    assert main(["reduce", *arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_parameters_and_residual_of_m4(capsys):
    description = run_json(capsys)
    assert description["mass_body"] == pytest.approx(5.095)
    assert description["mass_wheel"] == pytest.approx(0.905)
    assert description["com_in_body"] == pytest.approx([0.021, 0.447], abs=5e-4)
    assert description["thrust_point_in_body"] == pytest.approx([0.114, 0.744], abs=5e-4)
    assert description["wheel_radius"] == 0.125
    assert description["residual"]["in_plane"] <= 1e-9
    assert description["residual"]["out_of_plane"] <= 1e-9
    on_slope = description["on_slope"]
    assert on_slope["controllability"]["rank"] == 4
    assert len(on_slope["holding"]) == 8
    assert on_slope["loaded"]["com_in_body"] != description["com_in_body"]


def test_tables_show_units_axes_and_loads(capsys):
    assert main(["reduce"]) == 0
    out = capsys.readouterr().out
    for words in ("com_in_body", "kg m2", "forward", "out of plane", "rear_left_hip_sagittal", "sag [deg]"):
        assert words in out


def test_slope_without_trim_leaves_the_rest(capsys):
    description = run_json(capsys, "--slope", "80")
    assert "friction" in description["on_slope"]["no_trim"]
    assert main(["reduce", "--slope", "80"]) == 0
    assert "Legs and heading are not shown" in capsys.readouterr().out


def test_robot_without_thrusters_and_servos(capsys):
    description = run_json(capsys, str(SCOOTER), "--slope", "5")
    assert description["thrust_max"] == 0.0
    assert description["on_slope"]["holding"] == []
    assert description["on_slope"]["controllability"]["rank"] == 4
    assert [wheel["sign"] for wheel in description["frame"]["drive_wheels"]] == [1.0, -1.0]
    assert main(["reduce", str(SCOOTER), "--slope", "5"]) == 0
    assert "thrust pushes" not in capsys.readouterr().out


def test_lopsided_robot_is_reported(capsys, tmp_path: Path):
    urdf = SCOOTER.with_suffix(".urdf").read_text()
    (tmp_path / "scooter.urdf").write_text(urdf.replace('xyz="0.01 0 0.3"', 'xyz="0.01 0.015 0.3"'))
    for suffix in (".srdf", ".toml"):
        (tmp_path / f"scooter{suffix}").write_text(SCOOTER.with_suffix(suffix).read_text())
    description = run_json(capsys, str(tmp_path / "scooter.toml"), "--slope", "0")
    assert description["residual"]["in_plane"] <= 1e-9
    assert description["residual"]["out_of_plane"] > 0.05
    assert description["com_lateral"] == pytest.approx(4.0 * 0.015 / 5.0)
    assert main(["reduce", str(tmp_path / "scooter.toml"), "--slope", "0"]) == 0
    assert "not symmetric" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--posture", "headstand"], "mip_sitting"),
        (["--posture", "ugv"], "no forward direction"),
        (["--slope", "nan"], "between -90 and 90"),
        (["/nowhere/robot.urdf"], "no such file"),
    ],
)
def test_bad_input_ends_with_a_sentence(capsys, arguments, words):
    assert main(["reduce", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_robot_that_does_not_balance_is_refused(capsys, tmp_path: Path):
    bare = tmp_path / "bare.urdf"
    bare.write_text(SCOOTER.with_suffix(".urdf").read_text())
    assert main(["reduce", str(bare)]) == 2
    assert "[balance]" in capsys.readouterr().err
