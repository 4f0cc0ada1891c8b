"""The pendulum against an independent Lagrangian, finite differences and conservation laws."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m4_dynamics.errors import InvalidSettingError, M4Error, NonFiniteError
from m4_dynamics.reduced import kernels, pendulum
from m4_dynamics.reduced.pendulum import MipParameters

states = st.tuples(st.floats(-50.0, 50.0), st.floats(-3.0, 3.0), st.floats(-20.0, 20.0), st.floats(-10.0, 10.0)).map(
    np.array
)
inputs = st.tuples(st.floats(-1.0, 1.0), st.floats(0.0, 43.0)).map(np.array)
slopes = st.floats(-1.5, 1.5)
motor_models = st.sampled_from(["relative", "paper"])


def lagrangian_acceleration(
    casadi: Any, parameters: MipParameters, slope: float, state: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """Euler-Lagrange equations derived symbolically from positions alone (paper, eqs. pos_vectors, lagrangian_2d)."""
    q, qd = casadi.SX.sym("q", 2), casadi.SX.sym("qd", 2)
    c, s = casadi.cos(q[1]), casadi.sin(q[1])

    def from_axle(point):
        return casadi.vertcat(c * point[0] + s * point[1], -s * point[0] + c * point[1])

    p_w = parameters.wheel_radius * q[0] * casadi.vertcat(math.cos(slope), math.sin(slope))
    p_b, p_t = p_w + from_axle(parameters.com_in_body), p_w + from_axle(parameters.thrust_point_in_body)
    v_w, v_b, v_t = (casadi.jtimes(point, q, qd) for point in (p_w, p_b, p_t))
    g = parameters.gravity
    lagrangian = (
        0.5 * parameters.mass_body * casadi.dot(v_b, v_b)
        + 0.5 * parameters.inertia_body * qd[1] ** 2
        - parameters.mass_body * g * p_b[1]
        + 0.5 * parameters.mass_wheel * casadi.dot(v_w, v_w)
        + 0.5 * parameters.inertia_wheel * qd[0] ** 2
        - parameters.mass_wheel * g * p_w[1]
    )
    relative = qd[0] - qd[1] if parameters.motor_model == "relative" else qd[0]
    torque = parameters.torque_constant * u[0] - parameters.back_emf_constant * relative
    power_of_thrust = u[1] * casadi.dot(v_t, casadi.vertcat(c, -s))
    force = casadi.vertcat(torque, -torque) + casadi.gradient(power_of_thrust, qd)
    momentum = casadi.gradient(lagrangian, qd)
    mass = casadi.jacobian(momentum, qd)
    right = force + casadi.gradient(lagrangian, q) - casadi.jtimes(momentum, q, qd)
    function = casadi.Function("f", [q, qd], [casadi.solve(mass, right)])
    return np.array(function(state[:2], state[2:])).ravel()


@settings(max_examples=25, deadline=None)
@given(slope=slopes, state=states, u=inputs, motor_model=motor_models)
def test_equations_of_motion_follow_from_the_lagrangian(
    hand_pendulum: MipParameters, require_peer: Callable[[str], Any], slope, state, u, motor_model
):
    parameters = hand_pendulum.with_(motor_model=motor_model)
    expected = lagrangian_acceleration(require_peer("casadi"), parameters, slope, state, u)
    found = pendulum.acceleration(parameters, slope, state, u)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-8)


@settings(max_examples=50, deadline=None)
@given(slope=slopes, state=states, u=inputs, motor_model=motor_models)
def test_linearisation_matches_finite_differences(hand_pendulum: MipParameters, slope, state, u, motor_model):
    parameters = hand_pendulum.with_(motor_model=motor_model)
    a, b = pendulum.linearise(parameters, slope, state, u)

    def derivative(y: np.ndarray) -> np.ndarray:
        return pendulum.state_derivative(parameters, slope, y[:4], y[4:])

    y, step = np.concatenate([state, u]), 1e-5
    difference = np.column_stack(
        [(derivative(y + step * e) - derivative(y - step * e)) / (2 * step) for e in np.eye(6)]
    )
    scale = max(1.0, float(np.abs(difference).max()))
    np.testing.assert_allclose(np.hstack([a, b]), difference, atol=1e-6 * scale)


@settings(max_examples=50, deadline=None)
@given(slope=slopes, state=states, u=inputs)
def test_power_balance(hand_pendulum: MipParameters, slope, state, u):
    """The energy changes by the motor's and the thrust's power, and by nothing else."""
    x_dot = pendulum.state_derivative(hand_pendulum, slope, state, u)

    def energy(x: np.ndarray) -> float:
        kinetic = pendulum.kinetic_energy(hand_pendulum, slope, x)
        return kinetic + pendulum.potential_energy(hand_pendulum, slope, x)

    def thrust_point(x: np.ndarray) -> np.ndarray:
        return pendulum.thrust_position(hand_pendulum, slope, x)

    step = 1e-6
    change = (energy(state + step * x_dot) - energy(state - step * x_dot)) / (2 * step)
    velocity = (thrust_point(state + step * x_dot) - thrust_point(state - step * x_dot)) / (2 * step)
    torque = pendulum.motor_torque(hand_pendulum, state, u[0])
    direction = np.array([math.cos(state[1]), -math.sin(state[1])])
    power = torque * (state[2] - state[3]) + u[1] * velocity @ direction
    assert change == pytest.approx(power, rel=1e-5, abs=1e-3)


def test_energy_is_conserved_without_inputs_and_back_emf(hand_pendulum: MipParameters):
    free = hand_pendulum.with_(back_emf_constant=0.0)
    slope, x = 0.4, np.array([0.0, 0.3, 3.0, -1.0])

    def energy(state: np.ndarray) -> float:
        return pendulum.kinetic_energy(free, slope, state) + pendulum.potential_energy(free, slope, state)

    start, out = energy(x), x.copy()
    swing = []
    for _ in range(200):
        kernels.mip_step(free.as_array(), slope, out, np.zeros(2), 0.01, 20, out)
        assert energy(out) == pytest.approx(start, abs=1e-7)
        swing.append(pendulum.kinetic_energy(free, slope, out))
    assert max(swing) - min(swing) > 1.0, "the motion must exchange energy for this to mean anything"


def test_point_mass_on_level_ground_falls_like_a_rod():
    """Without motor and thrust, on a wheel too heavy to move: theta'' = m g l sin(theta) / (I + m l^2)."""
    parameters = MipParameters(2.0, 1e9, 0.1, 0.0, (0.0, 0.5), (0.0, 1.0), 0.1, 1.0, 0.0)
    found = pendulum.acceleration(parameters, 0.0, [0.0, 0.3, 0.0, 0.0], [0.0, 0.0])
    assert found[1] == pytest.approx(2.0 * 9.81 * 0.5 * math.sin(0.3) / (0.1 + 2.0 * 0.25), rel=1e-6)
    assert found[0] == pytest.approx(0.0, abs=1e-7)


@settings(max_examples=50, deadline=None)
@given(slope=st.floats(-1.0, 1.0), state=states, u=inputs)
def test_inverse_dynamics_returns_the_inputs(hand_pendulum: MipParameters, slope, state, u):
    acceleration = pendulum.acceleration(hand_pendulum, slope, state, u)
    found = pendulum.inverse_dynamics(hand_pendulum, slope, state, acceleration)
    np.testing.assert_allclose(found, u, atol=1e-8)


def test_inverse_dynamics_names_the_pitch_without_leverage(hand_pendulum: MipParameters):
    low = hand_pendulum.with_(thrust_point_in_body=(0.0, 0.125))
    with pytest.raises(M4Error, match=r"180\.0 deg"):
        pendulum.inverse_dynamics(low, 0.0, [0.0, math.pi, 0.0, 0.0], [0.0, 0.0])


def test_zero_order_hold_is_exact_for_held_inputs(hand_pendulum: MipParameters, rng: np.random.Generator):
    a, b = pendulum.linearise(hand_pendulum, 0.5, [0.0, -0.2, 1.0, 0.0], [0.3, 10.0])
    x0, u, dt = rng.normal(size=4), rng.normal(size=2), 0.05
    x, n = x0.copy(), 2000
    for _ in range(n):  # midpoint rule with a tiny step
        h = dt / n
        x = x + h * (a @ (x + 0.5 * h * (a @ x + b @ u)) + b @ u)
    a_d, b_d = pendulum.discretise_zoh(a, b, dt)
    np.testing.assert_allclose(a_d @ x0 + b_d @ u, x, rtol=1e-7)
    a_e, b_e = pendulum.discretise_euler(a, b, dt)
    np.testing.assert_allclose(a_e @ x0 + b_e @ u, x0 + dt * (a @ x0 + b @ u))


def test_controllability(hand_pendulum: MipParameters):
    a, b = pendulum.linearise(hand_pendulum, math.radians(45.0), [0.0, -0.3, 0.0, 0.0], [0.6, 12.0])
    both = pendulum.controllability(a, b)
    assert both.matrix.shape == (4, 8)
    assert both.rank == 4
    assert both.smallest_singular_value == pytest.approx(np.linalg.svd(both.matrix)[1][-1])
    assert pendulum.controllability(a, b[:, :1]).rank == 4, "wheels alone control it"
    assert pendulum.controllability(a, np.zeros((4, 2))).rank == 0
    # Two copies of one integrator driven alike cannot be told apart by the input.
    twins = pendulum.controllability(np.zeros((2, 2)), np.ones((2, 1)))
    assert twins.rank == 1
    assert twins.smallest_singular_value == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("change", "setting"),
    [
        ({"mass_body": 0.0}, "mass_body"),
        ({"wheel_radius": math.nan}, "wheel_radius"),
        ({"inertia_wheel": -1.0}, "inertia_wheel"),
        ({"com_in_body": (0.0, 0.1, 0.2)}, "com_in_body"),
        ({"motor_model": "magic"}, "motor_model"),
    ],
)
def test_bad_parameters_are_named(hand_pendulum: MipParameters, change, setting):
    with pytest.raises(InvalidSettingError, match=setting):
        hand_pendulum.with_(**change)


def test_bad_states_are_named(hand_pendulum: MipParameters):
    with pytest.raises(NonFiniteError, match="pitch_rate"):
        pendulum.acceleration(hand_pendulum, 0.0, [0.0, 0.0, 0.0, math.nan], [0.0, 0.0])
    with pytest.raises(NonFiniteError, match="thrust"):
        pendulum.linearise(hand_pendulum, 0.0, [0.0, 0.0, 0.0, 0.0], [0.0, math.inf])
    with pytest.raises(InvalidSettingError, match="shape of state"):
        pendulum.bias(hand_pendulum, 0.0, [0.0, 0.0])
