"""The one-parameter family of equilibria on a slope, sampled over thrust, and the search for its best member."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.reduced.equilibrium import BRANCHES, EquilibriumLoads, equilibrium_loads, equilibrium_pitches
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.trim_limits import TrimLimits, TrimMargins, trim_margins

__all__ = ["BestMember", "TrimFamily", "refine", "sweep"]

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


@dataclass(frozen=True, slots=True)
class BestMember:
    """A member of the family.

    Attributes:
        thrust: [N].
        pitch: [rad].
        branch: "upright" or "hanging".
        margins: Distance to the limits.
        friction_needed: |f_x| / f_n.
    """

    thrust: float
    pitch: float
    branch: str
    margins: TrimMargins
    friction_needed: float

    @property
    def within_limits(self) -> bool:
        """Whether every margin is positive or zero."""
        return bool(self.margins.satisfied)


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
        points: Samples of the thrust.

    Returns:
        The family.
    """
    thrusts = np.linspace(thrust_range[0], thrust_range[1], points)
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
) -> BestMember | None:
    """Find the cheapest member, by sampling ever more finely around the best sample.

    Args:
        parameters: The pendulum.
        family: A first sweep.
        limits: Limits that the margins refer to.
        cost: Maps a family to a cost per member, shape (2, n); infinite or NaN for members that are not allowed.

    Returns:
        The cheapest member, its thrust to about 1e-12 of the range; None if none is allowed.
    """
    current = family
    costs = _finite_or_infinite(cost(current))
    if not np.isfinite(costs).any():
        return None
    branch, index = (int(i) for i in np.unravel_index(int(np.argmin(costs)), costs.shape))
    for _ in range(_REFINE_ROUNDS):
        last = current.thrust.shape[1] - 1
        stretch = (
            float(current.thrust[branch, max(index - 1, 0)]),
            float(current.thrust[branch, min(index + 1, last)]),
        )
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
        if finer_costs[finer_index] > costs[branch, index]:
            break
        current, index = finer, finer_index
        costs = np.full(finer.thrust.shape, np.inf)
        costs[branch] = finer_costs
    return BestMember(
        thrust=float(current.thrust[branch, index]),
        pitch=float(current.pitch[branch, index]),
        branch=BRANCHES[branch],
        margins=TrimMargins(*(float(np.asarray(margin)[branch, index]) for margin in current.margins)),
        friction_needed=float(current.loads.friction_needed[branch, index]),
    )


def _violation(parameters: MipParameters, limits: TrimLimits, margins: TrimMargins) -> _Array:
    total = np.zeros(np.shape(margins.friction))
    for margin, scale in zip(margins, margin_scales(parameters, limits), strict=True):
        # Where the ground would have to pull, the friction needed is infinite: capped, so that the rest still counts.
        total = total + np.clip(-np.asarray(margin, dtype=float) / scale, 0.0, _WORST_VIOLATION)
    return np.where(np.isnan(total), np.inf, total)


def _finite_or_infinite(costs: _Array) -> _Array:
    return np.where(np.isnan(costs), np.inf, costs)
