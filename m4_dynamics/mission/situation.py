"""What every phase of a mission works with: plant, estimator, recorder, the way ahead, the actuators."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from m4_dynamics.control.controller import Diagnostics
from m4_dynamics.control.estimator import StateEstimator
from m4_dynamics.control.heading import HeadingHold, wheel_duties
from m4_dynamics.errors import RobotDescriptionError
from m4_dynamics.full.axle_path import AxlePath
from m4_dynamics.mission.schema import AbortRule
from m4_dynamics.reduced.reduction import Reduction, holding_torques
from m4_dynamics.reduced.trim import Trim, TrimLimits, select_trim
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.balance import DriveWheels
from m4_dynamics.simulation.controllers import make_heading_hold
from m4_dynamics.simulation.fidelity import Fidelity
from m4_dynamics.simulation.plant import Plant
from m4_dynamics.simulation.recorder import Recorder
from m4_dynamics.simulation.trajectory import true_motion

__all__ = ["WHEEL_BRAKE", "MissionAborted", "Situation"]

Array = NDArray[np.float64]

#: Brake of a wheel that shall not turn [N m s/rad].
WHEEL_BRAKE = 10.0
#: How fast posture compensation follows a change of trim [s].
COMPENSATION_TIME = 0.3


class MissionAborted(Exception):
    """An abort rule has been met; caught by the runner, which makes the robot safe."""


@dataclass(slots=True, eq=False)
class Situation:
    """The robot in the middle of a mission.

    Attributes:
        robot: The robot.
        reduction: As a pendulum, in its balancing posture.
        plant: The full model.
        path: The axle's way over the terrain.
        estimator: Reduced state from the measurements.
        recorder: Where the samples go.
        wheels: The drive wheels.
        abort: When to give up.
        limits: What trims may ask for.
        fidelity: What the plant has that an ideal one has not.
        heading: Wanted heading, positive left of the slope's direction [rad].
    """

    robot: Robot
    reduction: Reduction
    plant: Plant
    path: AxlePath
    estimator: StateEstimator
    recorder: Recorder
    wheels: DriveWheels
    abort: AbortRule
    limits: TrimLimits
    fidelity: Fidelity
    heading: float = 0.0
    _trims: dict[tuple[float, float | None], Trim] = field(init=False, default_factory=dict, repr=False)
    _heading_holds: dict[tuple[float, float], HeadingHold] = field(init=False, default_factory=dict, repr=False)
    _sags: dict[tuple[float, float], Array] = field(init=False, default_factory=dict, repr=False)

    @property
    def radius(self) -> float:
        """Of the drive wheels [m]."""
        return self.reduction.parameters.wheel_radius

    @property
    def travel(self) -> float:
        """Where the odometry believes the axle to be along its way [m]."""
        return float(self.estimator.state[0]) * self.radius

    def localise(self) -> None:
        """Give the odometry its place and heading once, as a robot gets them from its cameras before it sets off.

        Afterwards controllers live on odometry and inertial sensors alone, so slip shows as an error.
        """
        motion = true_motion(
            self.plant.model,
            self.reduction,
            self.plant.configuration[np.newaxis],
            self.plant.velocity[np.newaxis],
            origin=0.0,
        )
        self.estimator.relocate(
            self.plant.measurement, wheel_angle=float(motion.state[0, 0]), heading=float(motion.heading[0])
        )

    def sense(self) -> Array:
        """Estimate the reduced state from the last measurement; the slope is the map's under the odometry's place."""
        state = self.estimator.update(self.plant.measurement)
        self.estimator.slope = float(self.path.slope_at(state[0] * self.radius))
        return state

    def trim_on(self, slope: float, thrust: float | None) -> Trim:
        """The trim for a slope, chosen once."""
        key = (round(slope, 9), thrust)
        if key not in self._trims:
            self._trims[key] = select_trim(
                self.reduction.parameters,
                slope,
                limits=self.limits,
                criterion="automatic" if thrust is None else "thrust",
                thrust=thrust,
            )
        return self._trims[key]

    def heading_hold(self, trim: Trim) -> HeadingHold:
        """The heading hold designed at a trim."""
        key = (round(trim.slope, 9), round(trim.pitch, 9))
        if key not in self._heading_holds:
            self._heading_holds[key] = make_heading_hold(self.robot, self.reduction, trim)
        return self._heading_holds[key]

    def hold_legs(self, trim: Trim) -> None:
        """Hold the balancing posture, the servos told what the trim's load would bend (smoothly, over a change)."""
        key = (round(trim.slope, 9), round(trim.pitch, 9))
        if key not in self._sags:
            self._sags[key] = holding_torques(self.robot, self.reduction, trim).sag
        servo_q = self.plant.model.servo_indices[:, 0]
        wanted = self.reduction.configuration[servo_q] + self._sags[key]
        targets = self.plant.command.servo_targets
        targets += (wanted - targets) * (self.plant.control_period / COMPENSATION_TIME)

    def brake(self, drive_wheels: bool) -> None:
        """Brake the idle wheels, and the drive wheels too or not."""
        command = self.plant.command
        command.wheel_brake[:] = WHEEL_BRAKE
        if drive_wheels:
            command.wheel_duty[:] = 0.0
        else:
            command.wheel_brake[[self.wheels.left, self.wheels.right]] = 0.0

    def command(self, duty: float, thrust: float, differential: float) -> None:
        """Tell the drive wheels and the balancing thrusters what to do."""
        right, left = wheel_duties(duty, differential)
        command = self.plant.command
        command.wheel_duty[self.wheels.left] = self.wheels.sign_left * left
        command.wheel_duty[self.wheels.right] = self.wheels.sign_right * right
        np.multiply(self.reduction.thrust_shares, thrust, out=command.thrust)

    def advance(
        self,
        state: Array,
        inputs: tuple[float, float],
        *,
        differential: float = 0.0,
        reference: tuple[Array, Array] | None = None,
        diagnostics: Diagnostics | None = None,
        seconds: float = 0.0,
    ) -> None:
        """Record the decision, let the plant run for one control period, record the outcome."""
        self.recorder.record_decision(
            state,
            self.estimator.heading,
            np.asarray(inputs, dtype=float),
            differential,
            diagnostics if diagnostics is not None else Diagnostics(),
            seconds,
            reference,
        )
        self.plant.step()
        self.recorder.record_outcome()

    def body_touches_ground(self) -> bool:
        """Whether a skid, the base or an idle wheel touches the ground."""
        stepper = self.plant.stepper
        idle = [i for i in range(len(self.robot.wheels)) if i not in (self.wheels.left, self.wheels.right)]
        return bool(stepper.point_force_in_world.any() or stepper.wheel_force_in_world[idle].any())

    def touch_pitch(self) -> float:
        """Pitch at which the drive wheels and the rearmost skids touch level ground together [rad].

        Lower, the robot sits on its skids and the wheels hang; higher, it stands on its wheels.

        Raises:
            RobotDescriptionError: There is no such pitch between lying and standing.
        """
        heights = _points_in_body(self)

        def gap(pitch: float) -> float:
            return float(np.min(-math.sin(pitch) * heights[:, 0] + math.cos(pitch) * heights[:, 1])) + self.radius

        low, high = -math.radians(120.0), -math.radians(20.0)
        if not gap(low) < 0.0 < gap(high):
            raise RobotDescriptionError(
                f"robot '{self.robot.name}' cannot be raised about its axle: its contact points do not reach the "
                f"ground before its wheels do when it lies back"
            )
        return float(brentq(gap, low, high))


def _points_in_body(situation: Situation) -> Array:
    """Contact points (forward, up) from the axle in the balancing posture, shape (n, 2) [m]."""
    import pinocchio as pin

    robot, reduction = situation.robot, situation.reduction
    if not robot.contact_points:
        raise RobotDescriptionError(f"robot '{robot.name}' has no contact points to sit on (table [contact])")
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, np.asarray(reduction.configuration))
    frame = reduction.frame
    offsets = [
        data.oMi[point.joint_id].act(np.asarray(point.position_in_joint)) - frame.axle_in_base
        for point in robot.contact_points
    ]
    return np.array([[offset @ frame.forward_in_base, offset @ frame.up_in_base] for offset in offsets])
