"""One equilibrium on a slope, and all of them at a given thrust or pitch."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.errors import NoTrimExists, require_finite
from m4_dynamics.reduced.equilibrium import BRANCHES, equilibrium_loads, equilibrium_pitches, equilibrium_thrust
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.trim_limits import TrimLimits, TrimMargins, trim_margins

__all__ = ["Trim", "make_trim", "require_finite_case", "trim_at_pitch", "trim_branches"]

_Array = NDArray[np.float64]


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
    require_finite_case(slope, speed, acceleration, thrust=thrust)
    pitches = equilibrium_pitches(parameters, slope, thrust, acceleration=acceleration)
    chosen = TrimLimits() if limits is None else limits
    return [
        make_trim(parameters, slope, thrust, float(pitch), branch, speed, acceleration, chosen)
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
    require_finite_case(slope, speed, acceleration, pitch=pitch)
    thrust = float(equilibrium_thrust(parameters, slope, pitch, acceleration=acceleration))
    if not abs(thrust) < 1e9:
        raise NoTrimExists(f"at pitch {math.degrees(pitch):.1f} deg thrust cannot balance the robot", "equilibrium")
    pitches = equilibrium_pitches(parameters, slope, thrust, acceleration=acceleration)
    distances = [abs(math.remainder(float(candidate) - pitch, 2.0 * math.pi)) for candidate in pitches]
    branch = BRANCHES[int(np.nanargmin(distances))] if np.isfinite(distances).any() else BRANCHES[0]
    chosen = TrimLimits() if limits is None else limits
    return make_trim(parameters, slope, thrust, pitch, branch, speed, acceleration, chosen)


def make_trim(
    parameters: MipParameters,
    slope: float,
    thrust: float,
    pitch: float,
    branch: str,
    speed: float,
    acceleration: float,
    limits: TrimLimits,
) -> Trim:
    """Loads and margins of a thrust and a pitch that balance, as a `Trim`.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        thrust: f_t [N].
        pitch: theta [rad].
        branch: Name of the branch.
        speed: Climbing speed [m/s].
        acceleration: Along the slope [m/s^2].
        limits: Limits that the margins refer to.

    Returns:
        The equilibrium.
    """
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


def require_finite_case(slope: float, speed: float, acceleration: float, **others: float) -> None:
    """Raise `NonFiniteError` naming the first figure that is NaN or infinite."""
    require_finite("slope", slope, ("value",))
    require_finite("speed", speed, ("value",))
    require_finite("acceleration", acceleration, ("value",))
    for name, value in others.items():
        require_finite(name, value, ("value",))
