"""The scripts about maps run, and print the figures that their pictures show."""

from __future__ import annotations

import math
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from m4_dynamics.feasibility.postures import posture_configuration
from m4_dynamics.reduced.reduction import configuration_on_slope, reduce_robot
from m4_dynamics.robot.consistency import self_collisions
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.view.silhouette import outlines_at

ANALYSIS = Path(__file__).parents[2] / "analysis"


@pytest.fixture
def run_script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    def run(name: str, *options: str) -> list[list[str]]:
        """Run a script; returns the words of the lines that it prints."""
        monkeypatch.setattr(sys, "argv", [name, *options, "--out", str(tmp_path / "pictures")])
        runpy.run_path(str(ANALYSIS / name), run_name="__main__")
        return [line.split() for line in capsys.readouterr().out.splitlines()]

    return run


def test_steepest_slope_grows_with_friction(run_script, tmp_path: Path) -> None:
    rows = run_script("slope_thrust_map.py")
    steepest = [float(row[1]) for row in rows if len(row) == 3 and row[0][0].isdigit()]
    assert len(steepest) == 11
    assert steepest == sorted(steepest)
    assert {path.name for path in (tmp_path / "pictures").iterdir()} == {"slope_thrust_map.png", "steepest_slope.png"}


def test_a_shorter_arm_of_the_thrust_climbs_steeper(run_script) -> None:
    rows = run_script("sensitivity.py")
    steepest = {(" ".join(row[:-3]), row[-3]): float(row[-2]) for row in rows if len(row) > 4 and row[-3][0].isdigit()}
    assert steepest["arm of the thrust", "0.80"] > steepest["arm of the thrust", "1.20"] + 5.0
    assert steepest["height of the CoM", "1.20"] > steepest["height of the CoM", "0.80"] + 5.0
    assert steepest["wheel radius", "1.00"] == steepest["arm of the thrust", "1.00"]


def test_morphing_needs_less_friction_and_touches_nothing(run_script) -> None:
    rows = run_script("morphing.py", "--step", "50")
    found = {" ".join(row[:-7]): [float(word) for word in row[-7:]] for row in rows if row[0] in ("as", "rear", "both")}
    described, both = found["as described"], found["both pairs of legs"]
    rear, front, friction, _, pitch, clearance, steepest = both
    assert friction < described[2] - 0.1
    assert steepest > described[6] + 5.0
    robot, slope = load_robot(), math.radians(60.0)
    sides = ("left", "right")
    legs = {f"rear_{side}_hip_sagittal": math.radians(rear) for side in sides}
    legs |= {f"front_{side}_hip_sagittal": math.radians(front) for side in sides}
    reduction = reduce_robot(robot, configuration=posture_configuration(robot, legs))
    assert self_collisions(robot, reduction.configuration) == []
    q = configuration_on_slope(robot, reduction, slope=slope, pitch=math.radians(pitch))
    points = np.vstack([polygon for outline in outlines_at(robot, q) for polygon in outline.polygons])
    heights = points @ [-math.sin(slope), math.cos(slope)]
    # The wheels alone touch the slope, which goes through the origin.
    assert -1e-6 < heights.min() < 1e-3
    assert clearance > 2.0
