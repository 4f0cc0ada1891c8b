"""PID balance on the wheels alone, for flat or gently sloping ground; the thrust stays at the trim's.

The motor duty is the sum of a PD loop on the pitch and a PID loop on the wheel angle (paper, section IV). All five
gains come from one linear-quadratic design on the reduced model with the duty as its only input and the integral of the
wheel error as a fifth state: no gain is tuned by hand.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.controller import Diagnostics
from m4_dynamics.control.lqr import lqr_gain
from m4_dynamics.control.reference import ReferenceTrajectory
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.reduced.linear import discretise_zoh
from m4_dynamics.reduced.pendulum import MipParameters, checked_state, linearise

__all__ = ["PidController", "PidGains", "pid_gains"]

_Array = NDArray[np.float64]


class PidGains(NamedTuple):
    """Duty per unit of error; an error is the state minus its reference.

    Attributes:
        wheel_proportional: [1/rad].
        wheel_integral: [1/(rad s)].
        wheel_derivative: [s/rad].
        pitch_proportional: [1/rad].
        pitch_derivative: [s/rad].
    """

    wheel_proportional: float
    wheel_integral: float
    wheel_derivative: float
    pitch_proportional: float
    pitch_derivative: float


def pid_gains(
    parameters: MipParameters,
    slope: float,
    state: _Array,
    inputs: _Array,
    *,
    time_step: float,
    state_weights: tuple[float, float, float, float] = (10.0, 100.0, 5.0, 25.0),
    integral_weight: float = 5.0,
    duty_weight: float = 50.0,
) -> PidGains:
    """Gains of the wheels-only balance from the linear-quadratic design at an equilibrium.

    The weights are softer than the MPC's: with those the wheels would be asked for full duty at 1.2 deg of pitch, which
    slides them on the full model and ends in a limit cycle. The default reaches full duty at 3.5 deg.

    Args:
        parameters: The pendulum.
        slope: Inclination of the ground [rad].
        state: The equilibrium, shape (4,).
        inputs: Its duty and thrust, shape (2,).
        time_step: Of the controller [s].
        state_weights: Diagonal of Q on (wheel angle, pitch, and their rates).
        integral_weight: Weight of the integral of the wheel error [1/(rad s)^2].
        duty_weight: Weight of the duty.

    Returns:
        The gains.

    Raises:
        ConvergenceError: If the wheels alone cannot stabilise this equilibrium.
    """
    a, b = linearise(parameters, slope, state, inputs)
    a_augmented = np.zeros((5, 5))
    a_augmented[:4, :4] = a
    a_augmented[4, 0] = 1.0
    b_augmented = np.zeros((5, 1))
    b_augmented[:4, 0] = b[:, 0]
    gain, _ = lqr_gain(
        *discretise_zoh(a_augmented, b_augmented, time_step), (*state_weights, integral_weight), (duty_weight,)
    )
    wheel, pitch, wheel_rate, pitch_rate, integral = (float(g) for g in gain[0])
    return PidGains(wheel, integral, wheel_rate, pitch, pitch_rate)


class PidController:
    """Follows a reference with the motor duty alone.

    Attributes:
        gains: The gains, designed at the steadiest sample of the reference.
    """

    def __init__(
        self,
        parameters: MipParameters,
        reference: ReferenceTrajectory,
        *,
        gains: PidGains | None = None,
        duty_limits: tuple[float, float] = (-1.0, 1.0),
    ) -> None:
        """Design the gains.

        Args:
            parameters: The pendulum.
            reference: What to follow.
            gains: Gains to use instead of the designed ones.
            duty_limits: Bounds of the motor duty.

        Raises:
            ConvergenceError: If the wheels alone cannot stabilise the reference's equilibrium.
            InvalidSettingError: If the limits leave nothing between them.
        """
        if not duty_limits[0] < duty_limits[1]:
            raise InvalidSettingError("duty_limits", duty_limits, "(lower, upper) with lower < upper")
        self._reference = reference
        self._duty_limits = duty_limits
        if gains is None:
            sample = reference.steadiest_samples()[0][0]
            gains = pid_gains(
                parameters,
                float(reference.slope[sample]),
                reference.state[sample],
                reference.inputs[sample],
                time_step=reference.time_step,
            )
        self.gains = gains
        self._integral = 0.0
        self._diagnostics = Diagnostics()

    @property
    def diagnostics(self) -> Diagnostics:
        """Of the last call of `control`; a PID has no cost."""
        return self._diagnostics

    def reset(self) -> None:
        """Clear the integral."""
        self._integral = 0.0

    def control(self, step: int, state: _Array) -> _Array:
        """Inputs for one sample, see `BalanceController.control`; the thrust is the reference's."""
        x = checked_state(state)
        sample = self._reference.sample_index(step)
        wheel, pitch, wheel_rate, pitch_rate = (x - self._reference.state[sample]).tolist()
        gains = self.gains
        duty = float(self._reference.inputs[sample, 0]) - (
            gains.wheel_proportional * wheel
            + gains.wheel_integral * self._integral
            + gains.wheel_derivative * wheel_rate
            + gains.pitch_proportional * pitch
            + gains.pitch_derivative * pitch_rate
        )
        lower, upper = self._duty_limits
        saturated = min(max(duty, lower), upper)
        if saturated == duty:
            # While the duty saturates the integral waits: it would only wind up.
            self._integral += wheel * self._reference.time_step
        return np.array([saturated, self._reference.inputs[sample, 1]])
