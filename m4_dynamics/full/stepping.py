"""Time stepping of the full model.

`ImplicitStepper` is the plant's integrator: contact, friction, servo and back-EMF forces are taken at the end of the
step, so that a stiff ground allows steps of a millisecond. `ExplicitStepper` takes the same laws at the start of the
step; it needs steps of microseconds and is the independent reference that the implicit one must agree with.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import InvalidSettingError, M4Error
from m4_dynamics.full import kernels
from m4_dynamics.full.dynamics import check_state
from m4_dynamics.full.model import FullModel

__all__ = ["Actuation", "ExplicitStepper", "ImplicitStepper", "SimulationDivergedError", "StepCounters"]

Array = NDArray[np.float64]


class SimulationDivergedError(M4Error):
    """The integration produced NaN or an unbounded velocity."""


class StepCounters(NamedTuple):
    """What the implicit steps cost.

    Attributes:
        steps: Steps taken.
        newton_iterations: Newton iterations, over all steps.
        newton_failures: Steps whose contact forces did not converge; their result is not to be trusted.
        servo_saturations: Times a servo met its torque limit.
    """

    steps: int
    newton_iterations: int
    newton_failures: int
    servo_saturations: int


@dataclass(slots=True, eq=False)
class Actuation:
    """What the actuators are told; plain arrays, to be written in place between steps.

    Attributes:
        servo_targets: Joint angles of the servos [rad].
        wheel_duty: Motor duty of each wheel in [-1, 1], positive about the wheel's joint axis.
        wheel_brake: Viscous brake of each wheel [N m s/rad].
        thrust: Thrust of each thruster [N].
        external_wrench: Force and moment on the base about its origin, world axes, shape (6,) [N, N m].
    """

    servo_targets: Array
    wheel_duty: Array
    wheel_brake: Array
    thrust: Array
    external_wrench: Array

    @classmethod
    def idle(cls, model: FullModel, configuration: ArrayLike) -> Actuation:
        """Servos hold the joint angles of a configuration; wheels and thrusters are off."""
        q = np.asarray(configuration, dtype=float)
        return cls(
            servo_targets=q[model.servo_indices[:, 0]].copy(),
            wheel_duty=np.zeros(len(model.robot.wheels)),
            wheel_brake=np.zeros(len(model.robot.wheels)),
            thrust=np.zeros(len(model.robot.thrusters)),
            external_wrench=np.zeros(6),
        )


@dataclass(slots=True, eq=False)
class _Stepper:
    """State and outputs that both steppers share.

    Attributes:
        model: The full model.
        time_step: Step [s].
        time: Time since reset [s].
        configuration: q, shape (nq,).
        velocity: v, shape (nv,).
        actuation: What the actuators are told; write into its arrays.
        servo_torque: Torque of each servo in the last step [N m].
        wheel_force_in_world: Force of the ground on each wheel in the last step, shape (wheels, 3) [N].
        wheel_contact_in_world: Its point of application, shape (wheels, 3) [m].
        point_force_in_world: Force of the ground on each contact point, shape (points, 3) [N].
    """

    model: FullModel
    time_step: float = 1e-3
    time: float = field(init=False, default=0.0)
    configuration: Array = field(init=False)
    velocity: Array = field(init=False)
    actuation: Actuation = field(init=False)
    servo_torque: Array = field(init=False)
    wheel_force_in_world: Array = field(init=False)
    wheel_contact_in_world: Array = field(init=False)
    point_force_in_world: Array = field(init=False)

    def __post_init__(self) -> None:
        if not 0.0 < self.time_step <= 0.01:
            raise InvalidSettingError("time_step [s]", self.time_step, "a step in (0, 0.01]")
        self.reset(pin.neutral(self.model.robot.model))

    def reset(self, configuration: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Start anew from a state; the servos are told to hold its joint angles, everything else is off.

        Args:
            configuration: q, shape (nq,).
            velocity: v, shape (nv,); at rest when None.

        Raises:
            InvalidSettingError: A shape is wrong.
            NonFiniteError: An entry is NaN or infinite.
        """
        at_rest = np.zeros(self.model.robot.model.nv)
        q, v = check_state(self.model, configuration, at_rest if velocity is None else velocity)
        self.configuration, self.velocity = q.copy(), v.copy()
        self.time = 0.0
        self.actuation = Actuation.idle(self.model, q)
        self.servo_torque = np.zeros(len(self.model.robot.servos))
        self.wheel_force_in_world = np.zeros((len(self.model.robot.wheels), 3))
        self.wheel_contact_in_world = np.zeros((len(self.model.robot.wheels), 3))
        self.point_force_in_world = np.zeros((len(self.model.robot.contact_points), 3))

    def require_bounded(self) -> None:
        """Raise if the state has left the range in which it means anything.

        Raises:
            SimulationDivergedError: A velocity is NaN or beyond 1e4; names it and the time.
        """
        if not np.abs(self.velocity).max() < 1e4:
            worst = int(np.argmax(~(np.abs(self.velocity) < 1e4)))
            joint = next(
                name
                for name, joint in zip(self.model.robot.model.names, self.model.robot.model.joints, strict=True)
                if joint.idx_v <= worst < joint.idx_v + joint.nv
            )
            raise SimulationDivergedError(
                f"the simulation diverged at t = {self.time:.4f} s: the velocity of joint '{joint}' is "
                f"{self.velocity[worst]:.3g}; a smaller time step than {self.time_step:g} s may help"
            )


@dataclass(slots=True, eq=False)
class ImplicitStepper(_Stepper):
    """Contact-implicit stepping at a fixed time step.

    Attributes:
        statistics: For each wheel, since `clear_statistics`: columns as named in `kernels.py`.
        counters: Steps, Newton iterations, Newton failures, servo saturations since reset.
    """

    statistics: Array = field(init=False)
    _counters: NDArray[np.int64] = field(init=False, repr=False)
    _displacement: Array = field(init=False, repr=False)

    def reset(self, configuration: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """See `_Stepper.reset`."""
        _Stepper.reset(self, configuration, velocity)
        self.statistics = np.zeros((len(self.model.robot.wheels), kernels.STATISTICS_COLUMNS))
        self.statistics[:, kernels.NORMAL_FORCE_MIN] = np.inf
        self._counters = np.zeros(4, dtype=np.int64)
        self._displacement = np.zeros(self.model.robot.model.nv)

    @property
    def counters(self) -> StepCounters:
        """Steps, Newton iterations and failures, servo saturations since reset."""
        return StepCounters(*(int(value) for value in self._counters))

    def clear_peaks(self) -> None:
        """Forget the largest slip speed and friction use and the least normal force; the sums go on."""
        self.statistics[:, kernels.SLIP_SPEED_MAX] = 0.0
        self.statistics[:, kernels.FRICTION_USE_MAX] = 0.0
        self.statistics[:, kernels.NORMAL_FORCE_MIN] = np.inf

    def step(self, count: int = 1) -> None:
        """Advance by `count` time steps with the present actuation."""
        _require_count(count)
        m, actuation = self.model, self.actuation
        model, data = m.robot.model, m.data
        # The kernel's arguments stay the same for all steps: views of Pinocchio's results and arrays written in place.
        q = self.configuration.copy()
        arguments = (
            data.M, data.nle, data.J, m.poses, q, self.velocity, m.support, m.parents, m.tips, m.wheel_joints,
            m.wheel_axes, m.wheel_radii, m.wheel_velocity_indices, m.wheel_motor, m.point_joints, m.point_positions,
            m.thruster_joints, m.thruster_positions, m.thruster_directions, m.moment_ratios, m.servo_indices,
            m.servo_gains, m.terrain.segments, m.ground_packed, actuation.servo_targets, actuation.wheel_duty,
            actuation.wheel_brake, actuation.thrust, actuation.external_wrench, self.time_step, self._displacement,
            self.servo_torque, self.wheel_force_in_world, self.wheel_contact_in_world, self.point_force_in_world,
            self.statistics, self._counters,
        )  # fmt: skip
        for _ in range(count):
            # In the world's axes the composite rigid body algorithm finds the joint Jacobians and placements, too.
            pin.crba(model, data, q, pin.Convention.WORLD)
            pin.nonLinearEffects(model, data, q, self.velocity)
            kernels.implicit_step(*arguments)
            q[:] = pin.integrate(model, q, self._displacement)
        self.configuration = q
        self.time += count * self.time_step


@dataclass(slots=True, eq=False)
class ExplicitStepper(_Stepper):
    """Semi-implicit Euler with every force taken at the start of the step; the small-step reference."""

    def step(self, count: int = 1) -> None:
        """Advance by `count` time steps with the present actuation."""
        _require_count(count)
        m, actuation = self.model, self.actuation
        model, data = m.robot.model, m.data
        servo_q, servo_v = m.servo_indices[:, 0], m.servo_indices[:, 1]
        stiffness, damping, limit = m.servo_gains.T
        for _ in range(count):
            q, v = self.configuration, self.velocity
            pin.computeJointJacobians(model, data, q)
            force = self._ground_and_thrust()
            torque = stiffness * (actuation.servo_targets - q[servo_q]) - damping * v[servo_v]
            self.servo_torque = np.clip(torque, -limit, limit)
            force[servo_v] += self.servo_torque
            wheels = m.wheel_velocity_indices
            force[wheels] += m.wheel_motor[:, 0] * actuation.wheel_duty
            force[wheels] -= (m.wheel_motor[:, 1] + actuation.wheel_brake) * v[wheels]
            self.velocity = v + self.time_step * pin.aba(model, data, q, v, force)
            self.configuration = pin.integrate(model, q, self.time_step * self.velocity)
        self.time += count * self.time_step

    def _ground_and_thrust(self) -> Array:
        m, data = self.model, self.model.data
        total = np.zeros(m.robot.model.nv)
        kernels.explicit_forces(
            m.poses, data.J, m.support, m.wheel_joints, m.wheel_axes, m.wheel_radii, m.point_joints, m.point_positions,
            m.thruster_joints, m.thruster_positions, m.thruster_directions, m.moment_ratios, m.terrain.segments,
            m.ground_packed, self.velocity, self.actuation.thrust, self.actuation.external_wrench,
            self.wheel_force_in_world, self.wheel_contact_in_world, self.point_force_in_world, total,
        )  # fmt: skip
        return total


def _require_count(count: int) -> None:
    if count < 0:
        raise InvalidSettingError("count of steps", count, "zero or more")
