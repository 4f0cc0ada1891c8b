"""The way that a wheel's centre takes over a terrain: the profile, shifted out by the wheel's radius.

Over a concave corner the shifted lines meet, and the direction turns at once; over a convex corner the centre goes
round the corner on an arc, and the direction turns with it. In both cases a wheel that does not slip turns by travel
over radius, so that the absolute wheel angle is the arc length over r.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.full.terrain import Terrain

__all__ = ["AxlePath"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class AxlePath:
    """Pieces of the way, straight lines and arcs; the first and the last go on for ever.

    Attributes:
        radius: Of the wheel [m].
        starts: Arc length at which each piece starts, shape (pieces,) [m]; the first is -inf.
        slopes: Slope at the start and at the end of each piece, shape (pieces, 2) [rad].
        anchors: A point (x, z) of each piece: on a line at arc length `anchor_lengths`, of an arc its centre.
        anchor_lengths: Arc length of the anchor, shape (pieces,) [m].
    """

    radius: float
    starts: Array
    slopes: Array
    anchors: Array
    anchor_lengths: Array

    @classmethod
    def over(cls, terrain: Terrain, radius: float) -> AxlePath:
        """The path over a terrain; arc length counts from the first corner, or from x = 0 if there is none.

        Args:
            terrain: The ground.
            radius: Of the wheel [m].

        Returns:
            The path.

        Raises:
            InvalidSettingError: Two corners are so near each other that the wheel cannot touch what is between them.
        """
        segments = terrain.segments
        start, tangent, normal = segments[:, 0:2], segments[:, 2:4], segments[:, 4:6]
        slope = np.arctan2(tangent[:, 1], tangent[:, 0])
        lines = start + radius * normal  # a point of each shifted line
        entry = np.full(len(segments), -math.inf)  # where along its line each straight piece starts and ends
        leave = np.full(len(segments), math.inf)
        for k in range(1, len(segments)):
            turn = float(slope[k] - slope[k - 1])
            length = float(segments[k - 1, 6])
            shortened = radius * math.tan(0.5 * turn) if turn > 0.0 else 0.0
            leave[k - 1], entry[k] = length - shortened, shortened
        for k in range(len(segments)):
            if entry[k] > leave[k]:
                raise InvalidSettingError(
                    f"terrain between corners {k - 1} and {k}",
                    f"{segments[k, 6]:.3f} m",
                    "room for the wheel between them",
                )
        starts, slopes, anchors, lengths = [-math.inf], [], [], []
        here = 0.0  # arc length of the point where the last piece ended
        for k in range(len(segments)):
            slopes.append((slope[k], slope[k]))
            if k == 0:
                # Arc length zero: the end of the first piece, or x = 0 on a single line.
                zero = float(leave[0]) if len(segments) > 1 else -float(lines[0, 0] / tangent[0, 0])
                anchors.append(lines[0] + zero * tangent[0])
                lengths.append(0.0)
            else:
                anchors.append(lines[k] + entry[k] * tangent[k])
                lengths.append(here)
                here += float(leave[k] - entry[k])
            if k < len(segments) - 1:
                starts.append(here)
                turn = float(slope[k + 1] - slope[k])
                if turn < 0.0:
                    slopes.append((slope[k], slope[k + 1]))
                    anchors.append(start[k + 1])
                    lengths.append(here)
                    here += -radius * turn
                    starts.append(here)
        return cls(radius, np.array(starts), np.array(slopes), np.array(anchors), np.array(lengths))

    @property
    def corners(self) -> Array:
        """Arc lengths at which the slope starts to change [m]."""
        return np.array([start for start, before in zip(self.starts[1:], self.slopes[:-1], strict=True)
                         if before[0] == before[1]])  # fmt: skip

    def slope_at(self, length: ArrayLike) -> Array:
        """Direction of travel at arc lengths [rad], same shape.

        Args:
            length: Arc length, any shape [m].

        Returns:
            The slope: that of the ground on straight pieces, turning on arcs.
        """
        lengths = np.asarray(length, dtype=float)
        piece = np.searchsorted(self.starts, lengths, side="right") - 1
        before, after = self.slopes[piece, 0], self.slopes[piece, 1]
        # Only arcs turn, by one radian per radius.
        turned = np.where(before == after, 0.0, (lengths - self.anchor_lengths[piece]) / self.radius)
        return np.asarray(before - turned)

    def point_at(self, length: float) -> Array:
        """Position (x, z) of the wheel's centre at an arc length, shape (2,) [m]."""
        piece = int(np.searchsorted(self.starts, length, side="right")) - 1
        slope = float(self.slope_at(length))
        if self.slopes[piece, 0] != self.slopes[piece, 1]:
            return np.asarray(self.anchors[piece] + self.radius * np.array([-math.sin(slope), math.cos(slope)]))
        along = length - self.anchor_lengths[piece]
        return np.asarray(self.anchors[piece] + along * np.array([math.cos(slope), math.sin(slope)]))

    def length_at(self, point: ArrayLike) -> float:
        """Arc length of the path's point nearest to a position.

        Args:
            point: (x, z), shape (2,) [m].

        Returns:
            Arc length [m].
        """
        position = np.asarray(point, dtype=float)
        best, nearest = math.inf, 0.0
        ends = np.append(self.starts[1:], math.inf)
        for piece in range(len(self.starts)):
            offset = position - self.anchors[piece]
            before, after = self.slopes[piece]
            if before == after:
                along = float(offset @ np.array([math.cos(before), math.sin(before)]))
                candidate = self.anchor_lengths[piece] + along
            else:
                angle = math.atan2(-offset[0], offset[1])
                candidate = self.anchor_lengths[piece] + self.radius * (before - angle)
            candidate = min(max(candidate, self.starts[piece]), ends[piece])
            distance = float(np.linalg.norm(self.point_at(candidate) - position))
            if distance < best:
                best, nearest = distance, candidate
        return nearest
