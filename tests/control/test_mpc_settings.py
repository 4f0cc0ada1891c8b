"""Settings: the paper's figures, and refusals."""

from __future__ import annotations

import math

import pytest

from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.errors import InvalidSettingError


def test_papers_settings():
    paper = MpcSettings.paper()
    assert (paper.time_step, paper.horizon) == (0.005, 10)
    assert paper.state_weights == (10.0, 1e4, 5.0, 25.0)
    assert paper.input_weights == (5.0, 0.5)
    assert paper.duty_limits == (-1.0, 1.0)
    assert paper.thrust_limits == (0.0, 43.2)
    assert paper.terminal_cost == "none"
    assert paper.friction_plan == 0.8
    assert paper.input_reference == "trim"
    assert MpcSettings.paper(input_reference="zero").input_reference == "zero"


def test_default_keeps_a_friction_margin():
    assert MpcSettings(friction_static=0.5, friction_fraction=0.9).friction_plan == pytest.approx(0.45)
    assert MpcSettings().friction_fraction <= 0.9
    assert MpcSettings().terminal_cost == "riccati"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("time_step", 0.0),
        ("time_step", math.nan),
        ("horizon", 0),
        ("horizon", 2.5),
        ("state_weights", (1.0, -1.0, 1.0, 1.0)),
        ("state_weights", (1.0, 1.0)),
        ("input_weights", (0.0, 1.0)),
        ("input_reference", "rest"),
        ("terminal_cost", "big"),
        ("friction_static", -0.1),
        ("friction_fraction", 0.0),
        ("duty_limits", (1.0, -1.0)),
        ("thrust_limits", (0.0, math.inf)),
        ("normal_force_min", math.nan),
        ("sqp_iterations", 0),
        ("solver_tolerance", 0.0),
        ("plan_age_max", -1),
    ],
)
def test_impossible_settings_are_refused_by_name(name, value):
    with pytest.raises(InvalidSettingError, match=name):
        MpcSettings(**{name: value})
