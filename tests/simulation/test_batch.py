"""Many climbs at once are the same climbs."""

from __future__ import annotations

import math

import pytest

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.simulation.batch import run_climbs
from m4_dynamics.simulation.climb import ClimbSettings
from m4_dynamics.simulation.fidelity import Fidelity


def test_processes_change_nothing_and_keep_the_order():
    settings = [
        ClimbSettings(slope=math.radians(slope), duration=5.5, controller="lqr", fidelity=fidelity)
        for slope, fidelity in ((30.0, Fidelity(encoder_counts=4096)), (80.0, Fidelity()))
    ]
    alone, together = run_climbs(settings, workers=1), run_climbs(settings, workers=2)
    assert [one.verdict for one in together] == ["climbed", "infeasible"]
    for one, other in zip(alone, together, strict=True):
        assert (one.verdict, one.slope_deg, one.wheel_rms_m) == (other.verdict, other.slope_deg, other.wheel_rms_m)


def test_refuses_no_processes():
    with pytest.raises(InvalidSettingError, match="workers"):
        run_climbs([], workers=0)
