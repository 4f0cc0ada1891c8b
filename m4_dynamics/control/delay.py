"""A known delay between command and effect, taken out by predicting the state that the command will meet."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.controller import BalanceController, Diagnostics
from m4_dynamics.control.reference import ReferenceTrajectory
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.reduced.kernels import mip_step
from m4_dynamics.reduced.pendulum import MipParameters, checked_state

__all__ = ["DelayCompensator"]

_Array = NDArray[np.float64]


class DelayCompensator:
    """A balance controller whose commands act a few samples late.

    The commands still on their way carry the measured state forward on the reduced model, with the disturbance that the
    controller within has found. That one decides on the state, and follows the reference, of the sample in which its
    command will act.

    Attributes:
        controller: The controller within.
        delay: Samples between a command and its effect.
    """

    def __init__(
        self,
        controller: BalanceController,
        parameters: MipParameters,
        reference: ReferenceTrajectory,
        *,
        delay: int,
        rotor_time_constant: float = 0.0,
    ) -> None:
        """Wrap a controller.

        Args:
            controller: The controller.
            parameters: The pendulum.
            reference: What the controller follows.
            delay: Samples between a command and its effect, >= 1.
            rotor_time_constant: First-order lag of the thrust behind a command that acts [s].

        Raises:
            InvalidSettingError: The delay is below one sample, or the lag is not a time.
        """
        if delay < 1:
            raise InvalidSettingError("delay", delay, "a whole number of samples >= 1")
        if not (math.isfinite(rotor_time_constant) and rotor_time_constant >= 0.0):
            raise InvalidSettingError("rotor_time_constant [s]", rotor_time_constant, "a finite time >= 0")
        self.controller = controller
        self.delay = delay
        self._reference = reference
        # What a controller has found its model to lack acts on the way, too: without it an offset would stay.
        estimator = getattr(controller, "estimator", None)
        self._model: _Array = parameters.as_array() if estimator is None else estimator.model
        self._on_the_way = np.tile(reference.inputs[0], (delay, 1))
        self._thrust = float(reference.inputs[0, 1])
        step = reference.time_step
        self._share = -math.expm1(-step / rotor_time_constant) if rotor_time_constant > 0.0 else 1.0
        # Mean thrust over a sample, on the way from where it was to where it is commanded.
        self._mean_share = 1.0 - self._share * rotor_time_constant / step

    @property
    def diagnostics(self) -> Diagnostics:
        """Of the controller within, in its last call."""
        return self.controller.diagnostics

    def reset(self) -> None:
        """Forget the commands on their way; the first of the reference stands for what acted before."""
        self.controller.reset()
        self._on_the_way[:] = self._reference.inputs[0]
        self._thrust = float(self._reference.inputs[0, 1])

    def predict(self, step: int, state: _Array) -> _Array:
        """State in which the next command will act.

        Args:
            step: Index into the reference of the state's sample.
            state: Measured state, shape (4,).

        Returns:
            Shape (4,), a fresh array.
        """
        ahead, thrust, reference = checked_state(state).copy(), self._thrust, self._reference
        acting = np.empty(2)
        for k, (duty, wanted) in enumerate(self._on_the_way):
            acting[:] = duty, thrust + self._mean_share * (wanted - thrust)
            thrust += self._share * (wanted - thrust)
            slope = float(reference.slope[reference.sample_index(step + k)])
            mip_step(self._model, slope, ahead, acting, reference.time_step, 1, ahead)
        return ahead

    def control(self, step: int, state: _Array) -> _Array:
        """Inputs for one sample, see `BalanceController.control`."""
        inputs = self.controller.control(step + self.delay, self.predict(step, state))
        self._thrust += self._share * (self._on_the_way[0, 1] - self._thrust)
        self._on_the_way[:-1] = self._on_the_way[1:]
        self._on_the_way[-1] = inputs
        return inputs
