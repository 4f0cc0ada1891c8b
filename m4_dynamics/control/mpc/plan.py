"""What the MPC intends to do over its horizon."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Plan"]

_Array = NDArray[np.float64]


class Plan:
    """Planned inputs and the states they lead to.

    Attributes:
        states: Predicted x_0 .. x_n, shape (n_h + 1, nx).
        inputs: Planned u_0 .. u_{n-1}, shape (n_h, 2).
        step: Control step that u_0 belongs to, None while there is no plan.
        age: Steps since the plan was optimised: 0 if it is the last step's own.
    """

    __slots__ = ("age", "inputs", "states", "step")

    def __init__(self, horizon: int, states: int = 4) -> None:
        """Allocate a plan that does not exist yet.

        Args:
            horizon: Number of samples n_h.
            states: Number of states nx.
        """
        self.states: _Array = np.zeros((horizon + 1, states))
        self.inputs: _Array = np.zeros((horizon, 2))
        self.step: int | None = None
        self.age = 0

    def clear(self) -> None:
        """Drop the plan."""
        self.step = None
        self.age = 0

    def move_to(self, step: int) -> bool:
        """Shift the inputs so that the first one belongs to the given step; the last one is repeated.

        Args:
            step: A control step.

        Returns:
            Whether there is such a plan; if not (none yet, a step before its own, or all of it past) it is dropped.
        """
        if self.step is None:
            return False
        shift = step - self.step
        if shift == 0:
            return True
        inputs = self.inputs
        if not 0 < shift < inputs.shape[0]:
            self.clear()
            return False
        inputs[:-shift] = inputs[shift:]
        if shift > 1:
            inputs[-shift:] = inputs[-shift - 1]
        self.step = step
        self.age += shift
        return True
