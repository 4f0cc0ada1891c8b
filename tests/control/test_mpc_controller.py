"""One step of the MPC: optimal, bounded, and safe when something is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from m4_dynamics.control.controller import BalanceController, ControlStatus
from m4_dynamics.control.lqr import lqr_gain
from m4_dynamics.control.mpc.controller import MpcController
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.errors import InvalidSettingError, NonFiniteError
from m4_dynamics.reduced.ground_force import ground_force_in_slope
from m4_dynamics.reduced.kernels import mip_step
from m4_dynamics.reduced.linear import discretise_euler
from m4_dynamics.reduced.pendulum import linearise, state_derivative

#: Limits that never matter.
FREE = {"duty_limits": (-1e3, 1e3), "thrust_limits": (-1e4, 1e4), "ground_constraints": False}


@pytest.mark.parametrize("slope_deg", [0.0, 15.0, 45.0])
@pytest.mark.parametrize("horizon", [1, 10, 40])
def test_unconstrained_mpc_is_the_lqr(pendulum, make_case, slope_deg, horizon):
    # So close to the trim that the model is linear to the digits compared.
    case = make_case(slope_deg, speed=0.0)
    trim = case.trim
    a, b = discretise_euler(*linearise(pendulum, case.slope, trim.state, trim.inputs), 0.005)
    gain, _ = lqr_gain(a, b, MpcSettings().state_weights, MpcSettings().input_weights)
    controller = MpcController(pendulum, case.reference, MpcSettings(horizon=horizon, solver_tolerance=1e-12, **FREE))
    rng = np.random.default_rng(7)
    for _ in range(5):
        error = 1e-6 * rng.normal(size=4)
        controller.reset()
        u = controller.control(0, case.reference.state[0] + error)
        expected = -gain @ error
        np.testing.assert_allclose(u - trim.inputs, expected, atol=2e-6 * np.abs(expected).max() + 1e-13)


def test_converged_plan_is_the_minimum_of_the_nonlinear_problem(pendulum, make_case):
    # The same problem (paper, eq. mpc_formulation) through the readable model and SLSQP, with active friction rows.
    case = make_case(45.0)
    n, sample = 5, 150
    configuration = MpcSettings(
        horizon=n,
        input_weights=MpcSettings.paper().input_weights,  # the default's hardly need the constraints
        friction_static=0.74,
        sqp_iterations=50,
        solver_tolerance=1e-10,
        disturbance_rejection=False,
    )
    controller = MpcController(pendulum, case.reference, configuration)
    state = case.reference.state[sample] + np.array([0.02, -0.08, 0.1, -0.1])
    controller.control(sample, state)
    assert controller.diagnostics.residual < configuration.sqp_tolerance
    plan = controller.plan.inputs
    q, r = np.diag(configuration.state_weights), np.diag(configuration.input_weights)
    terminal = controller.problem.terminals[sample]
    scale = np.array([1.0, 21.6])

    def rollout(z):
        inputs, states, forces = z[:-1].reshape(n, 2) * scale, [state], []
        for u in inputs:
            forces.append(ground_force_in_slope(pendulum, case.slope, states[-1], u))
            states.append(states[-1] + 0.005 * state_derivative(pendulum, case.slope, states[-1], u))
        return inputs, np.array(states), np.array(forces)

    def cost(z):
        inputs, states, _ = rollout(z)
        errors = states[1:] - case.reference.state[sample + 1 : sample + 1 + n]
        efforts = inputs - case.reference.inputs[sample : sample + n]
        total = sum(e @ q @ e for e in errors[:-1]) + errors[-1] @ terminal @ errors[-1]
        total += sum(v @ r @ v for v in efforts)
        return total + configuration.slack_weight * z[-1] + configuration.slack_curvature * z[-1] ** 2

    def margins(z):
        _, _, forces = rollout(z)
        mu = configuration.friction_plan
        rows = [[mu * fn - fx, mu * fn + fx, fn - configuration.normal_force_min] for fx, fn in forces]
        return np.concatenate(rows) + z[-1]

    start = np.append((case.reference.inputs[sample : sample + n] / scale).ravel(), 5.0)
    best = minimize(
        cost,
        start,
        method="SLSQP",
        bounds=[(-1.0, 1.0), (0.0, 2.0)] * n + [(0.0, None)],
        constraints={"type": "ineq", "fun": margins},
        options={"ftol": 1e-12, "maxiter": 500},
    )
    # SLSQP ends where its line search meets rounding; what it found is feasible and no better than the plan.
    assert margins(best.x).min() > -1e-4
    z = np.append((plan / scale).ravel(), controller.diagnostics.slack)
    assert margins(z).min() > -1e-6
    assert np.sort(margins(z))[1] < 1e-4  # friction is active on more than one stage
    assert cost(z) <= best.fun * (1 + 1e-6)
    np.testing.assert_allclose(z, best.x, atol=2e-3)


def test_sqp_iterations_converge_to_a_fixed_point(pendulum, make_case):
    case = make_case(45.0)
    state = case.reference.state[0] + np.array([0.0, np.radians(8.0), 0.0, 0.0])
    residuals = []
    for iterations in (1, 2, 4, 30):
        controller = MpcController(pendulum, case.reference, MpcSettings(sqp_iterations=iterations))
        controller.control(0, state)
        residuals.append(controller.diagnostics.residual)
        assert controller.diagnostics.status == ControlStatus.SOLVED
    assert residuals[-1] < 1e-8
    assert residuals[2] < 1e-2 * residuals[0]


def test_first_plan_of_a_steady_reference_is_the_reference(pendulum, make_case):
    case = make_case(45.0)
    controller = MpcController(pendulum, case.reference)
    assert isinstance(controller, BalanceController)
    u = controller.control(0, case.reference.state[0])
    np.testing.assert_allclose(u, case.trim.inputs, atol=1e-6)
    assert controller.diagnostics.cost < 1e-9
    assert controller.diagnostics.slack < 1e-6


@settings(max_examples=40, deadline=None)
@given(
    state=st.tuples(st.floats(-10, 10), st.floats(-3, 3), st.floats(-30, 30), st.floats(-20, 20)).map(np.array),
    step=st.integers(0, 5000),
)
def test_any_state_gives_inputs_within_their_limits(controller_45, state, step):
    controller_45.reset()
    u = controller_45.control(step, state)
    assert -1.0 <= u[0] <= 1.0
    assert 0.0 <= u[1] <= 43.2
    assert controller_45.diagnostics.slack >= 0.0


@pytest.fixture(scope="module")
def controller_45(pendulum, make_case):
    return MpcController(pendulum, make_case(45.0).reference)


def test_inputs_saturate_far_from_the_trim(pendulum, make_case):
    case = make_case(45.0)
    controller = MpcController(pendulum, case.reference, MpcSettings(ground_constraints=False))
    behind = controller.control(0, case.reference.state[0] + [0.0, -0.5, 0.0, 0.0])
    controller.reset()
    ahead = controller.control(0, case.reference.state[0] + [0.0, 0.5, 0.0, 0.0])
    # Lying back: drive back under the body and push its top forward. Leaning ahead: the opposite.
    assert behind.tolist() == [-1.0, 43.2]
    assert ahead.tolist() == [1.0, 0.0]


@pytest.mark.parametrize("entry", range(4))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_state_that_is_not_finite_is_refused_and_harmless(pendulum, make_case, entry, value):
    case = make_case(45.0)
    disturbed, untouched = (MpcController(pendulum, case.reference) for _ in range(2))
    x = case.reference.state[0] + [0.0, 0.02, 0.0, 0.0]
    disturbed.control(0, x)
    untouched.control(0, x)
    bad = x.copy()
    bad[entry] = value
    with pytest.raises(NonFiniteError, match=["wheel_angle", "pitch", "wheel_rate", "pitch_rate"][entry]):
        disturbed.control(1, bad)
    # Not bit for bit: ProxQP's vectorised sums depend on where in memory its arrays happen to lie.
    np.testing.assert_allclose(disturbed.control(1, x), untouched.control(1, x), rtol=1e-9)


def test_an_overflowing_prediction_falls_back(pendulum, make_case):
    case = make_case(45.0)
    controller = MpcController(pendulum, case.reference)
    x = case.reference.state[0]
    first = controller.control(0, x)
    u = controller.control(1, np.array([0.0, 0.0, 0.0, 1e200]))
    np.testing.assert_allclose(u, first, atol=1e-6)
    assert controller.diagnostics.status == ControlStatus.PREDICTION_NOT_FINITE
    assert controller.diagnostics.fallback
    assert controller.fallbacks == 1
    np.testing.assert_allclose(controller.control(2, x), case.trim.inputs, atol=1e-3)
    assert not controller.diagnostics.fallback


def test_fallback_is_the_shifted_plan_and_then_the_saturated_lqr(pendulum, make_case):
    case = make_case(45.0)
    controller = MpcController(pendulum, case.reference, MpcSettings(plan_age_max=2))
    x = case.reference.state[0] + np.array([0.01, 0.02, 0.0, 0.0])
    controller.control(0, x)
    plan = controller.plan.inputs.copy()
    overflow = np.array([0.0, 0.0, 0.0, 1e200])
    for age in (1, 2):
        np.testing.assert_array_equal(controller.control(age, overflow), plan[age])
        assert (controller.fallbacks, controller.fallbacks_to_lqr) == (age, 0)
    a, b = discretise_euler(*linearise(pendulum, case.slope, case.trim.state, case.trim.inputs), 0.005)
    gain, _ = lqr_gain(a, b, MpcSettings().state_weights, MpcSettings().input_weights)
    u = controller.control(3, overflow)
    np.testing.assert_array_equal(u, np.clip(-gain[:, 3] * 1e200, [-1.0, 0.0], [1.0, 43.2]))
    assert (controller.fallbacks, controller.fallbacks_to_lqr) == (3, 1)


def test_capped_iterations_are_counted_and_the_lqr_still_balances(pendulum, make_case, simulate):
    case = make_case(45.0)
    capped = MpcSettings(solver_iterations=1, solver_inner_iterations=1, solver_tolerance=1e-12)
    controller = MpcController(pendulum, case.reference, capped)
    run = simulate(controller, case.reference, pitch_error_deg=10.0, steps=1000)
    counted = sum(d.fallback for d in run.diagnostics)
    assert counted == controller.fallbacks
    assert counted > 10
    assert controller.fallbacks_to_lqr > 0
    assert {d.status for d in run.diagnostics if d.fallback} == {ControlStatus.ITERATION_LIMIT}
    assert not run.fell
    controller.reset()
    assert (controller.fallbacks, controller.fallbacks_to_lqr) == (0, 0)


def test_jumping_states_never_need_the_fallback(pendulum, make_case):
    # Every tenth sample the state jumps far, which takes the solver's warm start by surprise.
    case = make_case(45.0)
    controller = MpcController(pendulum, case.reference)
    p, rng, x = pendulum.as_array(), np.random.default_rng(1), np.zeros(4)
    constrained = 0
    for k in range(1500):
        if k % 10 == 0:
            x = case.reference.state[k] + rng.normal(size=4) * [0.5, 0.2, 2.0, 1.5]
        u = controller.control(k, x)
        constrained += controller.diagnostics.iterations > 0
        mip_step(p, case.slope, x, u, 0.005, 2, x)
    assert constrained > 1000
    assert controller.fallbacks == 0


def test_steps_may_repeat_jump_and_run_past_the_end(pendulum, make_case):
    case = make_case(15.0)
    controller = MpcController(pendulum, case.reference)
    last = len(case.reference) - 1
    for step in (0, 0, 5, 3, 400, last, last + 1, last + 50):
        x = case.reference.state[min(step, last)]
        u = controller.control(step, x)
        np.testing.assert_allclose(u, case.reference.inputs[min(step, last)], atol=2e-2)
    assert controller.fallbacks == 0
    with pytest.raises(InvalidSettingError, match="step"):
        controller.control(-1, x)
    with pytest.raises(InvalidSettingError, match="shape of state"):
        controller.control(0, np.zeros(3))


def test_reset_makes_runs_repeatable(pendulum, make_case, simulate):
    case = make_case(45.0)
    controller = MpcController(pendulum, case.reference)
    first = simulate(controller, case.reference, pitch_error_deg=5.0, steps=300)
    controller.reset()
    second = simulate(controller, case.reference, pitch_error_deg=5.0, steps=300)
    np.testing.assert_allclose(first.inputs, second.inputs, rtol=1e-6)


def test_reference_of_another_rate_is_refused(pendulum, make_case):
    with pytest.raises(InvalidSettingError, match="time step"):
        MpcController(pendulum, make_case(15.0, dt=0.01).reference)
