"""What an MPC minimises and respects, and how hard it tries."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from m4_dynamics.errors import InvalidSettingError

__all__ = ["InputReference", "MpcSettings", "TerminalCost"]

InputReference = Literal["trim", "zero"]
TerminalCost = Literal["riccati", "none"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MpcSettings:
    """Settings of the model predictive controller (paper, eq. mpc_formulation).

    The default adds to the paper what its 0.05 s horizon needs: this is shorter than the robot's slowest unstable time
    constant, so without a terminal cost the plan cannot see where the wheels end up. `paper()` gives the paper's own.

    Attributes:
        time_step: Sampling time of controller and prediction [s].
        horizon: Number of samples n_h that the plan looks ahead.
        state_weights: Diagonal of Q on (wheel angle, pitch, and their rates).
        input_weights: Diagonal of R on (duty, thrust). The paper's duty weight of 5 puts a pole at 216 rad/s, faster
            than ground and legs: 6 deg of pitch reverse the whole ground force within 20 ms, the normal force
            overshoots, a wheel slides, and on slippery ground the robot spins out. With 500 that pole lies at
            28 rad/s, and the doubled weight of the wheel angle keeps the slowest one at 1.7 rad/s (1.4 with the
            paper's weights).
        input_reference: What R is measured from: "trim" is the reference trajectory's inputs, "zero" is no input at
            all, which pays the controller for letting the robot sag and makes it fall on slopes.
        terminal_cost: "riccati" weighs the last predicted error with the infinite-horizon cost at the trim, "none"
            with Q like the others.
        ground_constraints: Whether the plan respects friction cone and least normal force.
        friction_static: Coefficient of static friction mu_s of the ground.
        friction_fraction: The plan uses at most this fraction of mu_s. The rest is for what the planar model does not
            see: sideways forces, uneven load of the two wheels, heading hold. On ground a tenth more slippery than
            assumed, from 8 deg of pitch at 45 deg, 0.9 slides now and then and 1.0 often; 0.8 does not.
        normal_force_min: Least normal force that the plan keeps [N].
        duty_limits: Hard bounds of the motor duty.
        thrust_limits: Hard bounds of the thrust [N]; (0, 0) for a robot without thrusters.
        thrust_margin: A target that the disturbance estimate has moved stays this far inside the thrust's limits [N],
            because on a limit one of two inputs is lost.
        disturbance_rejection: Whether the controller estimates what the model lacks (`control.disturbance`) and counts
            on it; without, a wrong mass, CoM or thrust leaves the wheels centimetres off.
        corner_reach: This far before and behind a corner of the ground the disturbance estimate rests [m]: the wheels
            may touch both faces, the pendulum does not know of the second one, and what carries the robot there does
            not go with it. As wide as the odometry may be off: wheels that stop this near a rising corner have found
            it (`control.corner`).
        slack_weight: Cost of one newton of violation of the ground constraints [1/N]. The penalty is exact: while the
            sum of the constraints' multipliers stays below it, the plan violates nothing that it could satisfy. The
            default yields to the largest disturbances, into the friction margin first, because the plan's horizon ends
            before the fall that it would prevent.
        slack_curvature: Quadratic cost of the violation [1/N^2]; keeps the QP strictly convex.
        sqp_iterations: Linearisations per control step; 1 is the real-time iteration.
        sqp_tolerance: With more than one, stop when the step is below this (in units of half an input's range).
        solver_tolerance: Absolute tolerance of the QP solver.
        solver_iterations: Cap of ProxQP's outer iterations; 11 are the most that a cold start was seen to need.
        solver_inner_iterations: Cap of ProxQP's inner iterations per outer one.
        plan_age_max: After a failed optimisation, samples for which the last good plan is followed before the saturated
            LQR takes over. The plan is open loop on an unstable robot: keep it short.
    """

    time_step: float = 0.005
    horizon: int = 10
    state_weights: tuple[float, float, float, float] = (20.0, 1e4, 5.0, 25.0)
    input_weights: tuple[float, float] = (500.0, 0.5)
    input_reference: InputReference = "trim"
    terminal_cost: TerminalCost = "riccati"
    ground_constraints: bool = True
    friction_static: float = 0.8
    friction_fraction: float = 0.8
    normal_force_min: float = 5.0
    duty_limits: tuple[float, float] = (-1.0, 1.0)
    thrust_limits: tuple[float, float] = (0.0, 43.2)
    thrust_margin: float = 2.0
    disturbance_rejection: bool = True
    corner_reach: float = 0.04
    slack_weight: float = 50.0
    slack_curvature: float = 1.0
    sqp_iterations: int = 1
    sqp_tolerance: float = 1e-8
    solver_tolerance: float = 1e-6
    solver_iterations: int = 20
    solver_inner_iterations: int = 30
    plan_age_max: int = 2

    @classmethod
    def paper(
        cls,
        *,
        input_reference: InputReference = "trim",
        friction_static: float = 0.8,
        thrust_limits: tuple[float, float] = (0.0, 43.2),
    ) -> MpcSettings:
        """The paper's own settings: its weights, no terminal cost, no margin to the ground constraints (section V).

        Args:
            input_reference: See the class; the paper's formula reads "zero", with which the robot falls.
            friction_static: Coefficient of static friction of the ground.
            thrust_limits: Hard bounds of the thrust [N].

        Returns:
            The settings.
        """
        return cls(
            input_reference=input_reference,
            state_weights=(10.0, 1e4, 5.0, 25.0),
            input_weights=(5.0, 0.5),
            terminal_cost="none",
            friction_static=friction_static,
            friction_fraction=1.0,
            normal_force_min=0.0,
            thrust_limits=thrust_limits,
            disturbance_rejection=False,
        )

    @property
    def friction_plan(self) -> float:
        """Friction coefficient mu that the plan may use."""
        return self.friction_fraction * self.friction_static

    def __post_init__(self) -> None:
        """Refuse what cannot work.

        Raises:
            InvalidSettingError: Names the setting, what was received and what would be valid.
        """
        for name in ("time_step", "friction_static", "friction_fraction", "slack_weight", "slack_curvature"):
            _require_positive(name, getattr(self, name))
        for name in ("sqp_tolerance", "solver_tolerance"):
            _require_positive(name, getattr(self, name))
        for name in ("horizon", "sqp_iterations", "solver_iterations", "solver_inner_iterations"):
            _require_count(name, getattr(self, name), least=1)
        _require_count("plan_age_max", self.plan_age_max, least=0)
        _require_weights("state_weights", self.state_weights, length=4, positive=False)
        _require_weights("input_weights", self.input_weights, length=2, positive=True)
        for name in ("duty_limits", "thrust_limits"):
            limits = getattr(self, name)
            if len(limits) != 2 or not all(map(math.isfinite, limits)) or not limits[0] <= limits[1]:
                raise InvalidSettingError(name, limits, "(lower, upper), finite, lower <= upper")
        if not math.isfinite(self.normal_force_min):
            raise InvalidSettingError("normal_force_min", self.normal_force_min, "a finite force [N]")
        for name, valid in (("input_reference", get_args(InputReference)), ("terminal_cost", get_args(TerminalCost))):
            if getattr(self, name) not in valid:
                raise InvalidSettingError(name, getattr(self, name), "one of " + ", ".join(valid))


def _require_positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise InvalidSettingError(name, value, "a finite number > 0")


def _require_count(name: str, value: int, *, least: int) -> None:
    if not isinstance(value, int) or value < least:
        raise InvalidSettingError(name, value, f"an integer >= {least}")


def _require_weights(name: str, values: tuple[float, ...], *, length: int, positive: bool) -> None:
    least_reached = all(value > 0.0 if positive else value >= 0.0 for value in values)
    if len(values) != length or not all(map(math.isfinite, values)) or not least_reached:
        raise InvalidSettingError(name, values, f"{length} finite numbers {'>' if positive else '>='} 0")
