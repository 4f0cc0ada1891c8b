"""ProxQP behind its guard, against an active-set method and the optimality conditions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from m4_dynamics.control.controller import ControlStatus
from m4_dynamics.control.mpc.qp import QuadraticProgramme


def fill(programme: QuadraticProgramme, rng: np.random.Generator) -> None:
    n, rows = len(programme.gradient), len(programme.rows_upper)
    root = rng.normal(size=(n + 3, n))
    programme.hessian[:] = root.T @ root + np.eye(n)
    programme.gradient[:] = 5.0 * rng.normal(size=n)
    programme.rows[:] = rng.normal(size=(rows, n))
    programme.rows_upper[:] = rng.uniform(0.05, 1.0, size=rows)
    programme.box_lower[:] = -rng.uniform(0.1, 1.0, size=n)
    programme.box_upper[:] = rng.uniform(0.1, 1.0, size=n)


def make(variables: int, rows: int, **options: float) -> QuadraticProgramme:
    defaults = {"tolerance": 1e-9, "iterations": 60, "inner_iterations": 60, "slacks": 0}
    return QuadraticProgramme(variables=variables, rows=rows, **{**defaults, **options})


def assert_optimal(programme: QuadraticProgramme, z: np.ndarray) -> int:
    """Check feasibility, and that the negative gradient is a non-negative combination of active constraints' normals.

    Returns:
        The number of active constraints.
    """
    n = len(z)
    assert (programme.rows @ z <= programme.rows_upper + 1e-7).all()
    assert (z >= programme.box_lower - 1e-7).all()
    assert (z <= programme.box_upper + 1e-7).all()
    all_rows = np.vstack([programme.rows, np.eye(n), -np.eye(n)])
    bounds = np.concatenate([programme.rows_upper, programme.box_upper, -programme.box_lower])
    # ProxQP stops on feasibility and stationarity: an active constraint may keep a gap of some 1e-5.
    touching = all_rows[all_rows @ z > bounds - 1e-4]
    gradient = programme.hessian @ z + programme.gradient
    if len(touching) == 0:
        np.testing.assert_allclose(gradient, 0.0, atol=1e-6)
    else:
        multipliers = lsq_linear(touching.T, -gradient, bounds=(0.0, np.inf)).x
        np.testing.assert_allclose(touching.T @ multipliers, -gradient, atol=1e-4)
    return len(touching)


def test_solutions_satisfy_the_optimality_conditions():
    rng = np.random.default_rng(1)
    programme = make(8, 12)
    active = 0
    for _ in range(50):
        fill(programme, rng)
        assert programme.solve() == ControlStatus.SOLVED
        active += assert_optimal(programme, programme.solution) > 0
    assert active > 25


@pytest.mark.parametrize("slacks", [0, 1])
def test_the_unconstrained_optimum_is_taken_when_it_is_the_optimum(slacks):
    rng = np.random.default_rng(6)
    programme = make(7, 5, slacks=slacks)
    shortcuts = 0
    for _ in range(200):
        fill(programme, rng)
        programme.gradient[:] *= 0.2
        if slacks:
            # A slack: no coupling in the cost, a cost that rises from zero, and relief of every row.
            programme.hessian[-1, :] = programme.hessian[:, -1] = 0.0
            programme.hessian[-1, -1] = 1.0
            programme.gradient[-1] = 50.0
            programme.box_lower[-1] = 0.0
            programme.rows[:, -1] = -1.0
        assert programme.solve() == ControlStatus.SOLVED
        z = programme.solution.copy()
        assert_optimal(programme, z)
        shortcuts += programme.iterations == 0
    assert 20 < shortcuts < 180


def test_without_rows_and_bounds_it_solves_a_linear_system():
    rng = np.random.default_rng(2)
    programme = make(6, 0)
    fill(programme, rng)
    programme.box_lower[:] = -1e20
    programme.box_upper[:] = 1e20
    assert programme.solve() == ControlStatus.SOLVED
    np.testing.assert_allclose(programme.solution, -np.linalg.solve(programme.hessian, programme.gradient), atol=1e-8)


def test_iteration_limit_is_reported_and_the_next_problem_solved():
    rng = np.random.default_rng(3)
    programme = make(8, 12, iterations=1, inner_iterations=1)
    fill(programme, rng)
    assert programme.solve() == ControlStatus.ITERATION_LIMIT
    np.testing.assert_array_equal(programme.solution, 0.0)
    # Without anything active, one iteration is enough, also after the failure.
    programme.gradient[:] = 0.0
    assert programme.solve() == ControlStatus.SOLVED


def test_infeasible_rows_end_at_the_cap():
    programme = make(2, 2)
    programme.hessian[:] = np.eye(2)
    programme.rows[:] = [[1.0, 0.0], [-1.0, 0.0]]
    programme.rows_upper[:] = [-1.0, -1.0]
    assert programme.solve() != ControlStatus.SOLVED
    assert programme.iterations <= 60 * 60
    programme.rows_upper[:] = 1.0
    programme.gradient[:] = [-0.5, 0.0]
    assert programme.solve() == ControlStatus.SOLVED
    np.testing.assert_allclose(programme.solution, [0.5, 0.0], atol=1e-8)


def test_solution_is_a_copy_and_reset_forgets():
    rng = np.random.default_rng(4)
    programme = make(5, 3)
    fill(programme, rng)
    programme.solve()
    first = programme.solution.copy()
    kept = programme.solution
    fill(programme, rng)
    programme.hessian[:] *= 2.0
    programme.solve()
    assert kept is programme.solution
    assert not np.allclose(first, programme.solution)
    programme.reset()
    np.testing.assert_array_equal(programme.solution, 0.0)
    assert programme.solve() == ControlStatus.SOLVED


def test_objective_is_that_of_the_solution():
    rng = np.random.default_rng(5)
    programme = make(5, 3)
    fill(programme, rng)
    programme.solve()
    z = programme.solution
    assert programme.objective() == pytest.approx(0.5 * z @ programme.hessian @ z + programme.gradient @ z)
    assert programme.objective() < 0.0
