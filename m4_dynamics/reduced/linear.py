"""Linear models x' = A x + B u: discretisation and controllability."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

__all__ = ["Controllability", "controllability", "discretise_euler", "discretise_zoh"]

_Array = NDArray[np.float64]


def discretise_euler(a: ArrayLike, b: ArrayLike, dt: float) -> tuple[_Array, _Array]:
    """Explicit Euler: I + dt A, dt B (the linear part of paper eq. discrete_model).

    Args:
        a: Continuous-time A, shape (n, n).
        b: Continuous-time B, shape (n, m).
        dt: Time step [s].

    Returns:
        Discrete-time A (n, n) and B (n, m).
    """
    a_c = np.asarray(a, dtype=float)
    return np.eye(len(a_c)) + dt * a_c, dt * np.asarray(b, dtype=float)


def discretise_zoh(a: ArrayLike, b: ArrayLike, dt: float) -> tuple[_Array, _Array]:
    """Exact discretisation for inputs held over the step (zero-order hold); args and returns as `discretise_euler`."""
    a_c, b_c = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    n, m = b_c.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a_c, b_c
    transition = expm(block * dt)
    return transition[:n, :n], transition[:n, n:]


class Controllability(NamedTuple):
    """Controllability of a linear model.

    Attributes:
        matrix: [B, A B, A^2 B, ...], shape (n, n m).
        rank: Its numerical rank; n means controllable.
        smallest_singular_value: How far it is from losing rank.
    """

    matrix: _Array
    rank: int
    smallest_singular_value: float


def controllability(a: ArrayLike, b: ArrayLike) -> Controllability:
    """Kalman's controllability matrix of x' = A x + B u, with its rank and smallest singular value.

    Args:
        a: A, shape (n, n).
        b: B, shape (n, m).

    Returns:
        The matrix, its rank and its smallest singular value.
    """
    a_c, b_c = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    blocks = [b_c]
    for _ in range(len(a_c) - 1):
        blocks.append(a_c @ blocks[-1])
    matrix = np.hstack(blocks)
    singular_values = np.linalg.svd(matrix, compute_uv=False)
    return Controllability(matrix, int(np.linalg.matrix_rank(matrix)), float(singular_values[-1]))
