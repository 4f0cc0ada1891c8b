"""Terrain: a polyline profile in the x-z plane of the world, extruded along y.

Frames: W is the world (x forward and uphill, z up). Each segment carries its own slope frame S with
t = (cos b, 0, sin b) along the ground and n = (-sin b, 0, cos b) out of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError, require_finite

__all__ = ["SEGMENT_COLUMNS", "Terrain", "flat_terrain", "incline_terrain", "plateau_terrain", "ramp_terrain"]

#: Columns of `Terrain.segments`, in order: start point, tangent, normal, length, friction scales to the right (y <= 0)
#: and to the left (y > 0).
SEGMENT_COLUMNS = (
    "start_x",
    "start_z",
    "tangent_x",
    "tangent_z",
    "normal_x",
    "normal_z",
    "length",
    "friction_scale",
    "friction_scale_left",
)


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """A polyline profile, extruded sideways; the first and the last segment go on for ever.

    Attributes:
        profile_in_world: Corner points (x, z) with x strictly increasing, shape (n, 2) [m].
        friction_scale: Factor on the robot's ground friction for each segment, shape (n - 1,).
        friction_scale_left: The same where y > 0, shape (n - 1,); None is as on the other side.
        segments: One row per segment, shape (n - 1, 9), columns `SEGMENT_COLUMNS`.
    """

    profile_in_world: NDArray[np.float64]
    friction_scale: NDArray[np.float64] | None = None
    friction_scale_left: NDArray[np.float64] | None = None
    segments: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        profile = np.array(self.profile_in_world, dtype=float)
        require_finite("terrain profile", profile)
        if profile.ndim != 2 or profile.shape[1] != 2 or profile.shape[0] < 2:
            raise InvalidSettingError("shape of the terrain profile", profile.shape, "(n, 2) with n >= 2")
        if not (np.diff(profile[:, 0]) > 0.0).all():
            raise InvalidSettingError("x of the terrain profile", profile[:, 0].tolist(), "strictly increasing values")
        count = profile.shape[0] - 1
        scale = np.ones(count) if self.friction_scale is None else np.array(self.friction_scale, dtype=float)
        left = scale.copy() if self.friction_scale_left is None else np.array(self.friction_scale_left, dtype=float)
        for name, values in (("friction scale", scale), ("friction scale on the left", left)):
            require_finite(f"{name} of the terrain", values)
            if values.shape != (count,) or (values < 0.0).any():
                raise InvalidSettingError(f"{name} of the terrain", values.tolist(), f"{count} values >= 0")
        along = np.diff(profile, axis=0)
        length = np.hypot(along[:, 0], along[:, 1])
        tangent = along / length[:, None]
        segments = np.column_stack((profile[:-1], tangent, -tangent[:, 1], tangent[:, 0], length, scale, left))
        for array in (profile, scale, left, segments):
            array.setflags(write=False)
        object.__setattr__(self, "profile_in_world", profile)
        object.__setattr__(self, "friction_scale", scale)
        object.__setattr__(self, "friction_scale_left", left)
        object.__setattr__(self, "segments", segments)

    def segment_index_at(self, x: float) -> int:
        """Index of the segment under a world x [m]; beyond the ends, the end segments."""
        inner = self.profile_in_world[1:-1, 0]
        return int(np.searchsorted(inner, x, side="right"))

    def height_at(self, x: float) -> float:
        """Height z of the ground under a world x [m]."""
        start_x, start_z, tangent_x, tangent_z = self.segments[self.segment_index_at(x), :4]
        return float(start_z + (x - start_x) * tangent_z / tangent_x)

    def slope_at(self, x: float) -> float:
        """Slope angle of the ground under a world x [rad], positive uphill towards +x."""
        _, _, tangent_x, tangent_z = self.segments[self.segment_index_at(x), :4]
        return math.atan2(tangent_z, tangent_x)


def _require_slope(slope: float) -> None:
    if not (math.isfinite(slope) and abs(slope) < math.radians(89.9)):
        raise InvalidSettingError("slope [deg]", math.degrees(slope), "an angle between -89.9 and 89.9 deg")


def flat_terrain() -> Terrain:
    """Level ground at z = 0."""
    return incline_terrain(0.0)


def incline_terrain(slope: float, *, below: float = 1.0, above: float = 10.0) -> Terrain:
    """One endless inclined face through the world's origin.

    Args:
        slope: Inclination [rad], positive uphill towards +x.
        below: How far the drawn face reaches below the origin, along the slope [m].
        above: How far it reaches above, along the slope [m].

    Returns:
        The terrain.

    Raises:
        InvalidSettingError: The slope is vertical or not finite.
    """
    _require_slope(slope)
    tangent = np.array([math.cos(slope), math.sin(slope)])
    return Terrain(np.stack((-below * tangent, above * tangent)))


def ramp_terrain(slope: float, *, flat_before: float = 3.0, length: float = 8.0) -> Terrain:
    """Level ground up to the origin, then one inclined face.

    Args:
        slope: Inclination of the face [rad].
        flat_before: Length of the level part that is drawn [m].
        length: Length of the face that is drawn, along the slope [m].

    Returns:
        The terrain; the corner lies at the world's origin.
    """
    _require_slope(slope)
    end = length * np.array([math.cos(slope), math.sin(slope)])
    return Terrain(np.array([[-flat_before, 0.0], [0.0, 0.0], end]))


def plateau_terrain(slope: float, *, flat_before: float = 3.0, length: float = 4.0, plateau: float = 3.0) -> Terrain:
    """Level ground, an inclined face, and level ground above.

    Args:
        slope: Inclination of the face [rad].
        flat_before: Length of the lower level part that is drawn [m].
        length: Length of the face along the slope [m].
        plateau: Length of the upper level part that is drawn [m].

    Returns:
        The terrain; the foot of the face lies at the world's origin.
    """
    _require_slope(slope)
    crest = length * np.array([math.cos(slope), math.sin(slope)])
    return Terrain(np.array([[-flat_before, 0.0], [0.0, 0.0], crest, crest + np.array([plateau, 0.0])]))
