"""The condensed programme equals one formed from dense matrices and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m4_dynamics.control.mpc import kernels
from m4_dynamics.control.mpc.plan import Plan
from m4_dynamics.control.mpc.problem import Problem
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.control.mpc.sqp import SqpOptimiser
from m4_dynamics.control.mpc.target import Target
from m4_dynamics.reduced.ground_force import ground_force_in_slope
from m4_dynamics.reduced.pendulum import state_derivative

N = 6
SCALE = np.array([1.0, 21.6])


class Dense:
    """Cost and constraints of one horizon from the readable model, as plain functions of the inputs."""

    def __init__(self, pendulum, case, problem, state, sample):
        self.pendulum, self.case, self.problem, self.state, self.sample = pendulum, case, problem, state, sample

    def rollout(self, inputs):
        states, forces = [self.state], []
        for u in inputs:
            forces.append(ground_force_in_slope(self.pendulum, self.case.slope, states[-1], u))
            states.append(states[-1] + 0.005 * state_derivative(self.pendulum, self.case.slope, states[-1], u))
        return np.array(states), np.array(forces)

    def errors(self, inputs):
        states, _ = self.rollout(inputs)
        return states[1:] - self.case.reference.state[self.sample + 1 : self.sample + 1 + len(inputs)]

    def cost(self, inputs):
        q, r = np.diag(self.problem.settings.state_weights), np.diag(self.problem.settings.input_weights)
        errors = self.errors(inputs)
        efforts = inputs - self.problem.costed_inputs[self.sample : self.sample + len(inputs)]
        total = sum(e @ q @ e for e in errors[:-1]) + errors[-1] @ self.problem.terminals[self.sample] @ errors[-1]
        return total + sum(v @ r @ v for v in efforts)

    def rows(self, inputs):
        _, forces = self.rollout(inputs)
        mu, least = self.problem.settings.friction_plan, self.problem.settings.normal_force_min
        return np.concatenate([[fx - mu * fn, -fx - mu * fn, least - fn] for fx, fn in forces])


@pytest.fixture(scope="module")
def setup(pendulum, make_case):
    def make(slope_deg, state_offset, sample=150, **options):
        case = make_case(slope_deg)
        problem = Problem(pendulum, case.reference, MpcSettings(horizon=N, **options))
        state = case.reference.state[sample] + state_offset
        optimiser, plan = SqpOptimiser(problem), Plan(N)
        plan.inputs[:] = case.reference.inputs[sample : sample + N] + np.array([0.05, 1.0])
        nominal = plan.inputs.copy()
        target = Target(problem)
        target.aim(sample, state[0])
        optimiser.improve(plan, state, target)
        return Dense(pendulum, case, problem, state, sample), optimiser, plan, nominal

    return make


def jacobian(function, inputs, step=1e-6):
    """Central differences with respect to the scaled inputs, one column per input."""
    columns = []
    for k in range(N):
        for c in range(2):
            change = np.zeros((N, 2))
            change[k, c] = step * SCALE[c]
            columns.append((function(inputs + change) - function(inputs - change)) / (2 * step))
    return np.array(columns).T


offsets = st.tuples(st.floats(-1, 1), st.floats(-0.3, 0.3), st.floats(-2, 2), st.floats(-2, 2)).map(np.array)


@settings(max_examples=15, deadline=None)
@given(offset=offsets, slope_deg=st.sampled_from([0.0, 15.0, 45.0]))
def test_derivatives_by_finite_differences(setup, offset, slope_deg):
    dense, optimiser, _, nominal = setup(slope_deg, offset)
    gradient = jacobian(lambda u: np.array([dense.cost(u)]), nominal)[0]
    np.testing.assert_allclose(optimiser.qp.gradient[:-1], gradient, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(optimiser.qp.rows[:, :-1], jacobian(dense.rows, nominal), rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(optimiser.qp.rows_upper, -dense.rows(nominal), rtol=1e-9, atol=1e-9)


@settings(max_examples=15, deadline=None)
@given(offset=offsets, terminal_cost=st.sampled_from(["riccati", "none"]))
def test_hessian_is_gauss_newtons(setup, offset, terminal_cost):
    dense, optimiser, _, nominal = setup(45.0, offset, terminal_cost=terminal_cost)
    effect = jacobian(lambda u: dense.errors(u).ravel(), nominal)
    weight = np.kron(np.eye(N), np.diag(dense.problem.settings.state_weights))
    weight[-4:, -4:] = dense.problem.terminals[0]
    effort = np.diag(np.tile(np.array(dense.problem.settings.input_weights) * SCALE**2, N))
    expected = 2.0 * (effect.T @ weight @ effect + effort)
    np.testing.assert_allclose(optimiser.qp.hessian[:-1, :-1], expected, rtol=1e-5, atol=1e-3)


def test_bounds_are_those_of_the_inputs(setup):
    _, optimiser, _, nominal = setup(45.0, np.zeros(4))
    z = optimiser.qp
    lower, upper = (nominal + SCALE * box[:-1].reshape(N, 2) for box in (z.box_lower, z.box_upper))
    np.testing.assert_allclose(lower, np.tile([-1.0, 0.0], (N, 1)), atol=1e-12)
    np.testing.assert_allclose(upper, np.tile([1.0, 43.2], (N, 1)), atol=1e-12)
    assert z.box_lower[-1] == 0.0
    assert z.box_upper[-1] == kernels.UNBOUNDED


def test_reported_cost_is_the_papers_j(setup):
    # Close to the reference the linear prediction is exact, so J can be summed from the nonlinear rollout.
    dense, optimiser, plan, _ = setup(45.0, np.array([1e-4, 1e-5, 1e-4, 1e-4]), sqp_iterations=20)
    states, _ = dense.rollout(plan.inputs)
    np.testing.assert_allclose(plan.states, states, atol=1e-12)
    errors = dense.errors(plan.inputs)
    efforts = plan.inputs - dense.problem.costed_inputs[dense.sample : dense.sample + N]
    expected = np.einsum("ki,i,ki", errors, dense.problem.settings.state_weights, errors)
    expected += np.einsum("ki,i,ki", efforts, dense.problem.settings.input_weights, efforts)
    assert optimiser.outcome[kernels.COST_PAPER] == pytest.approx(expected, rel=1e-9)
    assert optimiser.outcome[kernels.COST_TERMINAL] == pytest.approx(dense.cost(plan.inputs), rel=1e-9)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=1, max_size=6))
def test_all_finite(values):
    array = np.array(values)
    assert kernels.all_finite(array) == bool(np.isfinite(array).all())
