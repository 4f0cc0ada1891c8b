"""The one-parameter family of equilibria on a slope, sampled over thrust, and the search for its best member."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.reduced.equilibrium import BRANCHES, EquilibriumLoads, equilibrium_loads, equilibrium_pitches
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.trim_limits import TrimLimits, TrimMargins, trim_margins
from m4_dynamics.reduced.trim_point import Trim, make_trim

__all__ = ["TrimFamily", "margin_scales", "refine", "refine_everywhere", "sweep"]

_Array = NDArray[np.float64]

_SWEEP_POINTS = 801
_REFINE_POINTS = 41
_REFINE_ROUNDS = 8
_WORST_VIOLATION = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class TrimFamily:
    """Equilibria over a range of thrust; every array has shape (2, n): branch, thrust.

    Attributes:
        slope: Inclination of the ground [rad].
        speed: Climbing speed [m/s].
        acceleration: Along the slope [m/s^2].
        thrust: [N].
        pitch: [rad]; NaN where no equilibrium exists.
        loads: What the equilibria ask for.
        margins: Distance to the limits; NaN where no equilibrium exists.
        violation: Sum of the missed margins, each over its natural scale; 0 inside, infinite without equilibrium.
    """

    slope: float
    speed: float
    acceleration: float
    thrust: _Array
    pitch: _Array
    loads: EquilibriumLoads
    margins: TrimMargins
    violation: _Array


def sweep(
    parameters: MipParameters,
    slope: float,
    limits: TrimLimits,
    thrust_range: tuple[float, float],
    *,
    speed: float = 0.0,
    acceleration: float = 0.0,
    points: int = _SWEEP_POINTS,
) -> TrimFamily:
    """Sample both branches over a range of thrust.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        limits: Limits that the margins refer to.
        thrust_range: First and last thrust [N].
        speed: Climbing speed [m/s].
        acceleration: Along the slope [m/s^2].
        points: Samples of the thrust; only one if the range is a single value.

    Returns:
        The family.
    """
    thrusts = np.unique(np.linspace(thrust_range[0], thrust_range[1], points))
    pitch = equilibrium_pitches(parameters, slope, thrusts, acceleration=acceleration)
    thrust = np.broadcast_to(thrusts, pitch.shape)
    loads = equilibrium_loads(parameters, slope, thrust, pitch, speed=speed, acceleration=acceleration)
    margins = trim_margins(limits, slope, thrust, pitch, loads, parameters.wheel_radius)
    return TrimFamily(
        slope, speed, acceleration, thrust, pitch, loads, margins, _violation(parameters, limits, margins)
    )


def margin_scales(parameters: MipParameters, limits: TrimLimits) -> TrimMargins:
    """Natural size of every margin, to compare violations of unlike limits."""
    thrust_scale = max(limits.thrust_range[1], 0.1 * parameters.weight)
    return TrimMargins(
        limits.friction_static, parameters.weight, thrust_scale, limits.duty_max, parameters.wheel_radius, 1.0
    )


def refine(
    parameters: MipParameters, family: TrimFamily, limits: TrimLimits, cost: Callable[[TrimFamily], _Array]
) -> Trim | None:
    """Find the cheapest member, by sampling ever more finely around the best sample.

    Args:
        parameters: The pendulum.
        family: A first sweep.
        limits: Limits that the margins refer to.
        cost: Maps a family to a cost per member, shape (2, n); infinite or NaN for members that are not allowed.

    Returns:
        The cheapest member, its thrust to about 1e-12 of the range; None if none is allowed.
    """
    costs = _finite_or_infinite(cost(family))
    if not np.isfinite(costs).any():
        return None
    branch, index = np.unravel_index(int(np.argmin(costs)), costs.shape)
    return _refine_at(parameters, family, limits, cost, costs, int(branch), int(index))[0]


def refine_everywhere(
    parameters: MipParameters, family: TrimFamily, limits: TrimLimits, cost: Callable[[TrimFamily], _Array]
) -> Trim | None:
    """Like `refine`, but around every local minimum of the samples; slower, and it misses less."""
    costs = _finite_or_infinite(cost(family))
    padded = np.pad(costs, ((0, 0), (1, 1)), constant_values=np.inf)
    # Of a plateau only the first sample counts.
    starts = np.isfinite(costs) & (costs < padded[:, :-2]) & (costs <= padded[:, 2:])
    found = [
        _refine_at(parameters, family, limits, cost, costs, int(branch), int(index))
        for branch, index in np.argwhere(starts)
    ]
    return min(found, key=lambda trim_and_cost: trim_and_cost[1])[0] if found else None


def _refine_at(
    parameters: MipParameters,
    family: TrimFamily,
    limits: TrimLimits,
    cost: Callable[[TrimFamily], _Array],
    costs: _Array,
    branch: int,
    index: int,
) -> tuple[Trim, float]:
    """Refine around one sample of one branch; returns the member and its cost."""
    current, best_cost = family, float(costs[branch, index])
    for _ in range(_REFINE_ROUNDS):
        thrusts = current.thrust[branch]
        stretch = (float(thrusts[max(index - 1, 0)]), float(thrusts[min(index + 1, len(thrusts) - 1)]))
        finer = sweep(
            parameters,
            family.slope,
            limits,
            stretch,
            speed=family.speed,
            acceleration=family.acceleration,
            points=_REFINE_POINTS,
        )
        finer_costs = _finite_or_infinite(cost(finer))[branch]
        finer_index = int(np.argmin(finer_costs))
        if finer_costs[finer_index] > best_cost:
            break
        current, index, best_cost = finer, finer_index, float(finer_costs[finer_index])
    thrust, pitch = float(current.thrust[branch, index]), float(current.pitch[branch, index])
    member = make_trim(
        parameters, family.slope, thrust, pitch, BRANCHES[branch], family.speed, family.acceleration, limits
    )
    return member, best_cost


def _violation(parameters: MipParameters, limits: TrimLimits, margins: TrimMargins) -> _Array:
    total = np.zeros(np.shape(margins.friction))
    for margin, scale in zip(margins, margin_scales(parameters, limits), strict=True):
        # Where the ground would have to pull, the friction needed is infinite: capped, so that the rest still counts.
        total = total + np.clip(-np.asarray(margin, dtype=float) / scale, 0.0, _WORST_VIOLATION)
    return np.where(np.isnan(total), np.inf, total)


def _finite_or_infinite(costs: _Array) -> _Array:
    return np.where(np.isnan(costs), np.inf, costs)
