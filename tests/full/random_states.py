"""Random states of any robot."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

Array = NDArray[np.float64]


def random_configuration(model: pin.Model, rng: np.random.Generator, *, height: float = 0.0) -> Array:
    """Any attitude, any joint angles, the base within half a metre of (0, 0, height)."""
    q: Array = pin.integrate(model, pin.neutral(model), rng.uniform(-2.0, 2.0, model.nv))
    q[:3] = rng.uniform(-0.5, 0.5, 3)
    q[2] += height
    return q


def random_velocity(model: pin.Model, rng: np.random.Generator, *, scale: float = 2.0) -> Array:
    """Every entry within +-scale."""
    v: Array = rng.uniform(-scale, scale, model.nv)
    return v
