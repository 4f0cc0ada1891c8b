"""Ground forces: two independent forms agree, Newton's law holds, and the printed equations are off as expected."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from m4_dynamics.errors import M4Error
from m4_dynamics.reduced import kernels, pendulum
from m4_dynamics.reduced.ground_force import (
    ground_force_constraint_system,
    ground_force_in_slope,
    ground_force_linearised,
    ground_force_paper_uncorrected,
    singular_pitch,
)
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.trim import trim_branches

states = st.tuples(st.floats(-50.0, 50.0), st.floats(-3.0, 3.0), st.floats(-20.0, 20.0), st.floats(-10.0, 10.0)).map(
    np.array
)
inputs = st.tuples(st.floats(-1.0, 1.0), st.floats(0.0, 43.0)).map(np.array)
slopes = st.floats(-1.5, 1.5)
lengths = st.floats(-0.3, 0.3)


@settings(max_examples=300, deadline=None)
@given(slope=slopes, state=states, u=inputs, com_forward=lengths, thrust_up=st.floats(0.2, 1.0))
def test_both_forms_agree_away_from_the_singularity(
    hand_pendulum: MipParameters, slope, state, u, com_forward, thrust_up
):
    parameters = hand_pendulum.with_(com_in_body=(com_forward, 0.447), thrust_point_in_body=(0.1, thrust_up))
    distance = math.remainder(state[1] - singular_pitch(parameters, slope), math.pi)
    assume(abs(distance) > 0.01)
    newton = ground_force_in_slope(parameters, slope, state, u)
    system = ground_force_constraint_system(parameters, slope, state, u)
    np.testing.assert_allclose(system, newton, rtol=0, atol=1e-9 * max(1.0, float(np.abs(newton).max())))


@settings(max_examples=50, deadline=None)
@given(slope=slopes, state=states, u=inputs, offset=st.floats(-4e-4, 4e-4))
def test_averaging_bridges_the_singularity_at_second_order(hand_pendulum: MipParameters, slope, state, u, offset):
    state[1] = singular_pitch(hand_pendulum, slope) + offset
    newton = ground_force_in_slope(hand_pendulum, slope, state, u)
    scale = max(1.0, float(np.abs(newton).max()))
    for step in (1e-3, 2e-3):
        averaged = ground_force_constraint_system(hand_pendulum, slope, state, u, averaging_step=step)
        np.testing.assert_allclose(averaged, newton, rtol=0, atol=10.0 * step**2 * scale)


def test_singular_pitch_is_shifted_by_the_com(hand_pendulum: MipParameters):
    slope = math.radians(45.0)
    pitch = singular_pitch(hand_pendulum, slope)
    assert pitch == pytest.approx(-slope - math.atan(0.021 / 0.447))
    assert singular_pitch(hand_pendulum.with_(com_in_body=(0.0, 0.447)), slope) == pytest.approx(-slope)
    # The CoM lies on the normal through the axle there.
    com = pendulum.rotation(pitch) @ hand_pendulum.com_in_body
    assert com @ [math.cos(slope), math.sin(slope)] == pytest.approx(0.0, abs=1e-12)


def test_singular_system_without_averaging_is_refused(hand_pendulum: MipParameters):
    centred = hand_pendulum.with_(com_in_body=(0.0, 0.447))
    with pytest.raises(M4Error, match="singular"):
        ground_force_constraint_system(centred, 0.0, [0.0, 0.0, 1.0, 0.0], [0.3, 10.0], averaging_step=0.0)


@settings(max_examples=50, deadline=None)
@given(slope=slopes, state=states, u=inputs)
def test_derivatives_match_finite_differences(hand_pendulum: MipParameters, slope, state, u):
    force, force_x, force_u = ground_force_linearised(hand_pendulum, slope, state, u)
    np.testing.assert_allclose(force, ground_force_in_slope(hand_pendulum, slope, state, u), rtol=1e-10, atol=1e-9)
    y, step = np.concatenate([state, u]), 1e-5

    def force_at(z: np.ndarray) -> np.ndarray:
        return ground_force_in_slope(hand_pendulum, slope, z[:4], z[4:])

    difference = np.column_stack([(force_at(y + step * e) - force_at(y - step * e)) / (2 * step) for e in np.eye(6)])
    scale = max(1.0, float(np.abs(difference).max()))
    np.testing.assert_allclose(np.hstack([force_x, force_u]), difference, atol=1e-6 * scale)


def test_force_changes_the_momentum_of_a_trajectory(hand_pendulum: MipParameters):
    """Impulse = change of momentum, both from positions along an integrated trajectory."""
    slope, u, dt = 0.6, np.array([0.4, 15.0]), 1e-3
    x = np.array([0.0, -0.2, 4.0, 1.0])
    gravity = np.array([0.0, -hand_pendulum.weight])

    def momentum(state: np.ndarray) -> np.ndarray:
        step, rate = 1e-6, np.concatenate([state[2:], np.zeros(2)])
        total = np.zeros(2)
        for mass, position in (
            (hand_pendulum.mass_body, pendulum.com_position),
            (hand_pendulum.mass_wheel, pendulum.wheel_position),
        ):
            ahead = position(hand_pendulum, slope, state + step * rate)
            behind = position(hand_pendulum, slope, state - step * rate)
            total += mass * (ahead - behind) / (2 * step)
        return total

    def force_in_world(state: np.ndarray) -> np.ndarray:
        ground = pendulum.rotation(-slope) @ ground_force_in_slope(hand_pendulum, slope, state, u)
        return ground + gravity + u[1] * np.array([math.cos(state[1]), -math.sin(state[1])])

    start, impulse = momentum(x), np.zeros(2)
    for _ in range(100):
        middle, end = np.empty(4), np.empty(4)
        kernels.mip_step(hand_pendulum.as_array(), slope, x, u, dt / 2, 1, middle)
        kernels.mip_step(hand_pendulum.as_array(), slope, x, u, dt, 1, end)
        impulse += dt / 6.0 * (force_in_world(x) + 4.0 * force_in_world(middle) + force_in_world(end))  # Simpson
        x = end
    np.testing.assert_allclose(momentum(x) - start, impulse, atol=1e-6)
    assert np.linalg.norm(impulse) > 0.5


def test_printed_equations_miss_the_wheels_weight(hand_pendulum: MipParameters):
    """At standstill without thrust on the level, only the wheels' weight is missing."""
    trim = trim_branches(hand_pendulum, 0.0, 0.0)[0]
    # The body must not hang exactly over the axle, where the printed system is singular too.
    state = trim.state + np.array([0.0, 0.2, 0.0, 0.0])
    right = ground_force_constraint_system(hand_pendulum, 0.0, state, trim.inputs)
    printed = ground_force_paper_uncorrected(hand_pendulum, 0.0, state, trim.inputs)
    wheel_weight = hand_pendulum.mass_wheel * hand_pendulum.gravity
    np.testing.assert_allclose(right - printed, [0.0, wheel_weight], atol=1e-9)


def test_printed_thrust_arm_is_off_by_the_com_height(hand_pendulum: MipParameters):
    """The thrust's extra moment l_b,z f_t appears in the normal force through the arm of the CoM."""
    slope, weightless_wheels = math.radians(45.0), hand_pendulum.with_(mass_wheel=1e-12)
    trim = trim_branches(weightless_wheels, slope, 12.0)[0]
    right = ground_force_constraint_system(weightless_wheels, slope, trim.state, trim.inputs)
    printed = ground_force_paper_uncorrected(weightless_wheels, slope, trim.state, trim.inputs)
    com = pendulum.rotation(trim.pitch) @ weightless_wheels.com_in_body
    arm = com @ [math.cos(slope), math.sin(slope)]
    assert abs(printed[1] - right[1]) == pytest.approx(0.447 * 12.0 / arm, rel=1e-6)
    assert printed[0] == pytest.approx(right[0], abs=1e-9), "friction follows from the wheel's spin alone"
