"""How much of the ground's friction a run uses, for plots and read-outs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["friction_use_in_plane", "worst_wheel"]


def friction_use_in_plane(force: NDArray[np.float64], friction: float) -> NDArray[np.float64]:
    """Share of the available friction in use along the slope.

    Args:
        force: Forces of the ground (along the slope, normal), shape (n, 2) [N].
        friction: Static friction coefficient.

    Returns:
        |f_x| / (mu_s f_n), shape (n,); NaN where the wheels don't press on the ground.
    """
    available = friction * force[:, 1]
    use = np.full(len(force), np.nan)
    np.divide(np.abs(force[:, 0]), available, out=use, where=available > 1e-9)
    return use


def worst_wheel(use: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest friction use of any wheel on the ground.

    Args:
        use: Friction use per wheel, shape (n, wheels); NaN without contact.

    Returns:
        The largest, shape (n,); NaN where no wheel touches.
    """
    return np.asarray(np.fmax.reduce(use, axis=1, initial=np.nan))
