"""The trail of a point whose way is not known yet: pieces laid beforehand, one after the other put to use."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.view.three import Command, set_transform
from m4_dynamics.view.trail import piece_commands, piece_matrix

__all__ = ["GrowingTrail"]

_TOLERANCE = 0.004  # [m] between a piece and the points that it stands for
_PIECES = 120


class GrowingTrail:
    """Follows a point with straight pieces; when all are in use, the oldest is taken again."""

    def __init__(self, path: str, *, pieces: int = _PIECES, tolerance: float = _TOLERANCE) -> None:
        """A trail without a point yet.

        Args:
            path: Its node.
            pieces: How many pieces there are.
            tolerance: Largest distance from a point passed to its piece [m].
        """
        self._path = path
        self._tolerance = tolerance
        self._pieces = pieces
        self._placed: list[NDArray[np.float64]] = []  # transforms of the pieces in use
        self._current = 0
        self._passed: list[NDArray[np.float64]] = []  # points that the current piece stands for, its start first

    def commands(self, colour: str) -> list[Command]:
        """Commands that build the pieces.

        Args:
            colour: sRGB hex.

        Returns:
            The commands; pieces are not to be seen before `placing_commands` put them into their places.
        """
        unseen = piece_matrix(np.zeros(3), np.zeros(3))
        commands = []
        for index in range(self._pieces):
            commands += piece_commands(self._piece(index), colour)
            commands.append(set_transform(self._piece(index), unseen))
        return commands

    def extend(self, point: NDArray[np.float64]) -> None:
        """Go on to a point.

        Args:
            point: Where the point followed is now, shape (3,) [m].
        """
        if self._passed and not self._stands_for(point):
            self._current = (self._current + 1) % self._pieces
            self._passed = self._passed[-1:]
        self._passed.append(np.array(point, dtype=float))
        placed = piece_matrix(self._passed[0], self._passed[-1])
        self._placed[self._current : self._current + 1] = [placed]

    def placing_commands(self) -> list[Command]:
        """Commands that put every piece in use where it is: a viewer may have missed any of the earlier ones."""
        return [set_transform(self._piece(index), matrix) for index, matrix in enumerate(self._placed)]

    def _piece(self, index: int) -> str:
        return f"{self._path}/{index}"

    def _stands_for(self, point: NDArray[np.float64]) -> bool:
        """Whether one straight piece to the point passes all points since its start."""
        start = self._passed[0]
        passed = np.array(self._passed) - start
        step = point - start
        share = np.clip(passed @ step / max(float(step @ step), 1e-12), 0.0, 1.0)
        away = np.linalg.norm(passed - share[:, None] * step, axis=1)
        return bool(away.max() <= self._tolerance)
