"""The equilibria on one slope at a glance: a sweep over thrust, and the members that each criterion chooses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from m4_dynamics.errors import NoTrimExists
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.power import PowerModel
from m4_dynamics.reduced.trim import Criterion, Trim, select_trim, trim_at_pitch, trim_branches
from m4_dynamics.reduced.trim_limits import TrimLimits

__all__ = ["FREE_CRITERIA", "TrimOverview", "trim_overview"]

#: The criteria that leave the thrust free.
FREE_CRITERIA: tuple[Criterion, ...] = ("automatic", "least-friction", "least-thrust", "least-power")


@dataclass(frozen=True, slots=True)
class TrimOverview:
    """Equilibria on a slope.

    Attributes:
        members: By rising thrust; at a given thrust or pitch all there are, in a sweep the upright ones and whatever
            else satisfies the limits.
        selected: Criterion -> its choice; empty if none satisfies the limits.
        refusal: Why no member satisfies the limits, or None.
    """

    members: tuple[Trim, ...]
    selected: Mapping[Criterion, Trim]
    refusal: NoTrimExists | None


def trim_overview(
    parameters: MipParameters,
    slope: float,
    *,
    limits: TrimLimits,
    thrust: float | None = None,
    pitch: float | None = None,
    criteria: tuple[Criterion, ...] = FREE_CRITERIA,
    speed: float = 0.0,
    acceleration: float = 0.0,
    power_model: PowerModel | None = None,
    points: int = 10,
) -> TrimOverview:
    """List the equilibria on a slope and choose among them.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        limits: What ground, thrusters and motors can do.
        thrust: Total thrust [N] if it is given; None sweeps the range of the limits.
        pitch: theta [rad] if it is given instead.
        criteria: Criteria to choose by, if neither thrust nor pitch is given.
        speed: Climbing speed [m/s].
        acceleration: Along the slope [m/s^2].
        power_model: Rotor figures for "least-power".
        points: Thrusts in the sweep.

    Returns:
        The overview.

    Raises:
        NoTrimExists: At a given pitch where thrust has no effect.
        NonFiniteError: If an argument is NaN or infinite.
    """
    if pitch is not None:
        criteria = ("pitch",)
        members = [trim_at_pitch(parameters, slope, pitch, speed=speed, acceleration=acceleration, limits=limits)]
    elif thrust is not None:
        criteria = ("thrust",)
        members = trim_branches(parameters, slope, thrust, speed=speed, acceleration=acceleration, limits=limits)
    else:
        thrusts = np.unique(np.linspace(*limits.thrust_range, points))
        everything = (
            trim_branches(parameters, slope, float(f), speed=speed, acceleration=acceleration, limits=limits)
            for f in thrusts
        )
        members = [m for branches in everything for m in branches if m.branch == "upright" or m.within_limits]
    selected: dict[Criterion, Trim] = {}
    refusal: NoTrimExists | None = None
    for criterion in criteria:
        try:
            selected[criterion] = select_trim(
                parameters,
                slope,
                limits=limits,
                criterion=criterion,
                thrust=thrust,
                pitch=pitch,
                speed=speed,
                acceleration=acceleration,
                power_model=power_model,
            )
        except NoTrimExists as error:
            refusal = error
            break  # the limits are the same for every criterion
    members += [trim for trim in selected.values() if trim not in members]
    unique = list(dict.fromkeys(members))
    return TrimOverview(tuple(sorted(unique, key=lambda trim: trim.thrust)), selected, refusal)
