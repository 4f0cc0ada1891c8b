"""A wheel that stops near a rising corner has found it; nothing else moves the corner."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from m4_dynamics.control.corner import CornerFinder
from m4_dynamics.control.slope_profile import SlopeProfile
from m4_dynamics.errors import InvalidSettingError

#: Level ground, a rise at 2 rad, and a crest at 6 rad.
PROFILE = SlopeProfile(np.array([-np.inf, 2.0, 6.0]), np.array([0.0, 0.8, 0.0]))


def slope_at(finder: CornerFinder, wheel_angle: float) -> float:
    return float(PROFILE.slopes[np.searchsorted(finder.starts, wheel_angle, side="right") - 1])


def test_a_wheel_that_stops_before_the_rise_is_on_it():
    finder = CornerFinder(PROFILE, reach=0.3)
    assert finder.update(1.9, 0.1, 2.0)
    assert finder.offset == pytest.approx(0.1)
    assert slope_at(finder, 1.9) == 0.8
    # The odometry stays corrected for what comes after.
    np.testing.assert_allclose(finder.starts[1:], [1.9, 5.9])
    finder.reset()
    np.testing.assert_array_equal(finder.starts, PROFILE.starts)


def test_on_the_way_down_the_flat_is_met():
    finder = CornerFinder(PROFILE, reach=0.3)
    assert slope_at(finder, 2.2) == 0.8
    assert finder.update(2.2, -0.1, -2.0)
    assert finder.offset == pytest.approx(-0.2)
    assert slope_at(finder, 2.2) == 0.0


@pytest.mark.parametrize(
    ("angle", "rate", "wanted"),
    [
        (1.5, 0.0, 2.0),  # too far away
        (1.9, 1.5, 2.0),  # not stopped
        (1.9, 0.0, 0.0),  # it is meant to stand
        (5.9, 0.1, 2.0),  # a crest stops nobody
        (2.1, 0.1, 2.0),  # already on the rise
        (1.9, -0.1, -2.0),  # on its way away from it
    ],
)
def test_nothing_else_moves_the_corner(angle, rate, wanted):
    finder = CornerFinder(PROFILE, reach=0.3)
    finder.update(angle, rate, wanted)
    assert finder.offset == 0.0


@given(angle=st.floats(-5.0, 10.0), rate=st.floats(-5.0, 5.0), wanted=st.floats(-5.0, 5.0))
def test_the_odometry_is_never_moved_by_more_than_the_reach(angle, rate, wanted):
    finder = CornerFinder(PROFILE, reach=0.3)
    near = finder.update(angle, rate, wanted)
    assert abs(finder.offset) <= 0.3 + 1e-6
    assert (
        near == (min(abs(angle - start) for start in PROFILE.starts[1:]) <= 0.3)
        or abs(min(abs(angle - start) for start in PROFILE.starts[1:]) - 0.3) < 1e-9
    )


def test_a_reach_must_be_a_distance():
    with pytest.raises(InvalidSettingError, match="reach"):
        CornerFinder(PROFILE, reach=-0.1)
