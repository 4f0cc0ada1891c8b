"""Model predictive control on the reduced model, linearised along its own plan and solved with ProxQP."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.controller import Diagnostics
from m4_dynamics.control.disturbance import DisturbanceEstimator
from m4_dynamics.control.mpc.kernels import all_finite
from m4_dynamics.control.mpc.plan import Plan
from m4_dynamics.control.mpc.problem import Problem
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.control.mpc.sqp import SqpOptimiser
from m4_dynamics.control.mpc.target import Target
from m4_dynamics.control.reference import ReferenceTrajectory
from m4_dynamics.control.slope_profile import SlopeProfile
from m4_dynamics.errors import InvalidSettingError, require_finite, require_shape
from m4_dynamics.reduced.pendulum import STATE_LABELS, MipParameters

__all__ = ["MpcController"]

_Array = NDArray[np.float64]


class MpcController:
    """Model predictive controller (paper, section IV and eq. mpc_formulation).

    Each step rolls the reduced model out from the measured state along the plan of the step before, shifted; linearises
    dynamics and ground forces there; condenses; solves one QP; and applies the first input. With
    `settings.sqp_iterations` above one this repeats, with a line search, until the optimisation step vanishes.

    When the QP is not solved, the inputs come from the last good plan, shifted, while that is at most
    `settings.plan_age_max` samples old, and from the saturated LQR at the trim after that. Both are counted.

    Attributes:
        problem: What is solved.
        plan: The last plan.
        rotor: The thrust that the commands have led to; a state of the prediction where the rotors lag.
        target: What the last step aimed at.
        estimator: Of the disturbance; None without disturbance rejection.
        fallbacks: Steps since the start whose inputs did not come from the optimiser.
        fallbacks_to_lqr: Those of them that came from the LQR.
    """

    def __init__(
        self,
        parameters: MipParameters,
        reference: ReferenceTrajectory,
        settings: MpcSettings | None = None,
        *,
        profile: SlopeProfile | None = None,
    ) -> None:
        """Set the controller up.

        Args:
            parameters: The pendulum.
            reference: What to follow, sampled at the settings' time step.
            settings: The settings, default `MpcSettings()`.
            profile: The ground by place: the plan takes the slope of each stage from where the wheels are then. None
                takes the reference's, by time, which is the same as long as the robot is where it should be.

        Raises:
            InvalidSettingError: If reference and settings disagree on the time step.
            ConvergenceError: If the robot cannot be stabilised at a trim of the reference.
        """
        settings = settings if settings is not None else MpcSettings()
        self.problem = Problem(parameters, reference, settings, profile)
        self.rotor = self.problem.rotor
        self._state: _Array = self.problem.states[0].copy()
        self.plan = Plan(settings.horizon, len(self._state))
        self.fallbacks = 0
        self.fallbacks_to_lqr = 0
        self.estimator = DisturbanceEstimator(parameters, reference) if settings.disturbance_rejection else None
        self.target = Target(self.problem, None if self.estimator is None else self.estimator.model)
        self._optimiser = SqpOptimiser(self.problem)
        self._lower = np.array([settings.duty_limits[0], settings.thrust_limits[0]])
        self._upper = np.array([settings.duty_limits[1], settings.thrust_limits[1]])
        self._applied: _Array = np.zeros(2)
        self.reset()

    @property
    def diagnostics(self) -> Diagnostics:
        """Of the last call of `control`; the cost is the paper's J of the plan, without terminal cost and slack."""
        return self._diagnostics

    def reset(self, *, thrust: float | None = None) -> None:
        """Drop plan, warm start, disturbance and counters.

        Args:
            thrust: What the rotors give now [N]; it matters where they lag. None takes that of the reference's start.
        """
        self.rotor.reset(float(self.problem.applied[0, 1]) if thrust is None else thrust)
        self.plan.clear()
        self._optimiser.qp.reset()
        self.target.reset()
        if self.estimator is not None:
            self.estimator.reset()
        self.fallbacks = 0
        self.fallbacks_to_lqr = 0
        self._diagnostics = Diagnostics()

    def control(self, step: int, state: _Array) -> _Array:
        """Inputs for one sample, see `BalanceController.control`."""
        if step < 0:
            raise InvalidSettingError("step", step, "an integer >= 0")
        state = np.ascontiguousarray(state, dtype=np.float64)
        require_shape("state", state, (4,))
        if not all_finite(state):
            require_finite("state", state, STATE_LABELS)

        plan, target, optimiser, estimator = self.plan, self.target, self._optimiser, self.estimator
        sample = min(step, self.problem.last_step)
        at_corner = target.meet_corner(sample, float(state[0]), float(state[2]))
        if estimator is not None:
            estimator.measure(step, state, hold=at_corner)
        target.aim(sample, state[0])
        self._state[:4] = state
        self._state[4:] = self.rotor.thrust_at(step)
        if not plan.move_to(step):
            # The reference's own inputs are where to start from without a plan.
            np.clip(target.inputs, self._lower, self._upper, out=plan.inputs)
        status, optimised = optimiser.improve(plan, self._state, target)
        if optimised:
            plan.step = step
            plan.age = 0
            inputs: _Array = plan.inputs[0].copy()
        else:
            inputs = self._fall_back()
        self._applied[0] = inputs[0]
        self._applied[1] = self.rotor.command(inputs[1])
        if estimator is not None:
            estimator.apply(step, target.slopes[0], self._applied)
        cost, _, slack, residual = optimiser.outcome.tolist()
        self._diagnostics = Diagnostics(cost, slack, status, optimiser.iterations, not optimised, residual)
        return inputs

    def _fall_back(self) -> _Array:
        """Inputs without an optimised plan: the last good one while it is fresh, else the saturated LQR."""
        plan, target = self.plan, self.target
        self.fallbacks += 1
        if plan.step is not None and plan.age <= self.problem.settings.plan_age_max:
            planned: _Array = plan.inputs[0].copy()
            return planned
        self.fallbacks_to_lqr += 1
        plan.clear()
        inputs = target.inputs[0] - target.gain @ (self._state - target.state_now())
        saturated: _Array = np.clip(inputs, self._lower, self._upper)
        return saturated
