"""The compiled kernels equal the readable functions, and the rollout equals its own definition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m4_dynamics.reduced import kernels
from m4_dynamics.reduced.ground_force import ground_force_in_slope
from m4_dynamics.reduced.pendulum import MipParameters, acceleration, linearise, state_derivative

angles = st.floats(-3.0, 3.0)
rates = st.floats(-20.0, 20.0)
states = st.tuples(st.floats(-100.0, 100.0), angles, rates, rates).map(np.array)
inputs = st.tuples(st.floats(-1.0, 1.0), st.floats(0.0, 43.0)).map(np.array)
slopes = st.floats(-1.5, 1.5)
motor_models = st.sampled_from(["relative", "paper"])


@settings(deadline=None)
@given(slope=slopes, state=states, u=inputs, motor_model=motor_models)
def test_kernels_equal_readable_functions(hand_pendulum: MipParameters, slope, state, u, motor_model):
    parameters = hand_pendulum.with_(motor_model=motor_model)
    out = np.empty(2)
    kernels.mip_acceleration(parameters.as_array(), slope, state, u, out)
    np.testing.assert_allclose(out, acceleration(parameters, slope, state, u), rtol=1e-10, atol=1e-9)
    kernels.ground_force(parameters.as_array(), slope, state, u, out)
    np.testing.assert_allclose(out, ground_force_in_slope(parameters, slope, state, u), rtol=1e-10, atol=1e-9)


def test_rollout_is_explicit_euler_with_its_own_derivatives(hand_pendulum: MipParameters, rng: np.random.Generator):
    n, dt = 7, 0.005
    p = hand_pendulum.as_array()
    slope_at = rng.uniform(-0.5, 1.0, n)
    u = np.column_stack([rng.uniform(-1, 1, n), rng.uniform(0, 40, n)])
    x0 = np.array([0.3, -0.4, 1.0, 0.5])
    x, a, b = np.empty((n + 1, 4)), np.full((n, 4, 4), np.nan), np.full((n, 4, 2), np.nan)
    f, f_x, f_u = np.empty((n, 2)), np.empty((n, 2, 4)), np.empty((n, 2, 2))
    kernels.rollout_and_linearise(p, slope_at, x0, u, dt, x, a, b, f, f_x, f_u)
    np.testing.assert_array_equal(x[0], x0)
    for k in range(n):
        np.testing.assert_allclose(x[k + 1], x[k] + dt * state_derivative(hand_pendulum, slope_at[k], x[k], u[k]))
        a_c, b_c = linearise(hand_pendulum, slope_at[k], x[k], u[k])
        np.testing.assert_allclose(a[k], np.eye(4) + dt * a_c, rtol=0, atol=1e-14)
        np.testing.assert_allclose(b[k], dt * b_c, rtol=0, atol=1e-14)
        np.testing.assert_allclose(f[k], ground_force_in_slope(hand_pendulum, slope_at[k], x[k], u[k]))


def test_runge_kutta_step_converges_at_fourth_order(hand_pendulum: MipParameters):
    p, x0, u = hand_pendulum.as_array(), np.array([0.0, -0.3, 2.0, 1.0]), np.array([0.4, 12.0])

    def advance(substeps: int) -> np.ndarray:
        out = np.empty(4)
        kernels.mip_step(p, 0.7, x0, u, 0.2, substeps, out)
        return out

    reference = advance(4096)
    errors = [np.linalg.norm(advance(n) - reference) for n in (16, 32, 64)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.25)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.25)
