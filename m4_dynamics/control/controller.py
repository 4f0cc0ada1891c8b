"""What every balancing controller offers, and what it says about its last step."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

__all__ = ["BalanceController", "ControlStatus", "Diagnostics"]


class ControlStatus(IntEnum):
    """How the last control step came about.

    Attributes:
        SOLVED: The optimiser converged; a feedback law that needs no optimiser always reports this.
        ITERATION_LIMIT: The optimiser stopped at its iteration cap, its answer was not used.
        SOLVER_FAILED: The optimiser gave any other verdict, its answer was not used.
        PREDICTION_NOT_FINITE: The model's prediction overflowed, so there was no problem to solve.
    """

    SOLVED = 0
    ITERATION_LIMIT = 1
    SOLVER_FAILED = 2
    PREDICTION_NOT_FINITE = 3


class Diagnostics(NamedTuple):
    """What a controller reports about its last step.

    Attributes:
        cost: Cost of the plan (for an MPC: the paper's J, eq. mpc_formulation), else of the tracking error.
        slack: Ground-constraint violation that the plan could not avoid [N]; 0 where there are no such constraints.
        status: A `ControlStatus`.
        iterations: Iterations of the optimiser, summed over the step.
        fallback: Whether the inputs come from the stated fallback instead of the optimiser.
        residual: Size of the last optimisation step, largest entry in units of half an input's range.
    """

    cost: float = 0.0
    slack: float = 0.0
    status: int = ControlStatus.SOLVED
    iterations: int = 0
    fallback: bool = False
    residual: float = 0.0


@runtime_checkable
class BalanceController(Protocol):
    """A controller of the reduced model at a fixed rate."""

    @property
    def diagnostics(self) -> Diagnostics:
        """What happened in the last call of `control`."""
        ...

    def reset(self) -> None:
        """Forget everything learnt since the start (plans, integrals, counters)."""
        ...

    def control(self, step: int, state: NDArray[np.float64]) -> NDArray[np.float64]:
        """Inputs for one sample.

        Args:
            step: Index into the reference trajectory; beyond its end the last sample holds.
            state: (absolute wheel angle, pitch, and their rates), shape (4,) [rad, rad/s].

        Returns:
            (motor duty, thrust [N]), shape (2,), a fresh array within the limits of the inputs.

        Raises:
            NonFiniteError: If the state holds NaN or infinity; the controller can be used on afterwards.
        """
        ...
