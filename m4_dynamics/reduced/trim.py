"""Equilibria on a slope: where the robot stands still or climbs steadily, and which of them to use.

Thrust fixes the pitch, up to two branches, so equilibria form a one-parameter family. More thrust is not always better:
it makes the robot lie back, and a trim on a bound of thrust or duty leaves a controller no authority there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.reduced.equilibrium import equilibrium_loads
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.power import PowerModel, power_needed
from m4_dynamics.reduced.trim_family import TrimFamily, refine, refine_everywhere, sweep
from m4_dynamics.reduced.trim_limits import TrimLimits, TrimMargins, trim_margins
from m4_dynamics.reduced.trim_point import Trim, make_trim, require_finite_case, trim_at_pitch, trim_branches
from m4_dynamics.reduced.trim_refusal import explain_member, explain_refusal

__all__ = [
    "CRITERIA",
    "Criterion",
    "Trim",
    "TrimLimits",
    "TrimMargins",
    "keeps_reserves",
    "select_trim",
    "trim_at_pitch",
    "trim_branches",
]

_Array = NDArray[np.float64]

Criterion = Literal["automatic", "least-friction", "least-thrust", "least-power", "thrust", "pitch"]
CRITERIA: tuple[Criterion, ...] = ("automatic", "least-friction", "least-thrust", "least-power", "thrust", "pitch")


def select_trim(
    parameters: MipParameters,
    slope: float,
    *,
    limits: TrimLimits | None = None,
    criterion: Criterion = "automatic",
    thrust: float | None = None,
    pitch: float | None = None,
    speed: float = 0.0,
    acceleration: float = 0.0,
    power_model: PowerModel | None = None,
) -> Trim:
    """Choose one equilibrium inside the limits.

    Criteria:
        automatic: Least thrust among the members that keep every reserve of the limits, so that a controller has
            authority in both inputs and the friction cone is not touched. If there is none, the member that needs the
            least friction within the hard limits.
        least-friction, least-thrust, least-power: The best member within the hard limits. Power: see `power_needed`.
        thrust, pitch: The member with the given thrust (of two, the one that needs less friction) or pitch.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad], positive uphill.
        limits: What ground, thrusters and motors can do; None takes the defaults.
        criterion: One of `CRITERIA`.
        thrust: Total thrust [N] for the criterion "thrust".
        pitch: theta [rad] for the criterion "pitch".
        speed: Climbing speed [m/s].
        acceleration: Along the slope [m/s^2].
        power_model: Rotor figures for "least-power"; None takes the defaults.

    Returns:
        The chosen equilibrium.

    Raises:
        NoTrimExists: If no member satisfies the limits; the message says which limit forbids it and by how much.
        InvalidSettingError: If the criterion is unknown or its value is missing.
    """
    require_finite_case(slope, speed, acceleration)
    hard = TrimLimits() if limits is None else limits
    if criterion == "thrust":
        if thrust is None:
            raise InvalidSettingError("thrust", thrust, "a thrust [N] with the criterion 'thrust'")
        members = trim_branches(parameters, slope, thrust, speed=speed, acceleration=acceleration, limits=hard)
        allowed = [member for member in members if member.within_limits]
        if allowed:
            return min(allowed, key=lambda member: member.friction_needed)
        raise explain_refusal(parameters, slope, hard, speed, acceleration, thrust=thrust)
    if criterion == "pitch":
        if pitch is None:
            raise InvalidSettingError("pitch", pitch, "a pitch [rad] with the criterion 'pitch'")
        member = trim_at_pitch(parameters, slope, pitch, speed=speed, acceleration=acceleration, limits=hard)
        if member.within_limits:
            return member
        raise explain_member(member, hard)
    if criterion not in CRITERIA:
        raise InvalidSettingError("criterion", criterion, "one of " + ", ".join(CRITERIA))

    power = PowerModel() if power_model is None else power_model

    def friction(family: TrimFamily) -> _Array:
        return family.loads.friction_needed

    def least_thrust(family: TrimFamily) -> _Array:
        return family.thrust

    def least_power(family: TrimFamily) -> _Array:
        wheel_rate = speed / parameters.wheel_radius
        return power_needed(parameters, power, family.thrust, family.loads.torque, wheel_rate)

    attempts: list[tuple[TrimLimits | None, Callable[[TrimFamily], _Array]]]
    if criterion == "automatic":
        attempts = [(hard.interior(), least_thrust), (hard, friction)]
    else:
        objective = {"least-friction": friction, "least-thrust": least_thrust, "least-power": least_power}[criterion]
        attempts = [(hard, objective)]
    for allowed_limits, cost in attempts:
        if allowed_limits is None:
            continue
        best = _best_member(parameters, slope, allowed_limits, cost, speed, acceleration)
        if best is not None:
            return make_trim(parameters, slope, best.thrust, best.pitch, best.branch, speed, acceleration, hard)
    raise explain_refusal(parameters, slope, hard, speed, acceleration)


def keeps_reserves(parameters: MipParameters, trim: Trim, limits: TrimLimits) -> bool:
    """Whether an equilibrium keeps every reserve that the automatic choice looks for.

    Args:
        parameters: The pendulum.
        trim: The equilibrium.
        limits: The hard limits with their reserves.

    Returns:
        False as well if the limits leave no room for the reserves.
    """
    interior = limits.interior()
    if interior is None:
        return False
    loads = equilibrium_loads(
        parameters, trim.slope, trim.thrust, trim.pitch, speed=trim.speed, acceleration=trim.acceleration
    )
    margins = trim_margins(interior, trim.slope, trim.thrust, trim.pitch, loads, parameters.wheel_radius)
    return bool(margins.satisfied)


def _best_member(
    parameters: MipParameters,
    slope: float,
    limits: TrimLimits,
    cost: Callable[[TrimFamily], _Array],
    speed: float,
    acceleration: float,
) -> Trim | None:
    """The cheapest member within the limits, or None if there is none."""

    def cost_within(family: TrimFamily) -> _Array:
        return np.where(family.margins.satisfied, cost(family), np.inf)

    family = sweep(parameters, slope, limits, limits.thrust_range, speed=speed, acceleration=acceleration)
    best = refine(parameters, family, limits, cost_within)
    if best is None:
        # The allowed stretch may be narrower than the sweep's spacing: look wherever the limits are missed by little.
        best = refine_everywhere(parameters, family, limits, lambda members: members.violation)
    return best if best is not None and best.within_limits else None
