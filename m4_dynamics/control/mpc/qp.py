"""The quadratic programme of one control step, and ProxQP behind a guard."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from proxsuite import proxqp

from m4_dynamics.control.controller import ControlStatus
from m4_dynamics.control.mpc.kernels import UNBOUNDED, solve_unconstrained

__all__ = ["QuadraticProgramme"]

_Array = NDArray[np.float64]

_COLD = proxqp.InitialGuess.NO_INITIAL_GUESS
_WARM = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT


class QuadraticProgramme:
    """min 1/2 z' H z + g' z  subject to  C z <= rows_upper,  lower <= z <= upper.

    The arrays are filled in place by `kernels.condense`. `solve` first tries the unconstrained optimum, which is the
    solution whenever it satisfies the constraints: near the reference, most of the time. Otherwise it hands the arrays
    to one ProxQP object that lives until it fails, because a new object or a new preconditioner costs several times the
    solution.

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
        iterations: ProxQP's inner iterations in the last call of `solve`, 0 if no constraint was active.
    """

    __slots__ = (
        "_arguments",
        "_candidate",
        "_caps",
        "_factor",
        "_free",
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

    def __init__(
        self, *, variables: int, slacks: int, rows: int, tolerance: float, iterations: int, inner_iterations: int
    ) -> None:
        """Allocate a programme.

        Args:
            variables: Number m of unknowns.
            slacks: How many of them, the last ones, are slacks: not below zero, costed from there on, and coupled with
                the others by the rows only.
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
        self._free = variables - slacks
        self._factor: _Array = np.zeros((variables, variables))
        self._candidate: _Array = np.zeros(variables)
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
        if solve_unconstrained(
            self.hessian,
            self.gradient,
            self.rows,
            self.rows_upper,
            self.box_lower,
            self.box_upper,
            self._free,
            self._factor,
            self._candidate,
        ):
            self.solution[:] = self._candidate
            self.iterations = 0
            self._warm = False
            return ControlStatus.SOLVED
        self.iterations = 0
        status = ControlStatus.SOLVER_FAILED
        if self._solver is not None:
            self._solver.update(**self._arguments)
            # An active set older than the last problem's is a worse start than none.
            self._solver.settings.initial_guess = _WARM if self._warm else _COLD
            status = self._run(self._solver)
        if status != ControlStatus.SOLVED:
            # A warm start is twice as fast where the active set stays, but after a jump of the state it can run away,
            # and what it leaves in the object spoils the next run: only a fresh one is a second chance.
            status = self._run(self._start())
        self._warm = status == ControlStatus.SOLVED
        return status

    def _run(self, solver: proxqp.dense.QP) -> ControlStatus:
        """Let ProxQP solve what it was given, copy the solution, and translate its verdict."""
        solver.solve()
        results = solver.results
        self.iterations += results.info.iter
        status = results.info.status
        if status == proxqp.PROXQP_SOLVED:
            self.solution[:] = results.x  # a copy: results.x is a view of what the solver works on
            return ControlStatus.SOLVED
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
        # Cold: warm-starting an object that has never solved anything crashes the interpreter.
        settings.initial_guess = _COLD
        solver.init(**self._arguments)
        self._solver = solver
        return solver
