"""Linear-quadratic balance: the infinite-horizon feedback at the trim, saturated."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import LinAlgError, solve_discrete_are

from m4_dynamics.control.controller import Diagnostics
from m4_dynamics.control.disturbance import DisturbanceEstimator
from m4_dynamics.control.reference import ReferenceTrajectory
from m4_dynamics.control.rotor import RotorModel, with_rotor_lag
from m4_dynamics.errors import ConvergenceError, InvalidSettingError
from m4_dynamics.reduced.kernels import inputs_along
from m4_dynamics.reduced.linear import discretise_zoh
from m4_dynamics.reduced.pendulum import MipParameters, checked_state, linearise

__all__ = ["LqrController", "TrimFeedback", "lqr_gain", "state_count", "trim_feedback"]

_Array = NDArray[np.float64]
Discretisation = Callable[[ArrayLike, ArrayLike, float], tuple[_Array, _Array]]


def lqr_gain(a: ArrayLike, b: ArrayLike, state_weights: ArrayLike, input_weights: ArrayLike) -> tuple[_Array, _Array]:
    """Discrete-time linear-quadratic regulator u = -K x for the cost sum of x' Q x + u' R u.

    Args:
        a: Discrete-time A, shape (n, n).
        b: Discrete-time B, shape (n, m).
        state_weights: Q, shape (n, n), or its diagonal, shape (n,).
        input_weights: R, shape (m, m), or its diagonal, shape (m,).

    Returns:
        Gain K, shape (m, n), and cost-to-go P, shape (n, n): the cost from x on is x' P x.

    Raises:
        ConvergenceError: If the Riccati equation has no stabilising solution, as when A, B is not stabilisable.
    """
    a_d, b_d = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    q, r = _square(state_weights), _square(input_weights)
    try:
        cost_to_go = solve_discrete_are(a_d, b_d, q, r)
    except (LinAlgError, ValueError) as error:
        raise ConvergenceError(f"no linear-quadratic regulator: {error}") from error
    cost_to_go = 0.5 * (cost_to_go + cost_to_go.T)
    gain = np.linalg.solve(r + b_d.T @ cost_to_go @ b_d, b_d.T @ cost_to_go @ a_d)
    return gain, cost_to_go


class TrimFeedback(NamedTuple):
    """Linear-quadratic feedback at the steadiest sample of each slope of a reference.

    Attributes:
        gains: K per distinct slope, shape (slopes, 2, nx); zero rows for inputs that have no range.
        costs: Cost-to-go P per distinct slope, shape (slopes, nx, nx).
        slopes: The distinct slopes, ascending, shape (slopes,) [rad].
        slope_index: For each sample of the reference the position of its slope in these lists, shape (N,).
    """

    gains: _Array
    costs: _Array
    slopes: _Array
    slope_index: NDArray[np.intp]


def trim_feedback(
    parameters: MipParameters,
    reference: ReferenceTrajectory,
    *,
    discretise: Discretisation,
    state_weights: ArrayLike,
    input_weights: ArrayLike,
    input_ranges: ArrayLike,
) -> TrimFeedback:
    """Design the feedback of each slope of a reference.

    The states are nx = 4, or 5 where the thrust lags behind its command: then it is the last one, without a weight of
    its own, and the command is the input.

    Args:
        parameters: The pendulum; its thrust lags if its time constant is above 0.
        reference: What is followed; its samples set the rate.
        discretise: `discretise_zoh` for the feedback of the sampled plant, `discretise_euler` for the plan's model.
        state_weights: Diagonal of Q on (wheel angle, pitch, and their rates), shape (4,).
        input_weights: Diagonal of R on (duty, thrust), shape (2,).
        input_ranges: Upper less lower limit of each input, shape (2,); an input without a range is left out.

    Returns:
        Gains and costs.

    Raises:
        ConvergenceError: If the robot cannot be stabilised at a trim of the reference.
    """
    ranges = np.asarray(input_ranges, dtype=float)
    usable = np.flatnonzero(ranges > 0.0)
    weights = np.asarray(input_weights, dtype=float)[usable]
    states = state_count(parameters, ranges)
    samples, slope_index = reference.steadiest_samples()
    gains, costs = np.zeros((len(samples), 2, states)), np.zeros((len(samples), states, states))
    for i, sample in enumerate(samples):
        a, b = linearise(parameters, reference.slope[sample], reference.state[sample], reference.inputs[sample])
        a_d, b_d = discretise(a, b, reference.time_step)
        if states == 5:
            a_d, b_d = with_rotor_lag(a_d, b_d, RotorModel(parameters, reference.time_step).share)
        weighted = np.pad(np.asarray(state_weights, dtype=float), (0, states - 4))
        gains[i, usable], costs[i] = lqr_gain(a_d, b_d[:, usable], weighted, weights)
    return TrimFeedback(gains, costs, np.asarray(reference.slope[samples]), slope_index)


def state_count(parameters: MipParameters, input_ranges: ArrayLike) -> int:
    """States of a controller's model: 5 where there is thrust and it lags, else 4.

    Args:
        parameters: The pendulum.
        input_ranges: Upper less lower limit of each input, shape (2,).

    Returns:
        4 or 5.
    """
    return 5 if parameters.thrust_time_constant > 0.0 and float(np.asarray(input_ranges)[1]) > 0.0 else 4


class LqrController:
    """Follows a reference with the saturated LQR of the trim on each slope.

    It knows nothing of the ground constraints: what it asks for may slip. Where the thrust lags, it is a state, known
    from the commands.

    Attributes:
        gains: One gain per distinct slope of the reference, shape (slopes, 2, nx).
        rotor: The thrust that the commands have led to.
        estimator: Of the disturbance; None without disturbance rejection.
    """

    def __init__(
        self,
        parameters: MipParameters,
        reference: ReferenceTrajectory,
        *,
        state_weights: tuple[float, float, float, float] = (20.0, 1e4, 5.0, 25.0),
        input_weights: tuple[float, float] = (500.0, 0.5),
        duty_limits: tuple[float, float] = (-1.0, 1.0),
        thrust_limits: tuple[float, float] = (0.0, 43.2),
        disturbance_rejection: bool = False,
    ) -> None:
        """Compute the gains.

        Args:
            parameters: The pendulum.
            reference: What to follow.
            state_weights: Diagonal of Q on (wheel angle, pitch, and their rates).
            input_weights: Diagonal of R on (duty, thrust).
            duty_limits: Bounds of the motor duty.
            thrust_limits: Bounds of the thrust [N].
            disturbance_rejection: Whether to estimate what the model lacks (`control.disturbance`) and to hold the
                reference against it, by other inputs alone.

        Raises:
            ConvergenceError: If the robot cannot be stabilised at a trim of the reference.
            InvalidSettingError: If the limits leave nothing between them.
        """
        for name, limits in (("duty_limits", duty_limits), ("thrust_limits", thrust_limits)):
            if not limits[0] <= limits[1]:
                raise InvalidSettingError(name, limits, "(lower, upper) with lower <= upper")
        self._reference = reference
        self._lower = np.array([duty_limits[0], thrust_limits[0]])
        self._upper = np.array([duty_limits[1], thrust_limits[1]])
        feedback = trim_feedback(
            parameters,
            reference,
            discretise=discretise_zoh,
            state_weights=state_weights,
            input_weights=input_weights,
            input_ranges=self._upper - self._lower,
        )
        self.gains: _Array = feedback.gains
        self._costs, self._slope_index = feedback.costs, feedback.slope_index
        self.estimator = DisturbanceEstimator(parameters, reference) if disturbance_rejection else None
        self._nominal: _Array = parameters.as_array()
        self.rotor = RotorModel(parameters, reference.time_step)
        self._lagging = self.gains.shape[2] == 5
        self._commands: _Array = reference.inputs.copy()
        if self._lagging:
            self._commands[:, 1] = self.rotor.commands_for(reference.inputs[:, 1])
        self.reset()

    @property
    def diagnostics(self) -> Diagnostics:
        """Of the last call of `control`; the cost is the infinite-horizon cost of the error, e' P e."""
        return self._diagnostics

    def reset(self) -> None:
        """Forget the last step and the disturbance; the rotors turn as the reference starts."""
        self._diagnostics = Diagnostics()
        self.rotor.reset(float(self._reference.inputs[0, 1]))
        if self.estimator is not None:
            self.estimator.reset()

    def control(self, step: int, state: _Array) -> _Array:
        """Inputs for one sample, see `BalanceController.control`."""
        x = checked_state(state)
        sample = self._reference.sample_index(step)
        index = self._slope_index[sample]
        wanted, correction = self._commands[sample], np.zeros(2)
        if self.estimator is not None:
            self.estimator.measure(step, x)
            correction = self._against_disturbance(sample, self.estimator.model)
        error = x - self._reference.state[sample]
        if self._lagging:
            thrust_error = self.rotor.thrust_at(step) - self._reference.inputs[sample, 1] - correction[1]
            error = np.append(error, thrust_error)
        inputs = wanted + correction - self.gains[index] @ error
        self._diagnostics = Diagnostics(cost=float(error @ self._costs[index] @ error))
        saturated: _Array = np.clip(inputs, self._lower, self._upper)
        thrust = self.rotor.command(float(saturated[1]))
        if self.estimator is not None:
            self.estimator.apply(step, float(self._reference.slope[sample]), np.array([saturated[0], thrust]))
        return saturated

    def _against_disturbance(self, sample: int, model: _Array) -> _Array:
        """Change of the inputs with which the disturbed pendulum follows a sample of the reference."""
        reference, one = self._reference, slice(sample, sample + 1)
        wanted = np.empty((1, 2))
        slope, states, inputs = reference.slope[one], reference.state[one], reference.inputs[one]
        inputs_along(self._nominal, model, slope, slope, states, inputs, 0.0, self._lower, self._upper, wanted)
        return np.asarray(wanted[0] - inputs[0])


def _square(weights: ArrayLike) -> _Array:
    matrix = np.asarray(weights, dtype=float)
    return np.diag(matrix) if matrix.ndim == 1 else matrix
