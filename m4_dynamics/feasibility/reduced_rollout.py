"""A climb on the reduced model: the controller on its own model, which cannot slide but says when it would."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.controller import BalanceController
from m4_dynamics.control.reference import ReferenceTrajectory
from m4_dynamics.reduced import kernels
from m4_dynamics.reduced.reduction import Reduction
from m4_dynamics.reduced.trim_limits import ground_clearance
from m4_dynamics.simulation.climb import FALL_ANGLE
from m4_dynamics.simulation.verdict import SHORTFALL_ALLOWED, SLIP_GRACE, SLIP_TIME_ALLOWED, Verdict

__all__ = ["ReducedRun", "came_down", "grip_missing", "judge_reduced", "run_reduced"]

_Array = NDArray[np.float64]

#: Runge-Kutta steps in a control period; the plant's own step is as long.
_SUBSTEPS = 5


class ReducedRun(NamedTuple):
    """Samples of a rollout, n of them.

    Attributes:
        time: [s], shape (n,).
        state: Shape (n, 4).
        inputs: Shape (n, 2).
        ground_force: (f_x, f_n) that rolling without sliding needs, shape (n, 2) [N].
        fallbacks: Control steps answered by the fallback.
        fell_at: When the pitch left its reference by too much, or NaN [s].
    """

    time: _Array
    state: _Array
    inputs: _Array
    ground_force: _Array
    fallbacks: int
    fell_at: float


def run_reduced(
    reduction: Reduction,
    reference: ReferenceTrajectory,
    controller: BalanceController,
    *,
    pitch_error: float = 0.0,
    pitch_rate: float = 0.0,
    wheel_rate: float = 0.0,
) -> ReducedRun:
    """Close the loop on the reduced model.

    Args:
        reduction: The robot as a pendulum.
        reference: What the controller follows.
        controller: The controller.
        pitch_error: Initial pitch less the reference's [rad].
        pitch_rate: Initial pitch rate less the reference's [rad/s].
        wheel_rate: Initial wheel rate less the reference's [rad/s].

    Returns:
        The samples, up to the end of the reference or to the fall.
    """
    p = reduction.parameters.as_array()
    slope, period, count = float(reference.slope[0]), reference.time_step, len(reference)
    states, inputs, forces = np.zeros((count, 4)), np.zeros((count, 2)), np.zeros((count, 2))
    state = reference.state[0] + np.array([0.0, pitch_error, wheel_rate, pitch_rate])
    controller.reset()
    fallbacks, fell_at, done = 0, math.nan, count
    for k in range(count):
        states[k] = state
        if not abs(state[1] - reference.state[k, 1]) <= FALL_ANGLE:
            fell_at, done = k * period, k
            break
        u = controller.control(k, state)
        fallbacks += controller.diagnostics.fallback
        inputs[k] = u
        kernels.ground_force(p, slope, state, u, forces[k])
        kernels.mip_step(p, slope, state, u, period, _SUBSTEPS, state)
    return ReducedRun(reference.time[:done], states[:done], inputs[:done], forces[:done], fallbacks, fell_at)


def grip_missing(run: ReducedRun, friction: float) -> NDArray[np.bool_]:
    """Samples at which rolling needs more grip than there is, or a pull of the ground, shape (n,)."""
    along, normal = np.abs(run.ground_force[:, 0]), run.ground_force[:, 1]
    return np.asarray(along > friction * np.maximum(normal, 0.0))


def came_down(run: ReducedRun, reduction: Reduction, slope: float) -> bool:
    """Whether the pitch left its reference by too much, or the body touched the ground."""
    radius = reduction.parameters.wheel_radius
    clearance = ground_clearance(slope, run.state[:, 1], reduction.outline_in_body, radius)
    return math.isfinite(run.fell_at) or bool((clearance < 0.0).any())


def judge_reduced(
    run: ReducedRun, reduction: Reduction, reference: ReferenceTrajectory, friction: float
) -> tuple[Verdict, float]:
    """Judge a rollout by the rules of the full model, as far as they apply.

    Args:
        run: The rollout.
        reduction: The robot as a pendulum.
        reference: What it followed.
        friction: mu_s.

    Returns:
        The verdict, and the time after the first half second that rolling needed more grip than there is [s].
    """
    after_grace = run.time >= SLIP_GRACE
    slip_time = float(np.count_nonzero(grip_missing(run, friction)[after_grace]) * reference.time_step)
    radius = reduction.parameters.wheel_radius
    if came_down(run, reduction, float(reference.slope[0])):
        return Verdict.FELL, slip_time
    if slip_time > SLIP_TIME_ALLOWED:
        return Verdict.SLIPPED, slip_time
    goal, climbed = radius * reference.state[-1, 0], radius * run.state[-1, 0]
    if abs(goal - climbed) > SHORTFALL_ALLOWED * max(abs(goal), 1.0):
        return Verdict.LAGGED, slip_time
    return Verdict.CLIMBED, slip_time
