"""What one step of the MPC aims at: its window of the reference, corrected for what is known of the robot by then."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.mpc.kernels import FRICTION
from m4_dynamics.control.mpc.problem import Problem
from m4_dynamics.reduced.kernels import inputs_along, pitch_shift_within_limits

__all__ = ["Target"]

_Array = NDArray[np.float64]

#: Friction that a target must leave unused, as a factor: on the cone's surface itself the plan could not manoeuvre.
FRICTION_ROOM = 1.03


class Target:
    """References, ground and end weight of one horizon, with the model that predicts over it.

    Without disturbances these are plain windows of the problem's arrays. With an estimate d of the disturbance wheel
    angle and pitch stay what the reference says, and the inputs change by -B_q^-1 d, which holds them there exactly:
    the pendulum has as many inputs as coordinates.

    Where that would leave the thrust's range (less a margin), what the ground can give, or the least normal force, the
    pitch gives way as far as it must, never the wheel angle: each pitch has its own thrust, and its own share of the
    weight that friction carries. A reference that is itself outside these limits may stay as far outside as it is. A
    target between the friction that is planned with and what the ground gives opens the plan's cone around itself: the
    robot cannot stand where its plan forbids it to, and would settle away from its target.

    Attributes:
        model: Parameter vector of the pendulum that predicts, with the estimated disturbance.
        weights: The problem's weights and limits, with the friction that this step may plan with.
        pitch_shift: What the pitch gave way by [rad].
        slopes: Inclination at each stage, shape (n_h,).
        states: Reference of x_1 .. x_n, shape (n_h, 4).
        inputs: Inputs that belong to it, shape (n_h, 2).
        costed_inputs: What the input cost is measured from, shape (n_h, 2).
        terminal: Weight of the last error, shape (4, 4).
    """

    __slots__ = (
        "_corrected_inputs",
        "_corrected_states",
        "_limits",
        "_lower",
        "_nominal",
        "_problem",
        "_upper",
        "costed_inputs",
        "inputs",
        "model",
        "pitch_shift",
        "slopes",
        "states",
        "terminal",
        "weights",
    )

    def __init__(self, problem: Problem, model: _Array | None = None) -> None:
        """Prepare for a problem.

        Args:
            problem: The optimal control problem.
            model: The predicting pendulum's parameter vector, a live array whose disturbance someone else keeps up to
                date; None for the problem's own, undisturbed.
        """
        settings = problem.settings
        self._problem = problem
        self._nominal = problem.parameters
        self.model = self._nominal if model is None else model
        self._lower = np.array([settings.duty_limits[0], settings.thrust_limits[0]])
        self._upper = np.array([settings.duty_limits[1], settings.thrust_limits[1]])
        self.weights: _Array = problem.weights if model is None else problem.weights.copy()
        constrained = settings.ground_constraints
        thrust_min, thrust_max = settings.thrust_limits
        margin = min(settings.thrust_margin, 0.5 * (thrust_max - thrust_min))
        self._limits: _Array = np.array(
            [
                thrust_min + margin,
                thrust_max - margin,
                settings.friction_static / FRICTION_ROOM if constrained else np.inf,
                settings.normal_force_min if constrained else -np.inf,
            ]
        )
        self._corrected_states: _Array = np.zeros((settings.horizon, 4))
        self._corrected_inputs: _Array = np.zeros((settings.horizon, 2))
        self.pitch_shift = 0.0
        self.aim(0)

    def aim(self, sample: int) -> None:
        """Move the window.

        Args:
            sample: Index of the reference that belongs to x_0.
        """
        problem = self._problem
        end = sample + problem.settings.horizon
        self.slopes = problem.slopes[sample:end]
        self.terminal = problem.terminals[end]
        self.states = problem.states[sample + 1 : end + 1]
        self.inputs = problem.inputs[sample:end]
        self.costed_inputs = problem.costed_inputs[sample:end]
        if self.model is self._nominal:
            return
        self.pitch_shift, friction = pitch_shift_within_limits(
            self._nominal,
            self.model,
            self.slopes[0],
            self.slopes[0],
            problem.states[sample],
            self.inputs[0],
            self._limits,
        )
        settings = problem.settings
        self.weights[FRICTION] = max(settings.friction_plan, min(FRICTION_ROOM * friction, settings.friction_static))
        inputs_along(
            self._nominal,
            self.model,
            self.slopes,
            self.slopes,
            problem.states[sample:end],
            self.inputs,
            self.pitch_shift,
            self._lower,
            self._upper,
            self._corrected_inputs,
        )
        if settings.input_reference == "trim":
            self.costed_inputs = self._corrected_inputs
        self.inputs = self._corrected_inputs
        if self.pitch_shift != 0.0:
            self._corrected_states[:] = self.states
            self._corrected_states[:, 1] += self.pitch_shift
            self.states = self._corrected_states
