"""Equilibria: hand figures, equations of motion, selection and refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from m4_dynamics.reduced.pendulum import MipParameters, acceleration
from m4_dynamics.reduced.trim import TrimLimits, select_trim, trim_branches


@pytest.mark.parametrize(
    ("thrust", "pitch_deg", "friction", "torque"),
    [(0.0, 10.8, 1.00, 5.2), (6.6, -3.5, 0.80, 4.6), (14.4, -21.4, 0.60, 3.6), (26.7, -56.0, 0.42, 1.9)],
)
def test_hand_figures_at_45_deg(hand_pendulum: MipParameters, thrust, pitch_deg, friction, torque):
    slope = math.radians(45.0)
    trim = trim_branches(hand_pendulum, slope, thrust)[0]
    assert trim.branch == "upright"
    assert math.degrees(trim.pitch) == pytest.approx(pitch_deg, abs=0.05)
    assert trim.friction_needed == pytest.approx(friction, abs=0.005)
    assert trim.torque == pytest.approx(torque, abs=0.05)
    np.testing.assert_allclose(acceleration(hand_pendulum, slope, trim.state, trim.inputs), 0.0, atol=1e-10)


def test_automatic_trim_keeps_its_reserves(hand_pendulum: MipParameters):
    limits = TrimLimits()
    for slope_deg in (0.0, 15.0, 30.0, 45.0, 55.0):
        trim = select_trim(hand_pendulum, math.radians(slope_deg), limits=limits)
        assert 2.0 - 1e-9 <= trim.thrust <= 43.2 - 2.0
        assert trim.friction_needed <= 0.9 * 0.9 * 0.8 + 1e-9
        assert abs(trim.duty) <= 0.95
