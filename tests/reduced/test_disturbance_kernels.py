"""Generalised forces beside the pendulum's own: in the dynamics, in the ground force, and undone by the inputs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from m4_dynamics.reduced import kernels
from m4_dynamics.reduced.pendulum import (
    MipParameters,
    bias,
    input_map,
    inverse_dynamics,
    mass_matrix,
    motor_torque,
)

angles = st.floats(-1.2, 1.2)
rates = st.floats(-5.0, 5.0)
states = st.tuples(st.floats(-100.0, 100.0), angles, rates, rates).map(np.array)
inputs = st.tuples(st.floats(-1.0, 1.0), st.floats(0.0, 43.0)).map(np.array)
slopes = st.floats(-0.5, 1.0)
forces = st.tuples(st.floats(-5.0, 5.0), st.floats(-10.0, 10.0)).map(np.array)
motor_models = st.sampled_from(["relative", "paper"])


def disturbed(parameters: MipParameters, disturbance: np.ndarray) -> np.ndarray:
    p = parameters.as_array()
    p[kernels.DISTURBANCE_WHEEL : kernels.DISTURBANCE_PITCH + 1] = disturbance
    return p


@settings(deadline=None)
@given(slope=slopes, state=states, u=inputs, d=forces, motor_model=motor_models)
def test_disturbances_are_generalised_forces(hand_pendulum: MipParameters, slope, state, u, d, motor_model):
    parameters = hand_pendulum.with_(motor_model=motor_model)
    out = np.empty(2)
    kernels.mip_acceleration(disturbed(parameters, d), slope, state, u, out)
    left = mass_matrix(parameters, slope, state) @ out + bias(parameters, slope, state)
    np.testing.assert_allclose(left, input_map(parameters, slope, state) @ u + d, rtol=1e-9, atol=1e-9)


@settings(deadline=None)
@given(slope=slopes, state=states, u=inputs, d=forces)
def test_friction_is_what_the_motors_give_less_what_spins_the_wheels(hand_pendulum: MipParameters, slope, state, u, d):
    # Moments about the axle on the wheels alone: no mass, CoM or thrust enters, so no error in them can.
    p, out, force = disturbed(hand_pendulum, d), np.empty(2), np.empty(2)
    kernels.mip_acceleration(p, slope, state, u, out)
    kernels.ground_force(p, slope, state, u, force)
    torque = motor_torque(hand_pendulum, state, u[0]) - hand_pendulum.inertia_wheel * out[0]
    assert force[0] * hand_pendulum.wheel_radius == pytest.approx(torque, rel=1e-9, abs=1e-9)


def test_linearisation_with_a_disturbance_by_finite_differences(hand_pendulum: MipParameters, rng: np.random.Generator):
    p = disturbed(hand_pendulum, np.array([-0.8, 2.5]))
    slope_at, dt, step = np.array([0.6]), 0.005, 1e-6
    for _ in range(20):
        x0 = rng.uniform([-1, -0.8, -2, -2], [1, 0.8, 2, 2])
        u = np.array([[rng.uniform(-1, 1), rng.uniform(0, 40)]])

        def roll(x, v):
            states, a, b = np.empty((2, 4)), np.empty((1, 4, 4)), np.empty((1, 4, 2))
            force, force_x, force_u = np.empty((1, 2)), np.empty((1, 2, 4)), np.empty((1, 2, 2))
            kernels.rollout_and_linearise(p, slope_at, x, v, dt, states, a, b, force, force_x, force_u)
            return np.concatenate([states[1], force[0]]), np.vstack([a[0], force_x[0]]), np.vstack([b[0], force_u[0]])

        _, by_state, by_input = roll(x0, u)
        for j, change in enumerate(step * np.eye(4)):
            column = (roll(x0 + change, u)[0] - roll(x0 - change, u)[0]) / (2 * step)
            np.testing.assert_allclose(by_state[:, j], column, rtol=1e-6, atol=1e-6)
        for j, change in enumerate(step * np.eye(2)):
            column = (roll(x0, u + change)[0] - roll(x0, u - change)[0]) / (2 * step)
            np.testing.assert_allclose(by_input[:, j], column, rtol=1e-6, atol=1e-6)


@settings(deadline=None)
@given(slope=slopes, other=slopes, state=states, u=inputs, d=forces, shift=st.floats(-0.3, 0.3))
def test_inputs_along_make_the_same_motion(hand_pendulum: MipParameters, slope, other, state, u, d, shift):
    nominal, actual, out = hand_pendulum.as_array(), disturbed(hand_pendulum, d), np.empty((1, 2))
    wide = np.array([-1e6, -1e6]), np.array([1e6, 1e6])
    args = (np.array([slope]), np.array([other]), state[None], u[None], shift, *wide, out)
    kernels.inputs_along(nominal, actual, *args)
    wanted, got = np.empty(2), np.empty(2)
    kernels.mip_acceleration(nominal, slope, state, u, wanted)
    shifted = state + np.array([0.0, shift, 0.0, 0.0])
    kernels.mip_acceleration(actual, other, shifted, out[0], got)
    np.testing.assert_allclose(got, wanted, rtol=1e-7, atol=1e-7)


def test_undisturbed_inputs_along_stay_what_they_are(hand_pendulum: MipParameters, rng: np.random.Generator):
    n, p = 6, hand_pendulum.as_array()
    u = np.column_stack([rng.uniform(-1, 1, n), rng.uniform(0, 40, n)])
    x, slope_at, out = rng.uniform(-0.5, 0.5, (n, 4)), rng.uniform(0, 1, n), np.empty((n, 2))
    kernels.inputs_along(p, p, slope_at, slope_at, x, u, 0.0, np.array([-1.0, 0.0]), np.array([1.0, 43.2]), out)
    np.testing.assert_allclose(out, u, rtol=1e-12, atol=1e-12)


def forces_at_rest(parameters, d, slope, pitch):
    """Thrust, friction and normal force that hold a disturbed robot, from the readable functions."""
    state = np.array([0.0, pitch, 0.0, 0.0])
    u = inverse_dynamics(parameters, slope, state, (0.0, 0.0))
    u = u - np.linalg.solve(input_map(parameters, slope, state), d)
    weight = parameters.weight
    friction = weight * np.sin(slope) - u[1] * np.cos(pitch + slope) - d[0] / parameters.wheel_radius
    return u[1], friction, weight * np.cos(slope) + u[1] * np.sin(pitch + slope)


def within(parameters, d, slope, pitch, limits):
    """The limits' slack at rest, negative outside."""
    thrust, friction, normal = forces_at_rest(parameters, d, slope, pitch)
    least, most, mu, normal_min = limits
    return min(thrust - least, most - thrust, mu * normal - abs(friction), normal - normal_min)


@settings(deadline=None, max_examples=60)
@given(slope=st.floats(0.0, 0.9), pitch=st.floats(-0.7, 0.1), d=forces)
def test_pitch_shift_is_the_least_that_keeps_the_limits(hand_pendulum: MipParameters, slope, pitch, d):
    state, limits = np.array([0.0, pitch, 0.0, 0.0]), np.array([2.0, 41.2, 0.64, 5.0])
    u = inverse_dynamics(hand_pendulum, slope, state, (0.0, 0.0))
    nominal_slack = within(hand_pendulum, np.zeros(2), slope, pitch, limits)
    assume(nominal_slack > 1e-3)
    p, actual = hand_pendulum.as_array(), disturbed(hand_pendulum, d)
    shift, needed = kernels.pitch_shift_within_limits(p, actual, slope, slope, state, u, limits)
    _, friction, normal = forces_at_rest(hand_pendulum, d, slope, pitch + shift)
    assert needed == pytest.approx(abs(friction) / normal if normal > 0.0 else np.inf, rel=1e-9)
    before, found = (within(hand_pendulum, d, slope, pitch + s, limits) for s in (0.0, shift))
    # Brute force: the shifts that would do, searched on a grid.
    grid = np.radians(np.arange(-19.5, 19.6, 0.25))
    enough = [abs(s) for s in grid if within(hand_pendulum, d, slope, pitch + s, limits) >= 0.0]
    if not enough:
        assert found >= before - 1e-9
    elif before >= 0.0:
        assert shift == 0.0
    else:
        assert found >= -1e-6
        assert abs(shift) <= min(enough) + 1e-6
        assert within(hand_pendulum, d, slope, pitch + 0.99 * shift, limits) < 0.0
