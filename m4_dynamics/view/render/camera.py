"""A camera infinitely far away: parallel lines stay parallel, lengths in its plane are true."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import InvalidSettingError

__all__ = ["Camera"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """Where one looks from; z is up in the picture.

    Attributes:
        towards_viewer: Direction from the scene to the viewer; (0, -1, 0) is the side view with x to the right.
        axes: Right, up and away from the viewer, in the world, rows of a matrix of shape (3, 3).
    """

    towards_viewer: tuple[float, float, float] = (0.0, -1.0, 0.0)
    axes: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        away = -np.asarray(self.towards_viewer, dtype=float)
        right = np.cross(away, (0.0, 0.0, 1.0))
        if not np.isfinite(away).all() or np.linalg.norm(right) < 1e-9:
            raise InvalidSettingError("towards_viewer", self.towards_viewer, "a direction that is not vertical")
        away = away / np.linalg.norm(away)
        right = right / np.linalg.norm(right)
        object.__setattr__(self, "axes", np.stack([right, np.cross(right, away), away]))

    def view(self, points: ArrayLike) -> Array:
        """Points as the camera sees them.

        Args:
            points: In the world, shape (..., 3) [m].

        Returns:
            Right, up and away, shape (..., 3) [m].
        """
        return np.asarray(np.asarray(points, dtype=float) @ self.axes.T)

    def project(self, points: ArrayLike) -> Array:
        """Places of points in the picture's plane, shape (..., 2) [m]; see `view`."""
        return np.asarray(self.view(points)[..., :2])

    def world(self, points: ArrayLike) -> Array:
        """The reverse of `view`."""
        return np.asarray(np.asarray(points, dtype=float) @ self.axes)
