"""The way that a point has come: pieces laid beforehand, each of which grows while the point goes along it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.view.arrows import HIDDEN_SCALE
from m4_dynamics.view.motion import Motion, motion_matrix, quaternions_onto
from m4_dynamics.view.three import Command, Material, cylinder, set_object, set_property, set_transform

__all__ = ["piece_commands", "piece_matrix", "trail_commands", "trail_corners", "trail_motions"]

_RADIUS = 0.005  # [m]
_TOLERANCE = 0.004  # [m] between the trail's end and the point that it follows
_MOST_PIECES = 120


def trail_corners(
    time: NDArray[np.float64], points: NDArray[np.float64], *, tolerance: float = _TOLERANCE, most: int = _MOST_PIECES
) -> NDArray[np.int64]:
    """Instants between which the point moves evenly along a line, to within a tolerance.

    Args:
        time: Instants, shape (n,) [s].
        points: Where the point is, shape (n, 3) [m].
        tolerance: Largest distance from the point to the even motion [m]; doubled until there are few pieces enough.
        most: Largest number of pieces.

    Returns:
        Indices of the instants, first and last included, shape (pieces + 1,).
    """
    while True:
        kept = {0, len(time) - 1}
        spans = [(0, len(time) - 1)]
        while spans:
            first, last = spans.pop()
            if last - first < 2:
                continue
            share = (time[first : last + 1] - time[first]) / (time[last] - time[first])
            even = points[first] + share[:, None] * (points[last] - points[first])
            away = np.linalg.norm(points[first : last + 1] - even, axis=1)
            worst = int(np.argmax(away))
            if away[worst] > tolerance:
                kept.add(first + worst)
                spans += [(first, first + worst), (first + worst, last)]
        if len(kept) <= most + 1:
            return np.array(sorted(kept))
        tolerance *= 2.0


def piece_commands(path: str, colour: str) -> list[Command]:
    """Commands that build one piece, a rod of unit length along its node's z axis."""
    rod = f"{path}/rod"
    return [
        set_object(rod, cylinder(_RADIUS, 1.0, base_at_origin=True, sides=8), Material(colour=colour, in_front=True)),
        set_property(f"{rod}/<object>", "castShadow", False),
    ]


def piece_matrix(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Transform that lays a piece between two points.

    Args:
        start: One end, shape (3,) [m].
        end: The other end, shape (3,) [m].

    Returns:
        Homogeneous transform, shape (4, 4).
    """
    step = end - start
    length = max(float(np.linalg.norm(step)), HIDDEN_SCALE)
    scale = np.array([[1.0, 1.0, length]])
    return motion_matrix(Motion("", start[None], quaternions_onto(step[None]), scale), 0)


def trail_commands(path: str, colour: str, points: NDArray[np.float64]) -> list[Command]:
    """Commands that lay the pieces of a trail, none of them to be seen yet.

    Args:
        path: The trail's node.
        colour: sRGB hex.
        points: Its corners, shape (pieces + 1, 3) [m].

    Returns:
        The commands.
    """
    commands = []
    directions = quaternions_onto(np.diff(points, axis=0))
    for index, start in enumerate(points[:-1]):
        piece = f"{path}/{index}"
        commands += piece_commands(f"{piece}/growing", colour)
        commands.append(set_transform(piece, motion_matrix(Motion(piece, start[None], directions[index][None]), 0)))
    return commands


def trail_motions(path: str, time: NDArray[np.float64], points: NDArray[np.float64], end: float) -> list[Motion]:
    """Motions that let each piece grow while the point goes along it.

    Args:
        path: The trail's node.
        time: Instants of the corners, shape (pieces + 1,) [s].
        points: The corners, shape (pieces + 1, 3) [m].
        end: When the whole scene ends [s].

    Returns:
        One motion per piece, with a few instants of its own.
    """
    motions = []
    lengths = np.maximum(np.linalg.norm(np.diff(points, axis=0), axis=1), HIDDEN_SCALE)
    for index, length in enumerate(lengths):
        began, ended = float(time[index]), float(time[index + 1])
        # Until its time comes a piece is too thin to be seen, then it has its width at once.
        keys = [(0.0, HIDDEN_SCALE, HIDDEN_SCALE)] if began > 0.0 else []
        keys += [
            (began, HIDDEN_SCALE, HIDDEN_SCALE),
            (min(began + 1e-3, ended), 1.0, HIDDEN_SCALE),
            (ended, 1.0, length),
        ]
        keys += [(end, 1.0, length)] if end > ended else []
        table = np.array(keys)
        scale = table[:, [1, 1, 2]]
        motions.append(Motion(f"{path}/{index}/growing", scale=scale, times=table[:, 0]))
    return motions
