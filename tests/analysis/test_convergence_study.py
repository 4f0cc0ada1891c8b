"""The study's scenarios run, their errors fall with the step, and the picture is drawn."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from m4_dynamics.robot.loading import load_robot

STUDY = runpy.run_path(str(Path(__file__).parents[2] / "analysis" / "convergence_study.py"), run_name="study")


@pytest.mark.parametrize("name", ["land", "drive", "lie"])
def test_errors_against_explicit_steps_fall_with_the_step(name: str) -> None:
    robot, scenario = load_robot(), STUDY["OPEN_LOOP"][name]
    reference = scenario(robot, 5e-6, explicit=True)
    whole, half = scenario(robot, 2e-3), scenario(robot, 1e-3)
    assert whole.failures == half.failures == 0
    assert half.error(reference) < 0.7 * whole.error(reference)
    assert half.error(reference) < 0.4  # [mm]


def test_the_closed_loop_is_near_its_finest_steps_at_the_chosen_one() -> None:
    robot = load_robot()
    finest, chosen = STUDY["climb"](robot, 2.5e-4), STUDY["climb"](robot, STUDY["CHOSEN"])
    assert 0.0 < chosen.error(finest) < 0.2  # [mm]


def test_picture(tmp_path: Path) -> None:
    curve = [(1e-3, 0.1, 10.0), (2e-3, 0.2, 10.0)]
    scenarios = STUDY["SCENARIO_COLOURS"]
    steps = {kind: dict.fromkeys(scenarios, curve) for kind in ("implicit", "explicit")}
    path = STUDY["draw"](steps, dict.fromkeys(STUDY["GROUNDS"], curve), tmp_path / "study.png")
    assert path.stat().st_size > 10_000


def test_lost_runs_are_called_lost() -> None:
    assert STUDY["in_words"](float("inf")) == "lost"
    assert STUDY["in_words"](0.0123) == "0.012"
