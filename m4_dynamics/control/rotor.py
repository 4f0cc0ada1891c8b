"""Thrust that follows its command with a first-order lag, as controllers count on it: T f' = command - f."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.reduced.kernels import thrust_share
from m4_dynamics.reduced.pendulum import MipParameters

__all__ = ["RotorModel", "with_rotor_lag"]

_Array = NDArray[np.float64]


class RotorModel:
    """The thrust that the rotors must be giving, from the commands they got: nothing measures it.

    Attributes:
        share: Part of the way to the command that the thrust goes in one sample; 1 without lag.
        thrust: At the start of the last step asked for [N].
    """

    __slots__ = ("_command", "_step", "share", "thrust")

    def __init__(self, parameters: MipParameters, time_step: float) -> None:
        """Set the model up, at rest.

        Args:
            parameters: The pendulum, with its rotors' time constant.
            time_step: Time between commands [s].
        """
        self.share = float(thrust_share(parameters.as_array(), time_step))
        self.reset(0.0)

    def reset(self, thrust: float) -> None:
        """Start from a known thrust.

        Args:
            thrust: What the rotors give now [N].
        """
        self.thrust = self._command = thrust
        self._step: int | None = None

    def thrust_at(self, step: int) -> float:
        """Thrust at the start of a control step, the last command held since.

        Args:
            step: The control step; if it is not after the last commanded one, nothing has changed since that.

        Returns:
            The thrust [N].
        """
        if self._step is not None and step > self._step:
            self.thrust += (1.0 - (1.0 - self.share) ** (step - self._step)) * (self._command - self.thrust)
        self._step = step
        return self.thrust

    def command(self, thrust: float) -> float:
        """Command the step last asked for.

        Args:
            thrust: The command [N].

        Returns:
            Mean thrust over that step's sample [N].
        """
        self._command = thrust
        if self.share == 1.0:
            return thrust
        return self.thrust + 0.5 * self.share * (thrust - self.thrust)

    def commands_for(self, thrust: ArrayLike) -> _Array:
        """Commands that make the thrust take given values, sample by sample; the last value is held.

        Args:
            thrust: Wanted thrust, shape (n,) [N].

        Returns:
            Commands, shape (n,) [N]; they may lie outside what the rotors can do.
        """
        wanted = np.asarray(thrust, dtype=np.float64)
        return wanted + np.diff(wanted, append=wanted[-1:]) / self.share


def with_rotor_lag(a: ArrayLike, b: ArrayLike, share: float) -> tuple[_Array, _Array]:
    """Add the thrust to the states of a discrete model; its command takes the thrust's place among the inputs.

    Args:
        a: Discrete A of (wheel angle, pitch, and their rates), shape (4, 4).
        b: Discrete B of (duty, thrust), shape (4, 2).
        share: Part of the way to its command that the thrust goes in one step.

    Returns:
        A, shape (5, 5), and B, shape (5, 2), of the model with the thrust as fifth state.
    """
    a_4, b_4 = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    a_5 = np.block([[a_4, b_4[:, 1:]], [np.zeros((1, 4)), np.array([[1.0 - share]])]])
    b_5 = np.vstack([np.column_stack([b_4[:, 0], np.zeros(4)]), [[0.0, share]]])
    return a_5, b_5
