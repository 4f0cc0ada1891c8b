"""The optimal control problem of the MPC: model, reference, costs and limits, fixed for a run."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.lqr import state_count, trim_feedback
from m4_dynamics.control.mpc import kernels
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.control.reference import ReferenceTrajectory
from m4_dynamics.control.rotor import RotorModel
from m4_dynamics.control.slope_profile import SlopeProfile
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.reduced.linear import discretise_euler
from m4_dynamics.reduced.pendulum import MipParameters

__all__ = ["Problem"]

_Array = NDArray[np.float64]


class Problem:
    """What is minimised, subject to what, at every step of a run (paper, eq. mpc_formulation).

    The arrays of the reference are lengthened by one horizon in which the last sample holds, so that the window of each
    step is a plain slice.

    Attributes:
        settings: The settings.
        parameters: The pendulum's parameter vector, see `reduced.kernels`.
        weights: Weights and limits, see `kernels`.
        last_step: Index of the last sample of the reference.
        rotor: How the thrust follows its command.
        profile: The ground by place; None takes that of the reference, by time.
        states: Reference of the states, shape (N + n_h, nx): nx = 4, or 5 with the thrust as a state where it lags.
        applied: Duty and thrust that belong to it, shape (N + n_h, 2): the trim's while at rest.
        inputs: Inputs that belong to it, shape (N + n_h, 2): as `applied`, with the thrust's command where it lags.
        costed_inputs: What the input cost is measured from, shape (N + n_h, 2).
        slopes: Inclination at each sample, shape (N + n_h,).
        terminals: Weight of the last error per sample at which the horizon may end, list of N + n_h arrays (nx, nx).
        gains: LQR gain at the trim per sample, list of N + n_h arrays (2, nx).
        piece_terminals: Weight of the last error per piece of the profile: that of the reference's nearest slope.
        piece_gains: LQR gain per piece of the profile, likewise.
    """

    __slots__ = (
        "applied",
        "costed_inputs",
        "gains",
        "inputs",
        "last_step",
        "parameters",
        "piece_gains",
        "piece_terminals",
        "profile",
        "rotor",
        "settings",
        "slopes",
        "states",
        "terminals",
        "weights",
    )

    def __init__(
        self,
        parameters: MipParameters,
        reference: ReferenceTrajectory,
        settings: MpcSettings,
        profile: SlopeProfile | None = None,
    ) -> None:
        """Set the problem up.

        Args:
            parameters: The pendulum.
            reference: What to follow, sampled at the settings' time step.
            settings: The settings.
            profile: The ground by place, over the same wheel angle as the reference's.

        Raises:
            InvalidSettingError: If reference and settings disagree on the time step.
            ConvergenceError: If the robot cannot be stabilised at a trim of the reference.
        """
        if not math.isclose(reference.time_step, settings.time_step, rel_tol=1e-6):
            raise InvalidSettingError(
                "time step of the reference", reference.time_step, f"the controller's, {settings.time_step} s"
            )
        horizon = settings.horizon
        self.settings = settings
        self.parameters: _Array = parameters.as_array()
        self.weights: _Array = _pack_weights(settings)
        self.last_step = len(reference) - 1
        self.rotor = RotorModel(parameters, settings.time_step)
        self.profile = profile
        self.states: _Array = _hold(reference.state, horizon)
        self.applied: _Array = _hold(reference.inputs, horizon)
        self.inputs = self.applied
        self.slopes: _Array = _hold(reference.slope, horizon)
        lower, upper = np.transpose([settings.duty_limits, settings.thrust_limits])
        if state_count(parameters, upper - lower) == 5:
            self.states = np.column_stack([self.states, self.applied[:, 1]])
            self.inputs = np.column_stack([self.applied[:, 0], self.rotor.commands_for(self.applied[:, 1])])
        self.costed_inputs = self.inputs if settings.input_reference == "trim" else np.zeros_like(self.inputs)

        # One Riccati solution per distinct slope, with the prediction's own discretisation: then the last stage's cost
        # continues the ones before exactly, and without active constraints the MPC is the LQR.
        feedback = trim_feedback(
            parameters,
            reference,
            discretise=discretise_euler,
            state_weights=settings.state_weights,
            input_weights=settings.input_weights,
            input_ranges=upper - lower,
        )
        last_weights = list(feedback.costs)
        if settings.terminal_cost == "none":
            count = self.states.shape[1]
            last_weights = [np.diag(self.weights[kernels.STATE_WEIGHTS :][:count])] * len(last_weights)
        per_sample = _hold(feedback.slope_index, horizon)
        self.gains: list[_Array] = [feedback.gains[index] for index in per_sample]
        self.terminals: list[_Array] = [last_weights[index] for index in per_sample]
        pieces = np.zeros(0) if profile is None else profile.slopes
        nearest = np.abs(np.subtract.outer(pieces, feedback.slopes)).argmin(axis=1)
        self.piece_gains: list[_Array] = [feedback.gains[index] for index in nearest]
        self.piece_terminals: list[_Array] = [last_weights[index] for index in nearest]


_Samples = TypeVar("_Samples", NDArray[np.float64], NDArray[np.intp])


def _hold(samples: _Samples, count: int) -> _Samples:
    """Append the last sample `count` times; a writable, contiguous copy."""
    return np.concatenate([samples, np.repeat(samples[-1:], count, axis=0)])


def _pack_weights(settings: MpcSettings) -> _Array:
    weights = np.zeros(kernels.WEIGHT_COUNT)
    weights[kernels.STATE_WEIGHTS : kernels.STATE_WEIGHTS + 4] = settings.state_weights
    weights[kernels.INPUT_WEIGHTS : kernels.INPUT_WEIGHTS + 2] = settings.input_weights
    for i, (lower, upper) in enumerate((settings.duty_limits, settings.thrust_limits)):
        weights[kernels.LOWER + i] = lower
        weights[kernels.UPPER + i] = upper
        # Half the range makes the unknowns comparable; an input that its limits pin down needs no unit of its own.
        weights[kernels.INPUT_SCALE + i] = 0.5 * (upper - lower) if upper > lower else 1.0
    weights[kernels.FRICTION] = settings.friction_plan
    weights[kernels.NORMAL_MIN] = settings.normal_force_min
    weights[kernels.SLACK_SCALE] = SLACK_SCALE
    weights[kernels.SLACK_WEIGHT] = settings.slack_weight
    weights[kernels.SLACK_CURVATURE] = settings.slack_curvature
    return weights


#: Unit of the slack variable in the QP [N]: comparable with what one unit of the other unknowns does to the forces.
SLACK_SCALE = 10.0
