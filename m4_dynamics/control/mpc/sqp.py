"""Sequential quadratic programming on the condensed problem: linearise, condense, solve, step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.controller import ControlStatus
from m4_dynamics.control.mpc import kernels
from m4_dynamics.control.mpc.kernels import condense, evaluate, read_out
from m4_dynamics.control.mpc.plan import Plan
from m4_dynamics.control.mpc.problem import Problem
from m4_dynamics.control.mpc.qp import QuadraticProgramme
from m4_dynamics.control.mpc.target import Target
from m4_dynamics.reduced.kernels import rollout_and_linearise, rollout_over_profile

__all__ = ["SqpOptimiser"]

_Array = NDArray[np.float64]

#: Halvings of a step before it is given up, and the share of the promised decrease of the merit that a step must keep.
_HALVINGS = 12
_DECREASE = 1e-4

#: Merit that the QP solver's tolerance leaves open, in units of the penalty of a slack as large as that tolerance.
_UNRESOLVED = 10.0


class Linearisation(NamedTuple):
    """The reduced model along a plan, filled in place by `reduced.kernels.rollout_and_linearise`.

    Attributes:
        states: x_0 .. x_n, shape (n + 1, nx).
        a: d x_{k+1} / d x_k, shape (n, nx, nx).
        b: d x_{k+1} / d u_k, shape (n, nx, 2).
        force: (f_x, f_n) at (x_k, u_k), shape (n, 2) [N].
        force_x: Its derivative with respect to x_k, shape (n, 2, nx).
        force_u: Its derivative with respect to u_k, shape (n, 2, 2).
    """

    states: _Array
    a: _Array
    b: _Array
    force: _Array
    force_x: _Array
    force_u: _Array

    @classmethod
    def allocate(cls, n: int, nx: int) -> Linearisation:
        """Allocate for n steps of nx states."""
        return cls(*(np.zeros(s) for s in ((n + 1, nx), (n, nx, nx), (n, nx, 2), (n, 2), (n, 2, nx), (n, 2, 2))))


class SqpOptimiser:
    """Improves plans for one problem (Gauss-Newton: second derivatives of the dynamics are left out).

    Attributes:
        qp: The quadratic programme of the last linearisation.
        linearisation: The model along the plan that the last iteration started from.
        outcome: Costs, slack and size of the last optimisation step, layout in `kernels`.
        iterations: Iterations of the QP solver in the last call of `improve`.
    """

    __slots__ = (
        "_pieces",
        "_problem",
        "_slopes",
        "_trial",
        "_trial_inputs",
        "iterations",
        "linearisation",
        "outcome",
        "qp",
    )

    def __init__(self, problem: Problem) -> None:
        """Allocate everything.

        Args:
            problem: The optimal control problem.
        """
        settings = problem.settings
        n = settings.horizon
        constrained = settings.ground_constraints
        self._problem = problem
        self.qp = QuadraticProgramme(
            variables=2 * n + 1 if constrained else 2 * n,
            slacks=1 if constrained else 0,
            rows=3 * n if constrained else 0,
            tolerance=settings.solver_tolerance,
            iterations=settings.solver_iterations,
            inner_iterations=settings.solver_inner_iterations,
        )
        states = problem.states.shape[1]
        self.linearisation = Linearisation.allocate(n, states)
        self._trial = Linearisation.allocate(n, states)
        self._slopes: _Array = np.zeros(n + 1)
        self._pieces: NDArray[np.int64] = np.zeros(n + 1, dtype=np.int64)
        self._trial_inputs: _Array = np.zeros((n, 2))
        self.outcome: _Array = np.zeros(kernels.OUTCOME_COUNT)
        self.iterations = 0

    def improve(self, plan: Plan, state: _Array, target: Target) -> tuple[ControlStatus, bool]:
        """Optimise a plan's inputs and states in place.

        Args:
            plan: Its inputs are the starting point, within their bounds.
            state: x_0, shape (nx,), finite.
            target: What to aim at.

        Returns:
            The last verdict on a QP, and whether the plan was optimised; if not, its inputs are as they were and
            `outcome` describes them.
        """
        problem, qp, inputs = self._problem, self.qp, plan.inputs
        settings = problem.settings
        states, a, b, force, force_x, force_u = self.linearisation
        self.iterations = 0
        optimised = False
        status = ControlStatus.SOLVED
        for _ in range(settings.sqp_iterations):
            self._roll_out(target, state, inputs, self.linearisation)
            if problem.profile is not None:
                target.meet(self._slopes, self._pieces)
            finite = condense(
                a,
                b,
                states,
                inputs,
                force,
                force_x,
                force_u,
                target.states,
                target.costed_inputs,
                target.weights,
                target.terminal,
                qp.hessian,
                qp.gradient,
                qp.rows,
                qp.rows_upper,
                qp.box_lower,
                qp.box_upper,
            )
            if not finite:
                status = ControlStatus.PREDICTION_NOT_FINITE
                break
            status = qp.solve()
            self.iterations += qp.iterations
            if status != ControlStatus.SOLVED:
                break
            if settings.sqp_iterations > 1:
                optimised = True
                if not self._line_search(plan, state, target):
                    break
                continue
            optimised = read_out(
                qp.solution,
                a,
                b,
                states,
                inputs,
                target.states,
                target.costed_inputs,
                target.weights,
                target.terminal,
                plan.states,
                inputs,
                self.outcome,
            )
            if not optimised:
                status = ControlStatus.PREDICTION_NOT_FINITE
        if not optimised:
            evaluate(
                states,
                inputs,
                force,
                target.states,
                target.costed_inputs,
                target.weights,
                target.terminal,
                settings.ground_constraints,
                self.outcome,
            )
        return status, optimised

    def _roll_out(self, target: Target, state: _Array, inputs: _Array, linearisation: Linearisation) -> None:
        """Predict and linearise along inputs, on the target's ground or on the profile's where the wheels get to."""
        problem, time_step = self._problem, self._problem.settings.time_step
        if problem.profile is None:
            rollout_and_linearise(target.model, target.slopes, state, inputs, time_step, *linearisation)
        else:
            assert target.corners is not None
            starts, slopes = target.corners.starts, problem.profile.slopes
            rollout_over_profile(
                target.model, starts, slopes, state, inputs, time_step, self._slopes, self._pieces, *linearisation
            )

    def _line_search(self, plan: Plan, state: _Array, target: Target) -> bool:
        """Follow the QP's step as far as the nonlinear merit keeps a share of the promised decrease.

        The QP minimises a convex model of the merit (cost plus exact penalty), so its step is a descent direction of
        the merit wherever it is not zero: the halvings end. What the QP solver's tolerance is worth in merit counts as
        no increase, else the last, tiniest steps would be refused.

        Returns:
            Whether another iteration is worth while.
        """
        problem, qp, outcome = self._problem, self.qp, self.outcome
        settings, weights = problem.settings, target.weights
        constrained = settings.ground_constraints
        terminal, state_reference, input_reference = target.terminal, target.states, target.costed_inputs

        def merit(linearisation: Linearisation, inputs: _Array) -> float:
            states, force = linearisation.states, linearisation.force
            return float(
                evaluate(
                    states, inputs, force, state_reference, input_reference, weights, terminal, constrained, outcome
                )
            )

        before = merit(self.linearisation, plan.inputs)
        slack = outcome[kernels.SLACK]
        penalty = slack * (settings.slack_weight + settings.slack_curvature * slack)
        promised = penalty - qp.objective()
        unresolved = _UNRESOLVED * settings.slack_weight * weights[kernels.SLACK_SCALE] * settings.solver_tolerance
        step = qp.solution[: 2 * settings.horizon].reshape(-1, 2)
        direction = step * weights[kernels.INPUT_SCALE : kernels.INPUT_SCALE + 2]
        residual = float(np.abs(step).max())
        outcome[kernels.STEP_SIZE] = residual

        length = 1.0
        for _ in range(_HALVINGS):
            np.add(plan.inputs, length * direction, out=self._trial_inputs)
            np.clip(
                self._trial_inputs,
                weights[kernels.LOWER : kernels.LOWER + 2],
                weights[kernels.UPPER : kernels.UPPER + 2],
                out=self._trial_inputs,
            )
            self._roll_out(target, state, self._trial_inputs, self._trial)
            if merit(self._trial, self._trial_inputs) <= before - _DECREASE * length * promised + unresolved:
                plan.inputs[:] = self._trial_inputs
                plan.states[:] = self._trial.states
                return residual > settings.sqp_tolerance
            length *= 0.5
        # No length of this step helps: stay.
        merit(self.linearisation, plan.inputs)
        plan.states[:] = self.linearisation.states
        return False
