"""Central finite differences on the configuration manifold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def vector_jacobian(function: Callable[[Array], ArrayLike], x: ArrayLike, step: float = 1e-6) -> Array:
    """d function / d x, shape (*output, n)."""
    point = np.asarray(x, dtype=float)
    columns = []
    for direction in np.eye(point.size):
        ahead, behind = function(point + step * direction), function(point - step * direction)
        columns.append((np.asarray(ahead, dtype=float) - np.asarray(behind, dtype=float)) / (2.0 * step))
    return np.stack(columns, axis=-1)


def configuration_jacobian(
    model: pin.Model, function: Callable[[Array], ArrayLike], q: ArrayLike, step: float = 1e-6
) -> Array:
    """d function / d q along the tangent directions of the configuration, shape (*output, nv)."""
    configuration = np.asarray(q, dtype=float)
    return vector_jacobian(
        lambda tangent: function(pin.integrate(model, configuration, tangent)), np.zeros(model.nv), step
    )


def placement_jacobian(model: pin.Model, frame_id: int, q: ArrayLike, step: float = 1e-6) -> Array:
    """Jacobian of a frame from its placements alone: linear then angular, world axes, shape (6, nv)."""
    data = model.createData()

    def placement(configuration: Array) -> pin.SE3:
        pin.framesForwardKinematics(model, data, configuration)
        return data.oMf[frame_id].copy()

    origin = placement(np.asarray(q, dtype=float))

    def displacement(configuration: Array) -> Array:
        here = placement(configuration)
        turn = pin.log3(here.rotation @ origin.rotation.T)
        return np.concatenate((here.translation, turn))

    return configuration_jacobian(model, displacement, q, step)


def along_flow(model: pin.Model, q: Array, v: Array, acceleration: Array, time: float) -> tuple[Array, Array]:
    """(q, v) a small time later (or earlier), to second order in q and first in v."""
    later: Array = pin.integrate(model, q, time * v + 0.5 * time**2 * acceleration)
    return later, v + time * acceleration


def time_derivative(
    model: pin.Model,
    function: Callable[[Array, Array], ArrayLike],
    q: Array,
    v: Array,
    acceleration: Array,
    step: float = 1e-6,
) -> Array:
    """d/dt of a function of (q, v) along the motion."""
    ahead = np.asarray(function(*along_flow(model, q, v, acceleration, step)), dtype=float)
    behind = np.asarray(function(*along_flow(model, q, v, acceleration, -step)), dtype=float)
    rate: Array = (ahead - behind) / (2.0 * step)
    return rate
