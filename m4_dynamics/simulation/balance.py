"""A balancing robot in closed loop: estimator, balance controller and heading hold around the plant."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.control.controller import BalanceController
from m4_dynamics.control.estimator import BalanceEstimator, StateEstimator
from m4_dynamics.control.heading import HeadingHold, wheel_duties
from m4_dynamics.control.imu import ImuErrors
from m4_dynamics.control.inertial import InertialEstimator
from m4_dynamics.control.reference import ReferenceTrajectory
from m4_dynamics.reduced.reduction import BalanceFrame, Reduction
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.fidelity import Fidelity
from m4_dynamics.simulation.plant import Plant
from m4_dynamics.simulation.recorder import Recorder

__all__ = ["BalanceLoop", "DriveWheels", "balance_estimator", "drive_wheels"]

Array = NDArray[np.float64]


class DriveWheels(NamedTuple):
    """The two wheels that carry the pendulum, seen along its forward direction.

    Attributes:
        left, right: Indices into `robot.wheels`.
        sign_left, sign_right: Joint rate times this is the rolling rate relative to the body.
    """

    left: int
    right: int
    sign_left: float
    sign_right: float


def drive_wheels(robot: Robot, frame: BalanceFrame) -> DriveWheels:
    """Which wheel is on the pendulum's left and which on its right, and how their joints turn.

    Args:
        robot: The robot.
        frame: The pendulum's axes on it.

    Returns:
        The wheels.
    """
    names = [wheel.joint for wheel in robot.wheels]
    left, right = np.argsort(-np.asarray(frame.wheel_offsets))
    joints, signs = frame.wheel_joints, frame.wheel_signs
    return DriveWheels(names.index(joints[left]), names.index(joints[right]), float(signs[left]), float(signs[right]))


def balance_estimator(
    robot: Robot, reduction: Reduction, *, slope: float, fidelity: Fidelity | None = None, control_period: float = 5e-3
) -> StateEstimator:
    """The estimator for a robot's sensors and posture.

    Args:
        robot: The robot.
        reduction: How it stands as a pendulum.
        slope: Inclination of the ground [rad].
        fidelity: How good the sensors are; None means ideal ones.
        control_period: Time between two measurements [s].

    Returns:
        The ideal estimator for exact sensors, else the inertial one; to be told where the robot is with `reset`.
    """
    frame, wheels = reduction.frame, drive_wheels(robot, reduction.frame)
    axes_in_base = frame.rotation_in_base.T
    indices, signs = (wheels.left, wheels.right), (wheels.sign_left, wheels.sign_right)
    if fidelity is None or fidelity.senses_exactly:
        return BalanceEstimator(
            axes_in_base=axes_in_base,
            wheels=len(robot.wheels),
            drive_wheels=indices,
            wheel_signs=signs,
            wheel_radius=frame.wheel_radius,
            track=frame.track,
            slope=slope,
        )
    return InertialEstimator(
        axes_in_base=axes_in_base,
        wheels=len(robot.wheels),
        drive_wheels=indices,
        wheel_signs=signs,
        wheel_radius=frame.wheel_radius,
        track=frame.track,
        slope=slope,
        axle_in_base=frame.axle_in_base,
        errors=fidelity.imu if fidelity.imu is not None else ImuErrors(),
        encoder_resolution=fidelity.encoder_resolution,
        period=control_period,
        gravity=robot.gravity,
    )


@dataclass(slots=True, eq=False)
class BalanceLoop:
    """One control period after another: measure, estimate, decide, allocate, step, record.

    Attributes:
        plant: The full model; reset it before the loop.
        reduction: How the robot stands as a pendulum: axes, drive wheels and their signs.
        controller: Gives motor duty and thrust from the reduced state.
        reference: What the controller follows, for the record.
        heading_hold: Gives the differential duty.
        heading_reference: Wanted heading, positive left of uphill [rad].
        estimator: Reduced state from the measurements.
        recorder: Where the samples go.
    """

    plant: Plant
    reduction: Reduction
    controller: BalanceController
    reference: ReferenceTrajectory
    heading_hold: HeadingHold
    estimator: StateEstimator
    recorder: Recorder
    heading_reference: float = 0.0
    _step: int = field(init=False, default=0)
    _wheels: DriveWheels = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._wheels = drive_wheels(self.plant.model.robot, self.reduction.frame)

    def start(
        self, measurement: ArrayLike, *, wheel_angle: float = 0.0, heading: float = 0.0, held: float = 0.0
    ) -> None:
        """Tell controller and odometry where the robot is.

        Args:
            measurement: The plant's measurement there.
            wheel_angle: Absolute wheel angle [rad].
            heading: Heading, positive left of uphill [rad].
            held: How long the robot was held still there before, while the estimator was already at work [s].
        """
        self.estimator.reset(measurement, wheel_angle=wheel_angle, heading=heading)
        for _ in range(round(held / self.plant.control_period)):
            self.estimator.update(self.plant.measure_held())
        self.follow(self.controller, self.reference)

    def follow(self, controller: BalanceController, reference: ReferenceTrajectory) -> None:
        """Go on from here with a controller and a reference, both from their start.

        Args:
            controller: The controller.
            reference: What it follows.
        """
        self.controller, self.reference = controller, reference
        self.controller.reset()
        self._step = 0

    def advance(self) -> None:
        """One control period.

        Raises:
            SimulationDivergedError: The plant diverged.
            NonFiniteError: The estimate is not finite.
        """
        plant, wheels = self.plant, self._wheels
        state = self.estimator.update(plant.measurement)
        heading = self.estimator.heading
        started = perf_counter()
        inputs = self.controller.control(self._step, state)
        seconds = perf_counter() - started
        differential = self.heading_hold.control(heading - self.heading_reference, self.estimator.heading_rate)
        duty_right, duty_left = wheel_duties(float(inputs[0]), differential)
        command = plant.command
        command.wheel_duty[wheels.left] = wheels.sign_left * duty_left
        command.wheel_duty[wheels.right] = wheels.sign_right * duty_right
        np.multiply(self.reduction.thrust_shares, inputs[1], out=command.thrust)
        sample = min(self._step, len(self.reference.time) - 1)
        wanted = self.reference.state[sample], self.reference.inputs[sample]
        self.recorder.record_decision(
            state, heading, inputs, differential, self.controller.diagnostics, seconds, wanted
        )
        plant.step()
        self.recorder.record_outcome()
        self._step += 1
