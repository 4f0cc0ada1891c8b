"""Compiled inner loops of the MPC: plain arrays in, results written in place.

The plan is condensed (single shooting): states are eliminated, the unknowns are the changes d of the inputs, in units
of half an input's range, and one slack s shared by all ground constraints. With du = scale * d and
dx_{k+1} = A_k dx_k + B_k du_k, the quadratic programme is

    min  1/2 z' H z + g' z,   z = (d_0, ..., d_{n-1}, s / slack_scale)
    s.t. C z <= rows_upper,   lower <= z <= upper

whose objective is the cost's change, without factors left out. There are nx = 4 states, or 5 where the thrust lags
behind its command and is the last one. All kernels that call each other live in this one file, because Numba's cache
does not notice a change in a callee of another file.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "COST_PAPER",
    "COST_TERMINAL",
    "FRICTION",
    "INPUT_SCALE",
    "INPUT_WEIGHTS",
    "LOWER",
    "NORMAL_MIN",
    "OUTCOME_COUNT",
    "SLACK",
    "SLACK_CURVATURE",
    "SLACK_SCALE",
    "SLACK_WEIGHT",
    "STATE_WEIGHTS",
    "STEP_SIZE",
    "UNBOUNDED",
    "UPPER",
    "WEIGHT_COUNT",
    "all_finite",
    "condense",
    "evaluate",
    "read_out",
    "solve_unconstrained",
]

# Layout of the vector of weights and limits.
STATE_WEIGHTS = 0  # 5 entries; the last one is that of the thrust, where it is a state
INPUT_WEIGHTS = 5  # 2 entries
INPUT_SCALE = 7  # 2 entries
LOWER = 9  # 2 entries
UPPER = 11  # 2 entries
FRICTION = 13
NORMAL_MIN = 14
SLACK_SCALE = 15
SLACK_WEIGHT = 16
SLACK_CURVATURE = 17
WEIGHT_COUNT = 18

# Layout of the vector that `read_out` and `evaluate` fill.
COST_PAPER = 0
COST_TERMINAL = 1
SLACK = 2
STEP_SIZE = 3
OUTCOME_COUNT = 4

#: What ProxQP takes for "no bound".
UNBOUNDED = 1e20

_Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def all_finite(values: _Array) -> bool:
    """Whether a vector, shape (n,), holds neither NaN nor infinity."""
    total = 0.0
    for i in range(values.shape[0]):
        total += values[i] * 0.0
    return total == 0.0


@njit(cache=True, error_model="numpy")
def condense(
    a: _Array,
    b: _Array,
    states: _Array,
    inputs: _Array,
    force: _Array,
    force_x: _Array,
    force_u: _Array,
    state_reference: _Array,
    input_reference: _Array,
    weights: _Array,
    terminal: _Array,
    hessian: _Array,
    gradient: _Array,
    rows: _Array,
    rows_upper: _Array,
    box_lower: _Array,
    box_upper: _Array,
) -> bool:
    """Write the quadratic programme of one linearisation (paper, eq. mpc_formulation) in place.

    Args:
        a: d x_{k+1} / d x_k, shape (n, nx, nx).
        b: d x_{k+1} / d u_k, shape (n, nx, 2).
        states: The nominal x_0 .. x_n, shape (n + 1, nx).
        inputs: The nominal u_0 .. u_{n-1}, shape (n, 2).
        force: (f_x, f_n) at (x_k, u_k), shape (n, 2) [N].
        force_x: Its derivative with respect to x_k, shape (n, 2, nx).
        force_u: Its derivative with respect to u_k, shape (n, 2, 2).
        state_reference: Reference of x_1 .. x_n, shape (n, nx).
        input_reference: What the input cost is measured from, shape (n, 2).
        weights: Weights and limits, see the layout.
        terminal: Weight of the last error, shape (nx, nx), symmetric.
        hessian: Out: H, shape (m, m) with m = 2 n, or 2 n + 1 with ground constraints.
        gradient: Out: g, shape (m,).
        rows: Out: C, shape (3 n, m), or (0, m) without ground constraints. Only its non-zero entries are written.
        rows_upper: Out: upper bounds of C z, shape (3 n,).
        box_lower: Out: lower bounds of z, shape (m,).
        box_upper: Out: upper bounds of z, shape (m,).

    Returns:
        Whether the programme holds finite numbers only.
    """
    # The number of states as a constant lets the compiler unroll the innermost loops: half the time.
    if states.shape[1] == 4:
        return _condense(
            4,
            a,
            b,
            states,
            inputs,
            force,
            force_x,
            force_u,
            state_reference,
            input_reference,
            weights,
            terminal,
            hessian,
            gradient,
            rows,
            rows_upper,
            box_lower,
            box_upper,
        )
    return _condense(
        5,
        a,
        b,
        states,
        inputs,
        force,
        force_x,
        force_u,
        state_reference,
        input_reference,
        weights,
        terminal,
        hessian,
        gradient,
        rows,
        rows_upper,
        box_lower,
        box_upper,
    )


@njit(cache=True, error_model="numpy", inline="always")
def _condense(
    nx: int,
    a: _Array,
    b: _Array,
    states: _Array,
    inputs: _Array,
    force: _Array,
    force_x: _Array,
    force_u: _Array,
    state_reference: _Array,
    input_reference: _Array,
    weights: _Array,
    terminal: _Array,
    hessian: _Array,
    gradient: _Array,
    rows: _Array,
    rows_upper: _Array,
    box_lower: _Array,
    box_upper: _Array,
) -> bool:
    """`condense` for nx states."""
    n = inputs.shape[0]
    constrained = rows.shape[0] > 0
    friction = weights[FRICTION]
    effect = np.empty((n + 1, nx, 2))  # d x_k / d d_j for the j at hand
    adjoint = np.empty((nx, 2))
    adjoint_next = np.empty((nx, 2))
    check = 0.0

    # Gradient by the adjoint recursion: costate = d J / d x_{k+1} (half of it).
    costate = np.empty(nx)
    costate_next = np.empty(nx)
    for i in range(nx):
        costate[i] = 0.0
        for j in range(nx):
            costate[i] += terminal[i, j] * (states[n, j] - state_reference[n - 1, j])
    for k in range(n - 1, -1, -1):
        for c in range(2):
            scale = weights[INPUT_SCALE + c]
            total = weights[INPUT_WEIGHTS + c] * (inputs[k, c] - input_reference[k, c])
            for i in range(nx):
                total += b[k, i, c] * costate[i]
            gradient[2 * k + c] = 2.0 * scale * total
            check += gradient[2 * k + c] * 0.0
            box_lower[2 * k + c] = (weights[LOWER + c] - inputs[k, c]) / scale
            box_upper[2 * k + c] = (weights[UPPER + c] - inputs[k, c]) / scale
        if k > 0:
            for i in range(nx):
                costate_next[i] = weights[STATE_WEIGHTS + i] * (states[k, i] - state_reference[k - 1, i])
                for j in range(nx):
                    costate_next[i] += a[k, j, i] * costate[j]
            for i in range(nx):
                costate[i] = costate_next[i]

    # Hessian and rows, one column block (input j) at a time: forward for the effect on the states, backward for H.
    for j in range(n):
        for c in range(2):
            scale = weights[INPUT_SCALE + c]
            for i in range(nx):
                effect[j + 1, i, c] = b[j, i, c] * scale
            if constrained:
                _constrain(rows, j, 2 * j + c, force_u[j, 0, c] * scale, force_u[j, 1, c] * scale, friction)
        for k in range(j + 1, n):
            for c in range(2):
                for i in range(nx):
                    total = 0.0
                    for h in range(nx):
                        total += a[k, i, h] * effect[k, h, c]
                    effect[k + 1, i, c] = total
                if constrained:
                    friction_force = 0.0
                    normal_force = 0.0
                    for i in range(nx):
                        friction_force += force_x[k, 0, i] * effect[k, i, c]
                        normal_force += force_x[k, 1, i] * effect[k, i, c]
                    _constrain(rows, k, 2 * j + c, friction_force, normal_force, friction)
        for c in range(2):
            for i in range(nx):
                total = 0.0
                for h in range(nx):
                    total += terminal[i, h] * effect[n, h, c]
                adjoint[i, c] = total
        for k in range(n - 1, j - 1, -1):
            for r in range(2):
                scale = 2.0 * weights[INPUT_SCALE + r]
                for c in range(2):
                    total = 0.0
                    for h in range(nx):
                        total += b[k, h, r] * adjoint[h, c]
                    value = scale * total
                    if k == j and r == c:
                        value += scale * weights[INPUT_WEIGHTS + r] * weights[INPUT_SCALE + r]
                    hessian[2 * k + r, 2 * j + c] = value
                    hessian[2 * j + c, 2 * k + r] = value
                    check += value * 0.0
            if k > j:
                for c in range(2):
                    for i in range(nx):
                        total = weights[STATE_WEIGHTS + i] * effect[k, i, c]
                        for h in range(nx):
                            total += a[k, h, i] * adjoint[h, c]
                        adjoint_next[i, c] = total
                for c in range(2):
                    for i in range(nx):
                        adjoint[i, c] = adjoint_next[i, c]

    if constrained:
        last = 2 * n
        scale = weights[SLACK_SCALE]
        hessian[last, last] = 2.0 * weights[SLACK_CURVATURE] * scale * scale
        gradient[last] = weights[SLACK_WEIGHT] * scale
        box_lower[last] = 0.0
        box_upper[last] = UNBOUNDED
        for k in range(n):
            rows_upper[3 * k] = friction * force[k, 1] - force[k, 0]
            rows_upper[3 * k + 1] = friction * force[k, 1] + force[k, 0]
            rows_upper[3 * k + 2] = force[k, 1] - weights[NORMAL_MIN]
            for i in range(3):
                rows[3 * k + i, last] = -scale
                check += rows_upper[3 * k + i] * 0.0
    return check == 0.0


@njit(cache=True, error_model="numpy", inline="always")
def _constrain(rows: _Array, stage: int, column: int, friction_force: float, normal_force: float, mu: float) -> None:
    """Write one column of a stage's rows: f_x - mu f_n, -f_x - mu f_n and -f_n (paper, eq. ground_constraint)."""
    rows[3 * stage, column] = friction_force - mu * normal_force
    rows[3 * stage + 1, column] = -friction_force - mu * normal_force
    rows[3 * stage + 2, column] = -normal_force


@njit(cache=True, error_model="numpy")
def solve_unconstrained(
    hessian: _Array,
    gradient: _Array,
    rows: _Array,
    rows_upper: _Array,
    box_lower: _Array,
    box_upper: _Array,
    free: int,
    factor: _Array,
    solution: _Array,
) -> bool:
    """Solve the programme as if nothing constrained it, and see whether that is its solution.

    If the unconstrained optimum satisfies every constraint, it is the optimum. Unknowns from `free` on (the slack) are
    taken as zero: their cost rises from there, so without active rows they stay at their lower bound.

    Args:
        hessian: H, shape (m, m).
        gradient: g, shape (m,).
        rows: C, shape (r, m).
        rows_upper: Upper bounds of C z, shape (r,).
        box_lower: Lower bounds of z, shape (m,).
        box_upper: Upper bounds of z, shape (m,).
        free: Number of unknowns that are solved for.
        factor: Work space, shape (m, m).
        solution: Out: z, shape (m,); meaningless if it is not the solution.

    Returns:
        Whether it is the solution.
    """
    # Cholesky factor L with its diagonal inverted, and z = -H^-1 g by two substitutions.
    for i in range(free):
        for j in range(i + 1):
            total = hessian[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if j < i:
                factor[i, j] = total * factor[j, j]
            elif total > 0.0:
                factor[i, i] = 1.0 / math.sqrt(total)
            else:
                return False
    for i in range(free):
        total = -gradient[i]
        for k in range(i):
            total -= factor[i, k] * solution[k]
        solution[i] = total * factor[i, i]
    for i in range(free - 1, -1, -1):
        total = solution[i]
        for k in range(i + 1, free):
            total -= factor[k, i] * solution[k]
        solution[i] = total * factor[i, i]
        if not box_lower[i] <= solution[i] <= box_upper[i]:
            return False
    for i in range(free, gradient.shape[0]):
        solution[i] = 0.0
    for i in range(rows.shape[0]):
        total = 0.0
        for k in range(free):
            total += rows[i, k] * solution[k]
        if total > rows_upper[i]:
            return False
    return True


@njit(cache=True, error_model="numpy")
def read_out(
    solution: _Array,
    a: _Array,
    b: _Array,
    states: _Array,
    inputs: _Array,
    state_reference: _Array,
    input_reference: _Array,
    weights: _Array,
    terminal: _Array,
    states_out: _Array,
    inputs_out: _Array,
    outcome: _Array,
) -> bool:
    """Turn the QP's solution into a plan and its cost, by the linearised model.

    Args:
        solution: z, shape (2 n,) or (2 n + 1,).
        a: As for `condense`.
        b: As for `condense`.
        states: As for `condense`.
        inputs: As for `condense`.
        state_reference: As for `condense`.
        input_reference: As for `condense`.
        weights: As for `condense`.
        terminal: As for `condense`.
        states_out: Out: the predicted states, shape (n + 1, nx).
        inputs_out: Out: the planned inputs within their bounds, shape (n, 2); may be `inputs` itself.
        outcome: Out: costs, slack and step size, see the layout.

    Returns:
        Whether the plan holds finite numbers only.
    """
    n, nx = inputs.shape[0], states.shape[1]
    change = np.zeros(nx)
    change_next = np.empty(nx)
    step = np.empty(2)
    step_size = 0.0
    check = 0.0
    for i in range(nx):
        states_out[0, i] = states[0, i]
    for k in range(n):
        for c in range(2):
            size = abs(solution[2 * k + c])
            step_size = max(step_size, size)
            # The solver meets the bounds to its tolerance; the actuators must get them exactly.
            value = inputs[k, c] + weights[INPUT_SCALE + c] * solution[2 * k + c]
            value = min(max(value, weights[LOWER + c]), weights[UPPER + c])
            step[c] = value - inputs[k, c]
            inputs_out[k, c] = value
        for i in range(nx):
            change_next[i] = b[k, i, 0] * step[0] + b[k, i, 1] * step[1]
            for j in range(nx):
                change_next[i] += a[k, i, j] * change[j]
        for i in range(nx):
            change[i] = change_next[i]
            states_out[k + 1, i] = states[k + 1, i] + change[i]
            check += states_out[k + 1, i] * 0.0
    _costs(states_out, inputs_out, state_reference, input_reference, weights, terminal, outcome)
    outcome[SLACK] = max(solution[2 * n], 0.0) * weights[SLACK_SCALE] if solution.shape[0] > 2 * n else 0.0
    outcome[STEP_SIZE] = step_size
    return check == 0.0


@njit(cache=True, error_model="numpy")
def evaluate(
    states: _Array,
    inputs: _Array,
    force: _Array,
    state_reference: _Array,
    input_reference: _Array,
    weights: _Array,
    terminal: _Array,
    constrained: bool,
    outcome: _Array,
) -> float:
    """Merit of a plan on the nonlinear model: its cost plus the exact penalty of the worst violated ground constraint.

    Args:
        states: x_0 .. x_n of a rollout, shape (n + 1, nx).
        inputs: Its inputs, shape (n, 2).
        force: Its ground forces (f_x, f_n), shape (n, 2) [N].
        state_reference: As for `condense`.
        input_reference: As for `condense`.
        weights: As for `condense`.
        terminal: As for `condense`.
        constrained: Whether ground constraints count.
        outcome: Out: costs and slack, see the layout; the step size stays as it is.

    Returns:
        The merit, NaN or infinite if the rollout diverged.
    """
    _costs(states, inputs, state_reference, input_reference, weights, terminal, outcome)
    slack = 0.0
    if constrained:
        for k in range(inputs.shape[0]):
            slack = max(slack, abs(force[k, 0]) - weights[FRICTION] * force[k, 1])
            slack = max(slack, weights[NORMAL_MIN] - force[k, 1])
    outcome[SLACK] = slack
    return float(outcome[COST_TERMINAL] + slack * (weights[SLACK_WEIGHT] + weights[SLACK_CURVATURE] * slack))


@njit(cache=True, error_model="numpy")
def _costs(
    states: _Array,
    inputs: _Array,
    state_reference: _Array,
    input_reference: _Array,
    weights: _Array,
    terminal: _Array,
    outcome: _Array,
) -> None:
    """Write the paper's J (Q on every error) and the minimised one (its last error weighted with `terminal`)."""
    n, nx = inputs.shape[0], states.shape[1]
    cost = 0.0
    last = 0.0
    for k in range(n):
        last = 0.0
        for i in range(nx):
            error = states[k + 1, i] - state_reference[k, i]
            last += weights[STATE_WEIGHTS + i] * error * error
        cost += last
        for c in range(2):
            effort = inputs[k, c] - input_reference[k, c]
            cost += weights[INPUT_WEIGHTS + c] * effort * effort
    outcome[COST_PAPER] = cost
    cost -= last
    for i in range(nx):
        for j in range(nx):
            error = states[n, i] - state_reference[n - 1, i]
            cost += error * terminal[i, j] * (states[n, j] - state_reference[n - 1, j])
    outcome[COST_TERMINAL] = cost
