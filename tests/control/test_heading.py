"""The heading gains place the poles, and the heading keeps its share of the duty."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from m4_dynamics.control.heading import HeadingGains, HeadingHold, heading_gains, heading_stiffness, wheel_duties
from m4_dynamics.errors import InvalidSettingError, NonFiniteError

PLANT = {"yaw_inertia": 0.25, "track": 0.28, "wheel_radius": 0.125, "torque_constant": 6.0, "back_emf_constant": 0.4}


def yaw_matrix(stiffness: float, gains: HeadingGains) -> np.ndarray:
    """Closed-loop yaw dynamics, wheel by wheel from forces: independent of the formula in the module."""
    radius, half_track = PLANT["wheel_radius"], PLANT["track"] / 2

    def moment(yaw: float, rate: float) -> float:
        delta = -(gains.yaw * yaw + gains.rate * rate)
        total = stiffness * yaw
        for side in (1.0, -1.0):  # right wheel, left wheel
            wheel_rate = side * half_track * rate / radius
            torque = PLANT["torque_constant"] / 2 * side * delta - PLANT["back_emf_constant"] / 2 * wheel_rate
            total += side * half_track * torque / radius
        return total

    return np.array([[0.0, 1.0], [moment(1.0, 0.0) / PLANT["yaw_inertia"], moment(0.0, 1.0) / PLANT["yaw_inertia"]]])


@given(
    stiffness=st.floats(-5.0, 20.0),
    frequency=st.floats(1.0, 30.0),
    damping=st.floats(0.2, 2.0),
)
def test_gains_place_the_poles(stiffness, frequency, damping):
    gains = heading_gains(stiffness=stiffness, natural_frequency=frequency, damping_ratio=damping, **PLANT)
    characteristic = np.poly(yaw_matrix(stiffness, gains))
    np.testing.assert_allclose(characteristic, [1.0, 2 * damping * frequency, frequency**2], rtol=1e-9, atol=1e-9)


@given(stiffness=st.floats(-5.0, 20.0), frequency=st.floats(2.0, 30.0), integral=st.floats(0.1, 2.0))
def test_the_integral_has_a_pole_of_its_own_and_leaves_no_error(stiffness, frequency, integral):
    gains = heading_gains(
        stiffness=stiffness, natural_frequency=frequency, damping_ratio=1.0, integral_frequency=integral, **PLANT
    )
    leverage = PLANT["torque_constant"] * PLANT["track"] / (2.0 * PLANT["wheel_radius"])
    # States: integral of the yaw, yaw, yaw rate.
    matrix = np.zeros((3, 3))
    matrix[0, 1] = 1.0
    matrix[1:, 1:] = yaw_matrix(stiffness, gains)
    matrix[2, 0] = -gains.integral * leverage / PLANT["yaw_inertia"]
    expected = np.polymul([1.0, 2.0 * frequency, frequency**2], [1.0, integral])
    np.testing.assert_allclose(np.poly(matrix), expected, rtol=1e-7, atol=1e-7)
    # Against a constant moment the yaw ends at zero: the integral alone carries it.
    at_rest = np.linalg.solve(matrix, [0.0, 0.0, -1.0])
    assert abs(at_rest[1]) < 1e-9


def test_the_integral_waits_at_the_limit():
    hold = HeadingHold(gains=HeadingGains(1.0, 0.0, 2.0), period=0.1, maximum=0.25)
    assert hold.control(1.0, 0.0) == -0.25
    assert hold.standing == 0.0
    assert hold.control(0.1, 0.0) == pytest.approx(-0.1)
    assert hold.standing == pytest.approx(-2.0 * 0.1 * 0.1)


def test_without_hold_a_slope_turns_the_robot_away():
    stiffness = heading_stiffness(weight=58.9, slope=np.radians(45.0), com_uphill_of_axle=0.2)
    assert stiffness == pytest.approx(58.9 * np.sqrt(0.5) * 0.2)
    assert np.linalg.eigvals(yaw_matrix(stiffness, HeadingGains(0.0, 0.0))).real.max() > 1.0


def test_stiffness_is_the_slope_of_gravitys_moment():
    # The CoM turns with the yaw about the slope normal; gravity's component along the slope stays.
    weight, slope, distance, yaw = 58.9, 0.6, 0.21, 1e-4
    com = distance * np.array([np.cos(yaw), np.sin(yaw)])  # uphill, left
    force = np.array([-weight * np.sin(slope), 0.0])
    moment = com[0] * force[1] - com[1] * force[0]
    assert heading_stiffness(weight=weight, slope=slope, com_uphill_of_axle=distance) == pytest.approx(moment / yaw)


def test_differential_duty_is_limited_and_wraps():
    hold = HeadingHold(gains=HeadingGains(2.0, 0.5), maximum=0.25)
    assert hold.control(0.01, 0.02) == pytest.approx(-(2.0 * 0.01 + 0.5 * 0.02))
    assert hold.control(1.0, 0.0) == -0.25
    assert hold.control(2 * np.pi + 0.01, 0.0) == pytest.approx(-0.02)
    with pytest.raises(NonFiniteError, match="rate"):
        hold.control(0.0, float("nan"))


@given(common=st.floats(-3.0, 3.0), differential=st.floats(-1.0, 1.0))
def test_wheels_get_the_whole_difference_within_their_limits(common, differential):
    right, left = wheel_duties(common, differential)
    assert max(abs(right), abs(left)) <= 1.0 + 1e-12
    assert (right - left) / 2 == pytest.approx(differential, abs=1e-12)
    if abs(common) + abs(differential) <= 1.0:
        assert (right + left) / 2 == pytest.approx(common, abs=1e-12)


def test_impossible_figures_are_refused():
    with pytest.raises(InvalidSettingError, match="track"):
        heading_gains(stiffness=1.0, natural_frequency=8.0, damping_ratio=1.0, **{**PLANT, "track": 0.0})
    with pytest.raises(InvalidSettingError, match="maximum"):
        HeadingHold(gains=HeadingGains(1.0, 1.0), maximum=1.5)
