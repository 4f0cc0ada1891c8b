"""Climbs with rotors that lag by 0.15 s, as a sibling robot's do, under controllers that know it."""

from __future__ import annotations

import dataclasses
import math

import pytest

from m4_dynamics.reduced.reduction import reduce_robot
from m4_dynamics.simulation.climb import ClimbSettings, run_climb
from m4_dynamics.simulation.fidelity import Fidelity

LAG = 0.15


@pytest.fixture(scope="module")
def sluggish(m4):
    return dataclasses.replace(
        m4, thrusters=tuple(dataclasses.replace(thruster, time_constant=LAG) for thruster in m4.thrusters)
    )


@pytest.mark.parametrize("slope", [15.0, 30.0, 45.0])
@pytest.mark.parametrize("error", [5.0, -5.0])
def test_climbs_without_slipping(sluggish, slope, error):
    settings = ClimbSettings(slope=math.radians(slope), pitch_error=math.radians(error), duration=7.0)
    summary = run_climb(sluggish, settings).summary
    assert summary.verdict == "climbed", summary.reason
    assert summary.max_slip_speed_m_s <= 5e-3
    assert summary.slip_distance_m <= 5e-3
    assert summary.air_time_s == 0.0
    assert summary.fallbacks == 0
    assert summary.wheel_rms_m <= 0.01  # measured 0.003 to 0.006
    assert summary.pitch_rms_deg <= 0.05


def test_a_configured_lag_reaches_the_model(m4, sluggish):
    assert reduce_robot(m4).parameters.thrust_time_constant == 0.0
    assert reduce_robot(sluggish).parameters.thrust_time_constant == pytest.approx(LAG)
    # A lag that the plant is given instead of the robot's is known too.
    settings = ClimbSettings(slope=math.radians(45.0), duration=7.0)
    own = run_climb(sluggish, settings).summary
    switched = run_climb(m4, dataclasses.replace(settings, fidelity=Fidelity(rotor_time_constant=LAG))).summary
    assert switched.wheel_rms_m == pytest.approx(own.wheel_rms_m, rel=1e-6)


def test_lqr_climbs_too(sluggish):
    settings = ClimbSettings(slope=math.radians(45.0), duration=7.0, controller="lqr")
    summary = run_climb(sluggish, settings).summary
    assert summary.verdict == "climbed", summary.reason
    assert summary.slip_time_s == 0.0
