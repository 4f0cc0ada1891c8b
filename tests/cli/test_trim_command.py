"""`m4 trim` from the outside."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from m4_dynamics.cli.main import main

SCOOTER = Path(__file__).parents[1] / "data" / "scooter" / "scooter.toml"


def run_json(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict:
    assert main(["trim", *arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_branches_at_a_given_thrust(capsys):
    description = run_json(capsys, "--slope", "45", "--thrust", "14.4")
    upright, hanging = description["branches"]
    assert upright["pitch_deg"] == pytest.approx(-21.4, abs=0.1)
    assert upright["friction_needed"] == pytest.approx(0.60, abs=0.005)
    assert upright["torque_Nm"] == pytest.approx(3.6, abs=0.05)
    assert upright["duty"] == pytest.approx(upright["torque_Nm"] / 6.0)
    assert upright["normal_force_N"] == pytest.approx(47.4, abs=0.1)
    assert upright["selected_by"] == ["thrust"]
    assert upright["margins"]["friction"] == pytest.approx(0.2, abs=0.005)
    assert hanging["branch"] == "hanging"
    assert not hanging["within_limits"]


def test_sweep_marks_what_each_criterion_chooses(capsys):
    branches = run_json(capsys, "--slope", "45", "--friction", "0.8")["branches"]
    assert [row["thrust_N"] for row in branches] == sorted(row["thrust_N"] for row in branches)
    chosen = {criterion: row for row in branches for criterion in row["selected_by"]}
    assert set(chosen) == {"automatic", "least-friction", "least-thrust", "least-power"}
    assert chosen["least-thrust"]["friction_needed"] == pytest.approx(0.8, abs=1e-6)
    assert chosen["least-friction"]["friction_needed"] == min(row["friction_needed"] for row in branches)
    assert chosen["automatic"]["margins"]["friction"] > 0.1


def test_thrust_outside_the_limits_is_shown_with_what_it_misses(capsys):
    assert main(["trim", "--slope", "45", "--thrust", "0"]) == 0
    out = capsys.readouterr().out
    assert "friction" in out
    assert "None satisfies the limits" in out
    assert "0.20 short" in out


def test_impossible_slope_says_why(capsys):
    assert main(["trim", "--slope", "80", "--friction", "0.3"]) == 2
    captured = capsys.readouterr()
    assert "a coefficient of 1.40 is needed" in captured.err
    assert "0.30 is there" in captured.err
    assert "Traceback" not in captured.err
    assert "Equilibria of m4" in captured.out


def test_impossible_slope_as_json(capsys):
    assert main(["trim", "--slope", "80", "--friction", "0.3", "--json"]) == 2
    description = json.loads(capsys.readouterr().out)
    assert description["no_trim"]["limit"] == "friction"
    assert description["branches"]
    assert not any(row["within_limits"] for row in description["branches"])


def test_speed_costs_duty(capsys):
    still = run_json(capsys, "--thrust", "10")["branches"][0]
    fast = run_json(capsys, "--thrust", "10", "--speed", "0.5")["branches"][0]
    assert fast["duty"] - still["duty"] == pytest.approx(0.4 * 4.0 / 6.0)


def test_given_pitch(capsys):
    (row,) = run_json(capsys, "--pitch", "-30")["branches"]
    assert row["pitch_deg"] == pytest.approx(-30.0)
    assert row["selected_by"] == ["pitch"]


def test_fallback_of_the_automatic_choice_is_mentioned(capsys):
    assert main(["trim", "--slope", "60"]) == 0
    assert "No equilibrium keeps the reserves" in capsys.readouterr().out


def test_robot_without_thrusters(capsys):
    (row,) = run_json(capsys, str(SCOOTER), "--slope", "10")["branches"]
    assert row["thrust_N"] == 0.0
    assert row["selected_by"] == ["automatic", "least-friction", "least-thrust", "least-power"]
    # It has no thrust to keep in reserve, and nothing else is scarce.
    assert main(["trim", str(SCOOTER), "--slope", "10"]) == 0
    out = capsys.readouterr().out
    assert "reserves" not in out
    assert "rotors" not in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--slope", "90"], "between -90 and 90"),
        (["--slope", "nan"], "between -90 and 90"),
        (["--friction", "0"], "friction_static"),
        (["--speed", "inf"], "speed"),
        (["--thrust", "nan"], "thrust"),
        (["--posture", "headstand"], "mip_sitting"),
        (["--rotor-radius", "0"], "rotor_radius"),
        (["/nowhere/robot.toml"], "no such file"),
        (["--slope", "0", "--thrust", "60"], "no pitch balances the robot"),
    ],
)
def test_bad_input_ends_with_a_sentence(capsys, arguments, words):
    assert main(["trim", *arguments]) == 2
    captured = capsys.readouterr()
    assert words in captured.err
    assert "nan" not in captured.out.lower()
