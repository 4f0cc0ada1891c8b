"""The ground ahead, by place: its slope as a function of the wheel angle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import InvalidSettingError, require_finite, require_shape

__all__ = ["SlopeProfile"]

_Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SlopeProfile:
    """Piecewise constant slope over the absolute wheel angle; the first and the last piece go on for ever.

    Attributes:
        starts: Wheel angle at which each piece starts, shape (m,) [rad]; ascending, the first is -inf.
        slopes: Inclination on each piece, shape (m,) [rad].
    """

    starts: _Array
    slopes: _Array

    def __post_init__(self) -> None:
        """Check shapes, order and finiteness.

        Raises:
            InvalidSettingError: The arrays do not fit together, or the starts do not ascend.
            NonFiniteError: A slope, or a start but the first, is not finite.
        """
        starts = np.array(self.starts, dtype=np.float64)
        slopes = np.array(self.slopes, dtype=np.float64)
        if starts.ndim != 1 or len(starts) == 0:
            raise InvalidSettingError("starts of a slope profile", starts.shape, "one number per piece, at least one")
        require_shape("slopes of a slope profile", slopes, starts.shape)
        require_finite("slopes of a slope profile", slopes)
        starts[0] = -math.inf
        require_finite("starts of a slope profile", starts[1:])
        if (np.diff(starts) <= 0.0).any():
            raise InvalidSettingError("starts of a slope profile", starts[1:].tolist(), "ascending wheel angles")
        for name, array in (("starts", starts), ("slopes", slopes)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def along(
        cls, starts: ArrayLike, slopes: ArrayLike, *, wheel_radius: float, turn_step: float = math.radians(5.0)
    ) -> SlopeProfile:
        """The profile of a path of straight pieces and arcs, such as a wheel's centre takes over convex corners.

        Args:
            starts: Arc length at which each piece of the path starts, shape (m,) [m]; the first is not read.
            slopes: Slope at the start and at the end of each piece, shape (m, 2) [rad]; they differ on an arc, on which
                the slope turns evenly.
            wheel_radius: [m]; the wheel angle is the arc length over it.
            turn_step: Arcs are taken in steps of at most this change of slope [rad].

        Returns:
            The profile.

        Raises:
            InvalidSettingError: As for the class, or an arc at an end of the path.
        """
        lengths, ends = np.asarray(starts, dtype=np.float64), np.asarray(slopes, dtype=np.float64)
        require_shape("slopes of a path", ends, (len(lengths), 2))
        if len(ends) > 0 and (ends[0, 0] != ends[0, 1] or ends[-1, 0] != ends[-1, 1]):
            raise InvalidSettingError("ends of a path", "an arc", "straight pieces, which go on for ever")
        angles, values = [], []
        for k, (before, after) in enumerate(ends):
            count = max(1, math.ceil(abs(after - before) / turn_step - 1e-9))
            extent = (lengths[k + 1] - lengths[k]) if count > 1 else 0.0
            for i in range(count):
                angles.append((lengths[k] + extent * i / count) / wheel_radius)
                values.append(before + (after - before) * (i + 0.5) / count)
        return cls(np.array(angles), np.array(values))

    def slope_at(self, wheel_angle: ArrayLike) -> _Array:
        """Slope under the wheels.

        Args:
            wheel_angle: Absolute wheel angle, any shape [rad].

        Returns:
            Inclination, same shape [rad].
        """
        piece = np.searchsorted(self.starts, np.asarray(wheel_angle, dtype=np.float64), side="right") - 1
        return np.asarray(self.slopes[piece])
