"""Why no equilibrium satisfies the limits: which limit forbids it, and by how much."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.errors import NoTrimExists
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.trim_family import TrimFamily, margin_scales, refine, sweep
from m4_dynamics.reduced.trim_limits import TrimLimits
from m4_dynamics.reduced.trim_point import Trim

__all__ = ["explain_member", "explain_refusal"]

_Array = NDArray[np.float64]

#: The limits, in the order in which they are blamed.
_ORDER_OF_BLAME = ("friction", "thrust", "duty", "normal_force", "clearance", "pitch_window")

#: How far beyond the thrusters' maximum to look for the thrust that would be needed.
_THRUST_SEARCH_FACTOR = 4.0


def explain_refusal(
    parameters: MipParameters,
    slope: float,
    limits: TrimLimits,
    speed: float,
    acceleration: float,
    *,
    thrust: float | None = None,
) -> NoTrimExists:
    """Build the error for a slope without a trim; the caller raises it.

    A limit is named alone if dropping it alone would give an equilibrium; the margin quoted is the smallest with which
    it is missed. If several must give way together, all that the nearest equilibrium misses are named.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        limits: The limits.
        speed: Climbing speed [m/s].
        acceleration: Along the slope [m/s^2].
        thrust: The thrust, if it was given; None means that it was free.

    Returns:
        The error.
    """
    where = _where(slope, speed, acceleration, thrust)
    if thrust is None:
        reach = max(_THRUST_SEARCH_FACTOR * limits.thrust_range[1], 2.0 * parameters.weight)
        thrust_span = (limits.thrust_range[0], reach if limits.thrust_range[1] > 0.0 else limits.thrust_range[1])
    else:
        thrust_span = (thrust, thrust)
    family = sweep(parameters, slope, limits, thrust_span, speed=speed, acceleration=acceleration, points=1601)
    if not np.isfinite(family.pitch).any():
        return NoTrimExists(f"{where}: no pitch balances the robot; wheels and thrust cannot hold it", "equilibrium")

    alone = []
    for name in _ORDER_OF_BLAME:
        best = refine(parameters, family, limits, _CostOfDropping(name))
        if best is not None and getattr(best.margins, name) < 0.0:
            alone.append((name, best))
    if alone:
        reasons = "; or ".join(_reason(name, best, limits) for name, best in alone)
        return NoTrimExists(f"{where}: {reasons}", alone[0][0])

    nearest = refine(parameters, family, limits, lambda members: members.violation)
    if nearest is None:
        return NoTrimExists(f"{where}: no pitch balances the robot; wheels and thrust cannot hold it", "equilibrium")
    missed = _missed_limits(nearest)
    if not missed:
        return NoTrimExists(
            f"{where}: the limits leave too narrow a stretch of thrust around {nearest.thrust:.6f} N", "thrust"
        )
    reasons = " and ".join(_reason(name, nearest, limits) for name in missed)
    worst = _worst_limit(parameters, missed, nearest, limits)
    return NoTrimExists(f"{where}: no single limit is to blame; the nearest equilibrium misses {reasons}", worst)


def explain_member(member: Trim, limits: TrimLimits) -> NoTrimExists:
    """Build the error for one equilibrium that misses its limits; the caller raises it.

    Args:
        member: The equilibrium.
        limits: The limits.

    Returns:
        The error, which names every limit missed.
    """
    missed = _missed_limits(member)
    where = _where(member.slope, member.speed, member.acceleration, None)
    reasons = " and ".join(_reason(name, member, limits) for name in missed)
    return NoTrimExists(f"{where} at {math.degrees(member.pitch):.1f} deg of pitch: {reasons}", missed[0])


def _missed_limits(member: Trim) -> list[str]:
    missed = [name for name in _ORDER_OF_BLAME if getattr(member.margins, name) < -1e-9]
    if "normal_force" in missed and math.isinf(member.friction_needed):
        missed.remove("friction")  # the ground would have to pull, which is what the normal force says
    return missed


def _worst_limit(parameters: MipParameters, missed: list[str], member: Trim, limits: TrimLimits) -> str:
    scales = margin_scales(parameters, limits)
    return max(missed, key=lambda name: -float(getattr(member.margins, name)) / float(getattr(scales, name)))


class _CostOfDropping:
    """Cost of a member if one limit did not count: how far it misses that one, provided that it keeps the others."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __call__(self, family: TrimFamily) -> _Array:
        others = [np.asarray(m) for n, m in zip(family.margins._fields, family.margins, strict=True) if n != self.name]
        kept = np.min(np.stack(others), axis=0) >= 0.0
        missed = -np.asarray(getattr(family.margins, self.name), dtype=float)
        return np.where(kept & np.isfinite(missed), missed, np.inf)


def _where(slope: float, speed: float, acceleration: float, thrust: float | None) -> str:
    text = f"no trim on a slope of {math.degrees(slope):.1f} deg"
    if speed != 0.0:
        text += f" at {speed:g} m/s"
    if acceleration != 0.0:
        text += f" and {acceleration:g} m/s^2"
    if thrust is not None:
        text += f" with {thrust:.1f} N of thrust"
    return text


def _reason(name: str, member: Trim, limits: TrimLimits) -> str:
    missing = -float(getattr(member.margins, name))
    at = f"at {member.thrust:.1f} N and {math.degrees(member.pitch):.1f} deg of pitch"
    if name == "friction":
        return (
            f"friction: a coefficient of {member.friction_needed:.2f} is needed {at}, "
            f"{limits.friction_static:.2f} is there ({missing:.2f} short)"
        )
    if name == "thrust":
        low, high = limits.thrust_range
        return f"thrust: {member.thrust:.1f} N is needed, {low:g} to {high:g} N is there ({missing:.1f} N outside)"
    if name == "duty":
        return (
            f"duty: {limits.duty_max + missing:.2f} is needed {at}, {limits.duty_max:g} is there ({missing:.2f} short)"
        )
    if name == "normal_force":
        force = limits.normal_force_min - missing
        return f"normal force: {force:.1f} N {at}, {limits.normal_force_min:g} N is the least ({missing:.1f} N short)"
    if name == "clearance":
        height = 1e3 * (limits.clearance_min - missing)
        return (
            f"ground clearance: the body is {height:.0f} mm above the slope {at}, "
            f"{1e3 * limits.clearance_min:.0f} mm is the least ({1e3 * missing:.0f} mm short)"
        )
    low, high = (math.degrees(edge) for edge in limits.pitch_window)
    return (
        f"pitch window: the body leans beyond {low:.0f} to {high:.0f} deg from the slope normal {at} "
        f"({math.degrees(missing):.1f} deg outside)"
    )
