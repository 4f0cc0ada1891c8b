"""The example of one's own controller does what it says, and its remark on the heading is true."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

SCRIPT = Path(__file__).parents[2] / "analysis" / "own_controller.py"


def test_it_balances_the_full_model(capsys: pytest.CaptureFixture[str]) -> None:
    names = runpy.run_path(str(SCRIPT))
    assert "after 5 s" in capsys.readouterr().out
    assert abs(names["travel"]) < 5.0
    assert abs(names["lean"]) < 0.1
    assert abs(names["estimator"].heading) < 1e-3
    # The true state, not what odometry believes: it stands still, the body where the trim has it.
    plant, frame = names["plant"], names["reduction"].frame
    assert np.abs(plant.velocity).max() < 1e-2
    forward_in_world = pin.Quaternion(plant.configuration[3:7]).toRotationMatrix() @ frame.forward_in_base
    assert -np.arcsin(forward_in_world[2]) == pytest.approx(names["trim"].pitch, abs=0.01)


def test_without_its_heading_loop_the_robot_spins_out(tmp_path: Path) -> None:
    code = SCRIPT.read_text("utf-8")
    line = "turn = -3.0 * estimator.heading - 0.7 * estimator.heading_rate"
    assert line in code
    copy = tmp_path / "without_heading.py"
    copy.write_text(code.replace(line, "turn = 0.0"), "utf-8")
    assert abs(runpy.run_path(str(copy))["estimator"].heading) > 0.5
