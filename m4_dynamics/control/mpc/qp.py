"""The quadratic programme of one control step, and ProxQP behind a guard."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from proxsuite import proxqp

from m4_dynamics.control.controller import ControlStatus
from m4_dynamics.control.mpc.kernels import UNBOUNDED

__all__ = ["QuadraticProgramme"]

_Array = NDArray[np.float64]


class QuadraticProgramme:
    """min 1/2 z' H z + g' z  subject to  C z <= rows_upper,  lower <= z <= upper.

    The arrays are filled in place by `kernels.condense`; `solve` hands them to one ProxQP object that lives as long as
    this one, because a new object or a new preconditioner costs several times the solution.

    ProxQP is guarded: its certificate of primal infeasibility is switched off (it has a sign error for lower bounds,
    and the soft rows leave every problem feasible), both levels of its iterations are capped, and no number that is
    not finite may reach it: NaN in H or C would poison the object for good. `condense` reports it, the caller checks.

    Attributes:
        hessian: H, shape (m, m).
        gradient: g, shape (m,).
        rows: C, shape (r, m).
        rows_upper: Upper bounds of C z, shape (r,).
        box_lower: Lower bounds of z, shape (m,).
        box_upper: Upper bounds of z, shape (m,).
        solution: z of the last solved problem, shape (m,), a copy.
        iterations: Inner iterations of the last call of `solve`.
    """

    __slots__ = (
        "_arguments",
        "_caps",
        "_solver",
        "_tolerance",
        "_warm",
        "box_lower",
        "box_upper",
        "gradient",
        "hessian",
        "iterations",
        "rows",
        "rows_upper",
        "solution",
    )

    def __init__(self, *, variables: int, rows: int, tolerance: float, iterations: int, inner_iterations: int) -> None:
        """Allocate a programme.

        Args:
            variables: Number m of unknowns.
            rows: Number r of general constraints, may be 0.
            tolerance: Absolute tolerance on the optimality conditions.
            iterations: Cap of the outer iterations.
            inner_iterations: Cap of the inner iterations per outer one.
        """
        self.hessian: _Array = np.zeros((variables, variables))
        self.gradient: _Array = np.zeros(variables)
        self.rows: _Array = np.zeros((rows, variables))
        self.rows_upper: _Array = np.zeros(rows)
        self.box_lower: _Array = np.full(variables, -UNBOUNDED)
        self.box_upper: _Array = np.full(variables, UNBOUNDED)
        self.solution: _Array = np.zeros(variables)
        self.iterations = 0
        self._tolerance = tolerance
        self._caps = (iterations, inner_iterations)
        self._arguments: dict[str, _Array] = {
            "H": self.hessian,
            "g": self.gradient,
            "l_box": self.box_lower,
            "u_box": self.box_upper,
        }
        if rows:
            self._arguments["C"] = self.rows
            self._arguments["u"] = self.rows_upper
        self._solver: proxqp.dense.QP | None = None
        self._warm = False

    def reset(self) -> None:
        """Forget the warm start and the scaling; the next problem is solved by a fresh solver."""
        self._solver = None
        self._warm = False
        self.iterations = 0
        self.solution[:] = 0.0

    def solve(self) -> ControlStatus:
        """Solve the programme that the arrays hold, warm-started from the one before.

        Returns:
            SOLVED, and then `solution` is new, or why not; `solution` is then unchanged.
        """
        solver = self._solver
        if solver is None:
            solver = self._start()
        else:
            solver.update(**self._arguments)
        solver.solve()
        results = solver.results
        info = results.info
        self.iterations = info.iter
        status = info.status
        if status == proxqp.PROXQP_SOLVED:
            self.solution[:] = results.x  # a copy: results.x is a view of what the solver works on
            if not self._warm:
                # Only after a success: there must be a result, and a failed run leaves none worth starting from.
                solver.settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
                self._warm = True
            return ControlStatus.SOLVED
        solver.settings.initial_guess = proxqp.InitialGuess.NO_INITIAL_GUESS
        self._warm = False
        if status == proxqp.PROXQP_MAX_ITER_REACHED:
            return ControlStatus.ITERATION_LIMIT
        return ControlStatus.SOLVER_FAILED

    def objective(self) -> float:
        """Objective of the last solved problem at its solution."""
        z = self.solution
        return float(0.5 * z @ self.hessian @ z + self.gradient @ z)

    def _start(self) -> proxqp.dense.QP:
        variables = self.gradient.shape[0]
        rows = self.rows_upper.shape[0]
        solver = proxqp.dense.QP(
            variables, 0, rows, True, proxqp.dense.HessianType.Dense, proxqp.dense.DenseBackend.PrimalDualLDLT
        )
        settings = solver.settings
        settings.eps_abs = self._tolerance
        settings.eps_rel = 0.0
        settings.eps_primal_inf = 0.0
        settings.max_iter, settings.max_iter_in = self._caps
        settings.initial_guess = proxqp.InitialGuess.NO_INITIAL_GUESS
        solver.init(**self._arguments)
        self._solver = solver
        return solver
