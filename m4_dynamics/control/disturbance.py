"""What the pendulum does not know of the robot, estimated as two constant generalised forces.

A wrong mass, a CoM that has moved, a weak rotor or a steady wind all end up, at rest and at steady speed, as a
generalised force d_1 on the wheel angle and another, d_2, on the pitch beside the model's own:

    M(q) q'' + h(q, q') = B_q u + d,   d' = 0.

A steady-state Kalman filter estimates state and d together from the measured state and the inputs that were applied. As
there are as many disturbances as coordinates, the estimate leaves no steady difference between model and robot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solve_discrete_are

from m4_dynamics.control.reference import ReferenceTrajectory
from m4_dynamics.errors import ConvergenceError, InvalidSettingError
from m4_dynamics.reduced.kernels import DISTURBANCE_PITCH, DISTURBANCE_WHEEL, mip_step
from m4_dynamics.reduced.linear import discretise_zoh
from m4_dynamics.reduced.pendulum import MipParameters, linearise, mass_matrix

__all__ = ["DisturbanceEstimator", "DisturbanceNoise", "disturbance_filter_gain"]

_Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class DisturbanceNoise:
    """How far the filter trusts measurements and model; standard deviations of white noise.

    Only ratios matter. The walk sets how fast the estimate follows, with the defaults within some 0.2 s. Angles that
    are trusted much more than rates make it lean on their agreement, and then a gyro's bias moves the wheels.

    Attributes:
        angle: Of measured wheel angle and pitch [rad].
        rate: Of their measured rates [rad/s].
        acceleration: Accelerations that the pendulum does not have (legs that give, wheels that creep), constant over
            one sample [rad/s^2].
        walk: Growth of the disturbance, as a share of the robot's weight per square root of time [1/sqrt(s)]; the
            weight acts at the wheel's radius for d_1, at the CoM's distance for d_2.
        limit: Largest estimate, as a share of the weight at the same levers.
        gate: An innovation beyond this many of its standard deviations is a jump (a push, the wheel meeting a corner),
            not a disturbance that stays: the filter goes on from the measurement and keeps its estimate.
    """

    angle: float = 3e-3
    rate: float = 2e-2
    acceleration: float = 1.0
    walk: float = 0.1
    limit: float = 0.5
    gate: float = 6.0

    def __post_init__(self) -> None:
        """Refuse what is not positive.

        Raises:
            InvalidSettingError: Names the entry.
        """
        for name in ("angle", "rate", "acceleration", "walk", "limit", "gate"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InvalidSettingError(f"disturbance noise: {name}", value, "a finite number > 0")


def disturbance_levers(parameters: MipParameters) -> _Array:
    """Generalised forces (d_1, d_2) that the robot's weight exerts at the wheel's radius and at its CoM's distance.

    Args:
        parameters: The pendulum.

    Returns:
        Shape (2,) [N m].
    """
    com_distance = float(np.hypot(*parameters.com_in_body)) * parameters.mass_body / parameters.mass
    return parameters.weight * np.array([parameters.wheel_radius, com_distance])


def disturbance_filter_gain(
    parameters: MipParameters, slope: float, state: _Array, inputs: _Array, *, time_step: float, noise: DisturbanceNoise
) -> tuple[_Array, _Array]:
    """Gain of the steady-state Kalman filter for (state, disturbance) about a trim.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        state: Where to linearise, shape (4,).
        inputs: (duty, thrust [N]) there, shape (2,).
        time_step: Between measurements [s].
        noise: What the filter assumes.

    Returns:
        Gain on the innovation (measured less predicted state), shape (6, 4), and the innovation's covariance, (4, 4).

    Raises:
        ConvergenceError: If the filter's Riccati equation has no stabilising solution.
    """
    a_continuous, _ = linearise(parameters, slope, state, inputs)
    force_map = np.vstack([np.zeros((2, 2)), np.linalg.inv(mass_matrix(parameters, slope, state))])
    a, force = discretise_zoh(a_continuous, force_map, time_step)
    transition = np.block([[a, force], [np.zeros((2, 4)), np.eye(2)]])
    measured = np.eye(4, 6)
    walk = noise.walk * disturbance_levers(parameters)
    process = np.diag([0.0, 0.0, *[(noise.acceleration * time_step) ** 2] * 2, *(walk**2 * time_step)])
    measurement = np.diag([noise.angle**2] * 2 + [noise.rate**2] * 2)
    try:
        covariance = solve_discrete_are(transition.T, measured.T, process, measurement)
    except (LinAlgError, ValueError) as error:
        raise ConvergenceError(f"no disturbance filter: {error}") from error
    innovation = measured @ covariance @ measured.T + measurement
    return np.linalg.solve(innovation, measured @ covariance).T, innovation


class DisturbanceEstimator:
    """Steady-state Kalman filter for the generalised forces that the pendulum lacks.

    The filter's own state serves the estimate only: controllers act on the measured state, without its lag.

    Attributes:
        model: The pendulum's parameter vector with the estimate in its entries for the disturbance; changes with it.
        gains: One gain per distinct slope of the reference, shape (slopes, 6, 4).
        gates: Largest innovations that count, per slope, shape (slopes, 4) [rad, rad/s].
        limits: Largest estimates, shape (2,) [N m].
    """

    __slots__ = (
        "_last_inputs",
        "_last_slope",
        "_last_step",
        "_predicted",
        "_slope_index",
        "_time_step",
        "gains",
        "gates",
        "limits",
        "model",
    )

    def __init__(
        self, parameters: MipParameters, reference: ReferenceTrajectory, *, noise: DisturbanceNoise | None = None
    ) -> None:
        """Design the filter at the steadiest sample of the reference on each slope.

        Args:
            parameters: The pendulum.
            reference: What the controller follows.
            noise: What the filter assumes, default `DisturbanceNoise()`.

        Raises:
            ConvergenceError: If a filter's Riccati equation has no stabilising solution.
        """
        noise = noise if noise is not None else DisturbanceNoise()
        samples, self._slope_index = reference.steadiest_samples()
        gains, gates = [], []
        for sample in samples:
            gain, covariance = disturbance_filter_gain(
                parameters,
                float(reference.slope[sample]),
                reference.state[sample],
                reference.inputs[sample],
                time_step=reference.time_step,
                noise=noise,
            )
            gains.append(gain)
            gates.append(noise.gate * np.sqrt(np.diag(covariance)))
        self.gains: _Array = np.array(gains)
        self.gates: _Array = np.array(gates)
        self.limits: _Array = noise.limit * disturbance_levers(parameters)
        self.model: _Array = parameters.as_array()
        self._time_step = reference.time_step
        self._predicted: _Array = np.zeros(4)
        self._last_inputs: _Array = np.zeros(2)
        self._last_slope = 0.0
        self._last_step: int | None = None

    @property
    def estimate(self) -> _Array:
        """(d_1 on the wheel angle, d_2 on the pitch), shape (2,), a fresh array [N m]."""
        return self.model[DISTURBANCE_WHEEL : DISTURBANCE_PITCH + 1].copy()

    def reset(self) -> None:
        """Back to no disturbance."""
        self.model[DISTURBANCE_WHEEL : DISTURBANCE_PITCH + 1] = 0.0
        self._last_step = None

    def measure(self, step: int, state: _Array, *, hold: bool = False) -> None:
        """Take in the measurement of a control step, before the inputs of that step are chosen.

        After a gap (steps left out, or one repeated) the filter starts from the measurement, with the estimate it has.

        Args:
            step: The control step, >= 0.
            state: The measured state, shape (4,), finite.
            hold: Whether the pendulum is known not to describe the robot now, as while its wheels touch two faces of
                the ground: the estimate stays as it is.
        """
        if hold or self._last_step is None or step != self._last_step + 1:
            self._predicted[:] = state
            return
        mip_step(self.model, self._last_slope, self._predicted, self._last_inputs, self._time_step, 1, self._predicted)
        index = self._slope_index[min(step, len(self._slope_index) - 1)]
        _correct(self.gains[index], self.gates[index], self.limits, state, self._predicted, self.model)

    def apply(self, step: int, slope: float, inputs: _Array) -> None:
        """Take in what was applied over the sample that starts with a control step.

        Args:
            step: The control step.
            slope: Inclination of the ground there [rad].
            inputs: (duty, thrust [N]), shape (2,).
        """
        self._last_step = step
        self._last_slope = slope
        self._last_inputs[:] = inputs


@njit(cache=True, error_model="numpy")
def _correct(gain: _Array, gate: _Array, limits: _Array, measured: _Array, predicted: _Array, model: _Array) -> None:
    """Correct prediction (4,) and disturbance in place; after a jump the measurement is the new prediction."""
    innovation = np.empty(4)
    for i in range(4):
        innovation[i] = measured[i] - predicted[i]
        if not abs(innovation[i]) <= gate[i]:
            predicted[:] = measured
            return
    for i in range(4):
        for j in range(4):
            predicted[i] += gain[i, j] * innovation[j]
    for i in range(2):
        value = model[DISTURBANCE_WHEEL + i]
        for j in range(4):
            value += gain[4 + i, j] * innovation[j]
        model[DISTURBANCE_WHEEL + i] = min(max(value, -limits[i]), limits[i])
