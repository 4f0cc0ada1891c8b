"""What one step of the MPC aims at: its window of the reference, corrected for what is known of robot and ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.corner import CornerFinder
from m4_dynamics.control.mpc.kernels import FRICTION
from m4_dynamics.control.mpc.problem import Problem
from m4_dynamics.reduced.kernels import WHEEL_RADIUS, inputs_along, pitch_shift_within_limits

__all__ = ["Target"]

_Array = NDArray[np.float64]
_IndexArray = NDArray[np.int64]

#: Friction that a target must leave unused, as a factor: on the cone's surface itself the plan could not manoeuvre.
FRICTION_ROOM = 1.03


class Target:
    """References, ground and end weight of one horizon, with the model that predicts over it.

    These are plain windows of the problem's arrays if the model has no disturbance and the ground is the reference's.
    Else wheel angle and pitch stay what the reference says, and the inputs are those that move the disturbed pendulum
    along it on the ground where it is: with an estimate d of the disturbance they change by -B_q^-1 d. That holds the
    reference exactly, because the pendulum has as many inputs as coordinates.

    Where it would leave the thrust's range (less a margin), what the ground can give, or the least normal force, the
    pitch gives way as far as it must, never the wheel angle: each pitch has its own thrust, and its own share of the
    weight that friction carries. A reference that is itself outside these limits may stay as far outside as it is. A
    target between the friction that is planned with and what the ground gives opens the plan's cone around itself: the
    robot cannot stand where its plan forbids it to, and would settle away from its target.

    Attributes:
        corners: Where the ground's corners are, by the measured wheel angle; None without a profile.
        model: Parameter vector of the pendulum that predicts, with the estimated disturbance.
        weights: The problem's weights and limits, with the friction that this step may plan with.
        pitch_shift: What the pitch gave way by [rad].
        slopes: Inclination at each stage, shape (n_h,) or one longer.
        states: Reference of x_1 .. x_n, shape (n_h, nx).
        inputs: Inputs that belong to it, shape (n_h, 2).
        costed_inputs: What the input cost is measured from, shape (n_h, 2).
        terminal: Weight of the last error, shape (nx, nx).
        gain: Of the linear-quadratic feedback on the slope under the wheels, shape (2, nx).
    """

    __slots__ = (
        "_applied",
        "_corrected",
        "_corrected_inputs",
        "_corrected_states",
        "_end",
        "_limits",
        "_lower",
        "_nominal",
        "_problem",
        "_sample",
        "_upper",
        "corners",
        "costed_inputs",
        "gain",
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
        n = settings.horizon
        self._problem = problem
        self._nominal = problem.parameters
        self.model = self._nominal if model is None else model
        self._corrected = model is not None or problem.profile is not None
        radius = float(problem.parameters[WHEEL_RADIUS])
        self.corners = (
            None if problem.profile is None else CornerFinder(problem.profile, reach=settings.corner_reach / radius)
        )
        self.weights: _Array = problem.weights.copy() if self._corrected else problem.weights
        self._lower = np.array([settings.duty_limits[0], settings.thrust_limits[0]])
        self._upper = np.array([settings.duty_limits[1], settings.thrust_limits[1]])
        thrust_min, thrust_max = settings.thrust_limits
        margin = min(settings.thrust_margin, 0.5 * (thrust_max - thrust_min))
        constrained = settings.ground_constraints
        self._limits: _Array = np.array(
            [
                thrust_min + margin,
                thrust_max - margin,
                settings.friction_static / FRICTION_ROOM if constrained else np.inf,
                settings.normal_force_min if constrained else -np.inf,
            ]
        )
        self._corrected_states: _Array = np.zeros((n, problem.states.shape[1]))
        self._corrected_inputs: _Array = np.zeros((n, 2))
        self._applied: _Array = np.zeros((n + 1, 2))
        self.pitch_shift = 0.0
        self.aim(0, float(problem.states[0, 0]))

    def aim(self, sample: int, wheel_angle: float) -> None:
        """Move the window.

        Args:
            sample: Index of the reference that belongs to x_0.
            wheel_angle: Where the wheels are, which tells the slope where there is a profile [rad].
        """
        problem = self._problem
        end = sample + problem.settings.horizon
        self._sample, self._end = sample, end
        self.states = problem.states[sample + 1 : end + 1]
        self.inputs = problem.inputs[sample:end]
        self.costed_inputs = problem.costed_inputs[sample:end]
        if problem.profile is None:
            self.slopes = problem.slopes[sample : end + 1]
            self.gain, self.terminal = problem.gains[sample], problem.terminals[end]
        else:
            assert self.corners is not None
            piece = int(np.searchsorted(self.corners.starts, wheel_angle, side="right")) - 1
            self.slopes = np.full(len(self.states) + 1, problem.profile.slopes[piece])
            self.gain, self.terminal = problem.piece_gains[piece], problem.piece_terminals[piece]
        if not self._corrected:
            return
        settings = problem.settings
        self.pitch_shift, friction = pitch_shift_within_limits(
            self._nominal,
            self.model,
            problem.slopes[sample],
            self.slopes[0],
            problem.states[sample],
            problem.applied[sample],
            self._limits,
        )
        self.weights[FRICTION] = max(settings.friction_plan, min(FRICTION_ROOM * friction, settings.friction_static))
        self._correct()

    def reset(self) -> None:
        """Forget what the wheels have told of the ground's corners."""
        if self.corners is not None:
            self.corners.reset()

    def meet_corner(self, sample: int, wheel_angle: float, rate: float) -> bool:
        """Take in where the wheels are, for the corners of the ground.

        Args:
            sample: Index of the reference that belongs to now.
            wheel_angle: Measured wheel angle [rad].
            rate: Measured wheel rate [rad/s].

        Returns:
            Whether the wheels may touch two faces of the ground.
        """
        if self.corners is None:
            return False
        return self.corners.update(wheel_angle, rate, float(self._problem.states[sample, 2]))

    def meet(self, slopes: _Array, pieces: _IndexArray) -> None:
        """Take in the ground that a plan meets; only where there is a profile.

        Args:
            slopes: Inclination at x_0 .. x_n, shape (n_h + 1,) [rad].
            pieces: Pieces of the profile, shape (n_h + 1,).
        """
        self.slopes = slopes
        self.terminal = self._problem.piece_terminals[pieces[-1]]
        self._correct()

    def state_now(self) -> _Array:
        """Reference of x_0, shape (nx,), a fresh array."""
        state: _Array = self._problem.states[self._sample].copy()
        if self._corrected:
            state[1] += self.pitch_shift
            state[4:] = self._applied[0, 1]
        return state

    def _correct(self) -> None:
        """Inputs and states of the window for the disturbed pendulum on the ground where it is."""
        problem, sample, end = self._problem, self._sample, self._end
        applied = self._applied
        inputs_along(
            self._nominal,
            self.model,
            problem.slopes[sample : end + 1],
            self.slopes,
            problem.states[sample : end + 1],
            problem.applied[sample : end + 1],
            self.pitch_shift,
            self._lower,
            self._upper,
            applied,
        )
        lagging = problem.states.shape[1] == 5
        self.inputs = applied[:-1]
        if lagging:
            # The thrust itself is a state to be reached; its command leads it there.
            self.inputs = self._corrected_inputs
            self.inputs[:, 0] = applied[:-1, 0]
            lead = (applied[1:, 1] - applied[:-1, 1]) / problem.rotor.share
            np.clip(applied[:-1, 1] + lead, self._lower[1], self._upper[1], out=self.inputs[:, 1])
        if problem.settings.input_reference == "trim":
            self.costed_inputs = self.inputs
        if lagging or self.pitch_shift != 0.0:
            self.states = self._corrected_states
            self.states[:] = problem.states[sample + 1 : end + 1]
            self.states[:, 1] += self.pitch_shift
            if lagging:
                self.states[:, 4] = applied[1:, 1]
