"""What an equilibrium may ask of ground, thrusters and motors, and how far inside those limits it lies."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import InvalidSettingError, require_finite
from m4_dynamics.reduced.equilibrium import EquilibriumLoads

__all__ = ["TrimLimits", "TrimMargins", "ground_clearance", "trim_margins"]

_Array = NDArray[np.float64]


class TrimMargins(NamedTuple):
    """Distance to every limit: positive inside, negative outside; floats, or arrays of one shape.

    Attributes:
        friction: mu_s minus the friction coefficient needed.
        normal_force: Above the least normal force allowed [N].
        thrust: To the nearer bound of the thrust [N].
        duty: To full duty, back-EMF at the climbing speed included.
        clearance: Of the body's outline above the least clearance [m]; infinite if no outline is known.
        pitch_window: To the nearer edge of the pitch window [rad].
    """

    friction: float | _Array
    normal_force: float | _Array
    thrust: float | _Array
    duty: float | _Array
    clearance: float | _Array
    pitch_window: float | _Array

    @property
    def satisfied(self) -> _Array:
        """Where all limits hold, to rounding; boolean, shape of the margins."""
        smallest = np.min(np.stack([np.asarray(margin, dtype=float) for margin in self]), axis=0)
        return np.asarray(smallest >= -1e-9)


@dataclass(frozen=True, slots=True, eq=False)
class TrimLimits:
    """Limits of an equilibrium, and the reserves that the automatic choice keeps inside them.

    Attributes:
        friction_static: mu_s of the ground.
        friction_fraction: The share of mu_s that a controller plans with.
        friction_reserve: The automatic trim needs at most this share of the planned friction.
        thrust_range: Least and greatest total thrust [N].
        thrust_margin: Authority that the automatic trim keeps to both bounds of the thrust [N].
        duty_max: Greatest |u_m|.
        duty_margin: Authority that the automatic trim keeps to it.
        normal_force_min: Least normal force [N].
        pitch_window: Least and greatest pitch relative to the slope normal, theta + slope [rad].
        outline_in_body: Points (forward, up) of the body's outline from the axle, shape (k, 2) [m]; None if unknown.
        clearance_min: Least height of the outline above the slope [m].
    """

    friction_static: float = 0.8
    friction_fraction: float = 0.8
    friction_reserve: float = 0.75
    thrust_range: tuple[float, float] = (0.0, 43.2)
    thrust_margin: float = 4.0
    duty_max: float = 1.0
    duty_margin: float = 0.05
    normal_force_min: float = 5.0
    pitch_window: tuple[float, float] = (-math.radians(100.0), math.radians(100.0))
    outline_in_body: _Array | None = None
    clearance_min: float = 0.02

    def __post_init__(self) -> None:
        for name in ("friction_static", "duty_max"):
            value = float(getattr(self, name))
            if not (math.isfinite(value) and value > 0.0):
                raise InvalidSettingError(name, value, "a finite number above 0")
        for name in ("friction_fraction", "friction_reserve"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise InvalidSettingError(name, getattr(self, name), "a number in (0, 1]")
        for name in ("thrust_margin", "duty_margin", "normal_force_min", "clearance_min"):
            value = float(getattr(self, name))
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidSettingError(name, value, "a finite number, 0 or above")
        for name in ("thrust_range", "pitch_window"):
            low, high = getattr(self, name)
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise InvalidSettingError(name, (low, high), "two finite numbers, the lower one first")
        if self.outline_in_body is not None:
            outline = np.asarray(self.outline_in_body, dtype=float)
            if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) == 0:
                raise InvalidSettingError("shape of outline_in_body", outline.shape, "shape (k, 2) with k >= 1")
            require_finite("outline_in_body", outline)
            object.__setattr__(self, "outline_in_body", outline)

    def with_(self, **changes: object) -> TrimLimits:
        """Return a copy with some attributes changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]

    @property
    def friction_planned(self) -> float:
        """Friction coefficient that a controller plans with."""
        return self.friction_fraction * self.friction_static

    def interior(self) -> TrimLimits | None:
        """Limits tightened by all reserves, or None if the ranges leave no room for them.

        A thrust that cannot be changed (no thrusters: 0 to 0) has no reserve to keep.
        """
        low, high = self.thrust_range
        reserve = self.thrust_margin if high > low else 0.0
        if high - low < 2.0 * reserve or self.duty_max <= self.duty_margin:
            return None
        return self.with_(
            friction_static=self.friction_reserve * self.friction_planned,
            thrust_range=(low + reserve, high - reserve),
            duty_max=self.duty_max - self.duty_margin,
        )


def ground_clearance(
    slope: ArrayLike, pitch: ArrayLike, outline_in_body: ArrayLike | None, wheel_radius: float
) -> _Array:
    """Height of the lowest point of the body's outline above the slope.

    Args:
        slope: Inclination of the ground [rad]; broadcasts with the pitch.
        pitch: theta [rad].
        outline_in_body: Points (forward, up) from the axle, shape (k, 2) [m], or None.
        wheel_radius: Height of the axle above the slope [m].

    Returns:
        Clearance [m], broadcast shape; infinite without an outline.
    """
    pitch_to_normal = np.asarray(slope, dtype=float) + np.asarray(pitch, dtype=float)
    lowest = np.full(pitch_to_normal.shape, np.inf)
    if outline_in_body is not None:
        sine, cosine = np.sin(pitch_to_normal), np.cos(pitch_to_normal)
        for forward, up in np.asarray(outline_in_body, dtype=float):
            # Component of R(theta) p along the slope normal.
            lowest = np.minimum(lowest, up * cosine - forward * sine)
    return np.asarray(lowest + wheel_radius)


def trim_margins(
    limits: TrimLimits,
    slope: ArrayLike,
    thrust: ArrayLike,
    pitch: ArrayLike,
    loads: EquilibriumLoads,
    wheel_radius: float,
) -> TrimMargins:
    """Distance of equilibria to every limit.

    Args:
        limits: The limits.
        slope: Inclination of the ground [rad]; all arrays broadcast.
        thrust: f_t [N].
        pitch: theta [rad]; NaN (no equilibrium) gives NaN margins, which satisfy nothing.
        loads: What the equilibria ask for.
        wheel_radius: [m].

    Returns:
        Margins, each of the broadcast shape.
    """
    f, theta = np.asarray(thrust, dtype=float), np.asarray(pitch, dtype=float)
    pitch_to_normal = np.asarray(slope, dtype=float) + theta
    no_equilibrium = np.where(np.isnan(theta), np.nan, 0.0)
    return TrimMargins(
        friction=limits.friction_static - loads.friction_needed,
        normal_force=loads.normal_force - limits.normal_force_min,
        thrust=np.minimum(f - limits.thrust_range[0], limits.thrust_range[1] - f) + no_equilibrium,
        duty=limits.duty_max - np.abs(loads.duty),
        clearance=ground_clearance(slope, theta, limits.outline_in_body, wheel_radius)
        - limits.clearance_min
        + no_equilibrium,
        pitch_window=np.minimum(pitch_to_normal - limits.pitch_window[0], limits.pitch_window[1] - pitch_to_normal),
    )
