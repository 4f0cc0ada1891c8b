"""Equilibria on a slope: where the robot stands still or climbs steadily, and which of them to use.

Thrust fixes the pitch, up to two branches, so equilibria form a one-parameter family. More thrust is not always better:
it makes the robot lie back, and a trim on a bound of thrust or duty leaves a controller no authority there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError, NoTrimExists, require_finite
from m4_dynamics.reduced.equilibrium import BRANCHES, equilibrium_loads, equilibrium_pitches, equilibrium_thrust
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.power import PowerModel, power_needed
from m4_dynamics.reduced.trim_family import TrimFamily, refine, sweep
from m4_dynamics.reduced.trim_limits import TrimLimits, TrimMargins, trim_margins
from m4_dynamics.reduced.trim_refusal import explain_refusal

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


@dataclass(frozen=True, slots=True)
class Trim:
    """An equilibrium of the pendulum on a slope, or a climb at constant speed or acceleration.

    Attributes:
        slope: Inclination of the ground [rad].
        speed: Along the slope, positive uphill [m/s].
        acceleration: Along the slope [m/s^2].
        pitch: theta [rad].
        thrust: f_t [N].
        torque: tau of both motors [N m].
        duty: u_m that gives it at this speed; beyond 1 if the motors cannot.
        friction_force: f_x along the slope, positive uphill [N].
        normal_force: f_n [N].
        friction_needed: |f_x| / f_n, infinite if the ground would have to pull.
        wheel_rate: phi' [rad/s].
        margins: Distance to every limit.
        branch: "upright" (CoM above the axle) or "hanging".
    """

    slope: float
    speed: float
    acceleration: float
    pitch: float
    thrust: float
    torque: float
    duty: float
    friction_force: float
    normal_force: float
    friction_needed: float
    wheel_rate: float
    margins: TrimMargins
    branch: str

    @property
    def state(self) -> _Array:
        """(phi, theta, phi', theta') with phi = 0, shape (4,)."""
        return np.array([0.0, self.pitch, self.wheel_rate, 0.0])

    @property
    def inputs(self) -> _Array:
        """(duty, thrust), shape (2,)."""
        return np.array([self.duty, self.thrust])

    @property
    def within_limits(self) -> bool:
        """Whether every margin is positive or zero."""
        return bool(self.margins.satisfied)


def trim_branches(
    parameters: MipParameters,
    slope: float,
    thrust: float,
    *,
    speed: float = 0.0,
    acceleration: float = 0.0,
    limits: TrimLimits | None = None,
) -> list[Trim]:
    """All equilibria at a given thrust, inside the limits or not.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad], positive uphill.
        thrust: f_t [N].
        speed: Climbing speed [m/s].
        acceleration: Along the slope [m/s^2].
        limits: Limits that the margins refer to; None takes the defaults.

    Returns:
        Upright first, then hanging; empty if no pitch balances the robot.

    Raises:
        NonFiniteError: If an argument is NaN or infinite.
    """
    _require_finite(slope, speed, acceleration, thrust=thrust)
    pitches = equilibrium_pitches(parameters, slope, thrust, acceleration=acceleration)
    chosen = TrimLimits() if limits is None else limits
    return [
        _make_trim(parameters, slope, thrust, float(pitch), branch, speed, acceleration, chosen)
        for branch, pitch in zip(BRANCHES, pitches, strict=True)
        if math.isfinite(pitch)
    ]


def trim_at_pitch(
    parameters: MipParameters,
    slope: float,
    pitch: float,
    *,
    speed: float = 0.0,
    acceleration: float = 0.0,
    limits: TrimLimits | None = None,
) -> Trim:
    """The equilibrium at a given pitch; its thrust is unique and may lie outside the limits (see the margins).

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        pitch: theta [rad].
        speed: Climbing speed [m/s].
        acceleration: Along the slope [m/s^2].
        limits: Limits that the margins refer to; None takes the defaults.

    Returns:
        The equilibrium.

    Raises:
        NoTrimExists: At the pitch where thrust has no effect on the balance.
    """
    _require_finite(slope, speed, acceleration, pitch=pitch)
    thrust = float(equilibrium_thrust(parameters, slope, pitch, acceleration=acceleration))
    if not abs(thrust) < 1e9:
        raise NoTrimExists(f"at pitch {math.degrees(pitch):.1f} deg thrust cannot balance the robot", "equilibrium")
    pitches = equilibrium_pitches(parameters, slope, thrust, acceleration=acceleration)
    distances = [abs(math.remainder(float(candidate) - pitch, 2.0 * math.pi)) for candidate in pitches]
    branch = BRANCHES[int(np.nanargmin(distances))] if np.isfinite(distances).any() else BRANCHES[0]
    chosen = TrimLimits() if limits is None else limits
    return _make_trim(parameters, slope, thrust, pitch, branch, speed, acceleration, chosen)


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
    _require_finite(slope, speed, acceleration)
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
        raise explain_refusal(parameters, slope, hard, speed, acceleration, thrust=member.thrust)
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
            best_thrust, best_pitch, branch = best
            return _make_trim(parameters, slope, best_thrust, best_pitch, branch, speed, acceleration, hard)
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
) -> tuple[float, float, str] | None:
    """Thrust, pitch and branch of the cheapest member within the limits, or None if there is none."""

    def cost_within(family: TrimFamily) -> _Array:
        return np.where(family.margins.satisfied, cost(family), np.inf)

    def violation(family: TrimFamily) -> _Array:
        return family.violation

    family = sweep(parameters, slope, limits, limits.thrust_range, speed=speed, acceleration=acceleration)
    best = refine(parameters, family, limits, cost_within)
    if best is None:
        # The allowed stretch may be narrower than the sweep's spacing: look where the limits are missed by least.
        best = refine(parameters, family, limits, violation)
        if best is None or not best.within_limits:
            return None
    return best.thrust, best.pitch, best.branch


def _make_trim(
    parameters: MipParameters,
    slope: float,
    thrust: float,
    pitch: float,
    branch: str,
    speed: float,
    acceleration: float,
    limits: TrimLimits,
) -> Trim:
    loads = equilibrium_loads(parameters, slope, thrust, pitch, speed=speed, acceleration=acceleration)
    margins = trim_margins(limits, slope, thrust, pitch, loads, parameters.wheel_radius)
    return Trim(
        slope=float(slope),
        speed=float(speed),
        acceleration=float(acceleration),
        pitch=float(pitch),
        thrust=float(thrust),
        torque=float(loads.torque),
        duty=float(loads.duty),
        friction_force=float(loads.friction_force),
        normal_force=float(loads.normal_force),
        friction_needed=float(loads.friction_needed),
        wheel_rate=float(speed) / parameters.wheel_radius,
        margins=TrimMargins(*(float(margin) for margin in margins)),
        branch=branch,
    )


def _require_finite(slope: float, speed: float, acceleration: float, **others: float) -> None:
    require_finite("slope", slope, ("value",))
    require_finite("speed", speed, ("value",))
    require_finite("acceleration", acceleration, ("value",))
    for name, value in others.items():
        require_finite(name, value, ("value",))
