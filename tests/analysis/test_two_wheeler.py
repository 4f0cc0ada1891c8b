"""The worked example of bringing one's own robot: every command that takes a robot takes it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from m4_dynamics.cli.main import main

ROBOT = str(Path(__file__).parents[2] / "analysis" / "robots" / "two_wheeler.toml")


def run_json(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict:
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_inspect_finds_nothing_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_json(capsys, "inspect", ROBOT)["findings"] == []


def test_reduction_is_exact(capsys: pytest.CaptureFixture[str]) -> None:
    reduced = run_json(capsys, "reduce", ROBOT, "--slope", "5")
    # What the URDF says, wheel by wheel.
    assert (reduced["mass_body"], reduced["mass_wheel"]) == pytest.approx((3.0, 0.8))
    assert reduced["com_in_body"] == pytest.approx([0.0, 0.25])
    assert max(reduced["residual"].values()) < 1e-9


def test_trim_is_the_one_by_hand(capsys: pytest.CaptureFixture[str]) -> None:
    (branch,) = run_json(capsys, "trim", ROBOT, "--slope", "5")["branches"]
    # Along the slope the ground must carry the weight's part; the torque that this takes leans the body forward.
    torque = 3.8 * 9.81 * 0.08 * 0.0871557
    assert branch["torque_Nm"] == pytest.approx(torque, rel=1e-4)
    assert branch["pitch_deg"] == pytest.approx(57.29578 * torque / (3.0 * 9.81 * 0.25), rel=1e-3)


def test_it_climbs(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    arguments = ("wair", ROBOT, "--slope", "5", "--no-viewer", "--out", str(tmp_path))
    assert run_json(capsys, *arguments)["verdict"] == "climbed"
