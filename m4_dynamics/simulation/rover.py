"""The robot as a plain rover: it drives up a ramp on all its wheels, without thrusters, and climbs, slips or tips.

What a rover can climb is bounded by statics. Its wheels carry the weight's part along the slope by friction, so it
slips beyond atan(mu_s), however strong its motors are; and it tips over its rear wheels where its centre of mass stands
over their contact, whatever the friction is. Less is reached on the way there: wheels that share the torque evenly do
not use the friction evenly, legs give, and the corner at the foot tilts it while it moves.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.control.controller import Diagnostics
from m4_dynamics.errors import InvalidSettingError, RobotDescriptionError
from m4_dynamics.full import kernels
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.standing import standing_configuration
from m4_dynamics.full.terrain import ramp_terrain
from m4_dynamics.reduced.reduction import reduce_robot
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.plant import Plant
from m4_dynamics.simulation.recorder import Recorder
from m4_dynamics.simulation.trajectory import build_trajectory

if TYPE_CHECKING:
    import xarray

__all__ = ["RoverLimits", "RoverOutcome", "RoverRun", "RoverSettings", "drive_rover", "rover_limits"]

Array = NDArray[np.float64]

#: Natural frequency of a wheel's critically damped speed loop [rad/s].
SPEED_FREQUENCY = 8.0
#: A rover that leans back this far from the slope has tipped [rad].
TIPPED_ANGLE = math.radians(40.0)
#: A rover that falls short, a wheel of which has slid this far, has slipped [m].
SLIPPED_WAY = 0.1


class RoverOutcome(StrEnum):
    """How a drive ended.

    Attributes:
        CLIMBED: It went the way asked for, up the slope.
        SLIPPED: It fell short because its wheels slid.
        TIPPED: It fell over backwards.
        STALLED: Its motors could not turn the wheels.
    """

    CLIMBED = "climbed"
    SLIPPED = "slipped"
    TIPPED = "tipped"
    STALLED = "stalled"


@dataclass(frozen=True, slots=True, kw_only=True)
class RoverSettings:
    """What to drive up, and how.

    Attributes:
        slope: Inclination of the ramp [rad].
        friction_static: mu_s; None takes the robot's own.
        speed: Of the wheels' rims [m/s].
        way: How far the centre of mass has to get up the ramp, along it [m].
        duration: Time for it [s].
        posture: In which it drives.
        run_up: From the foremost wheel to the foot of the ramp [m].
    """

    slope: float
    friction_static: float | None = None
    speed: float = 0.3
    way: float = 1.2
    duration: float = 10.0
    posture: str = "ugv"
    run_up: float = 0.3

    def __post_init__(self) -> None:
        for name, most in (("slope", math.radians(89.0)), ("speed", 2.0), ("way", 100.0), ("duration", 600.0)):
            if not 0.0 < getattr(self, name) <= most:
                raise InvalidSettingError(name, getattr(self, name), f"above 0, up to {most:.4g}")
        if self.friction_static is not None and not 0.0 < self.friction_static <= 10.0:
            raise InvalidSettingError("friction_static", self.friction_static, "a coefficient above 0, at most 10")


@dataclass(frozen=True, slots=True)
class RoverLimits:
    """Steepest slopes by statics, each as if it were the only limit [rad].

    Attributes:
        slipping: atan(mu_s), with all wheels driven and the best distribution of their torques.
        tipping: Where the centre of mass stands over the rear wheels' contacts.
        stalling: Where all motors together hold the weight at standstill; infinite where they always do.
    """

    slipping: float
    tipping: float
    stalling: float


@dataclass(frozen=True, slots=True, eq=False)
class RoverRun:
    """A drive.

    Attributes:
        outcome: How it ended.
        climbed: Farthest that the centre of mass got up the ramp, along it [m].
        rolled: Way that the wheels rolled, mean over the wheels [m].
        slid: Way that the worst wheel slid [m].
        limits: Static limits.
        dataset: The trajectory; `way_up_slope` and `way_rolled` over time are added to the usual variables.
    """

    outcome: RoverOutcome
    climbed: float
    rolled: float
    slid: float
    limits: RoverLimits
    dataset: xarray.Dataset


def rover_limits(robot: Robot, *, friction_static: float, posture: str = "ugv") -> RoverLimits:
    """Static limits of a robot that stands on a slope on all its wheels, nose uphill (+x of its base).

    Args:
        robot: The robot.
        friction_static: mu_s.
        posture: Its posture.

    Returns:
        The limits.

    Raises:
        UnknownNameError: The robot has no such posture.
        RobotDescriptionError: The robot has no wheels.
    """
    configuration = standing_configuration(robot, posture)
    data = robot.model.createData()
    com = pin.centerOfMass(robot.model, data, configuration)
    rear = min(float(data.oMi[wheel.joint_id].translation[0]) for wheel in robot.wheels)
    tipping = math.atan2(float(com[0]) - rear, float(com[2]))
    motor = robot.drive_motor
    # The motor's constants are those of two wheels together.
    torque = 0.0 if motor is None else 0.5 * motor.torque_constant * len(robot.wheels)
    lift = torque / (robot.mass * robot.gravity * robot.wheels[0].radius)
    return RoverLimits(math.atan(friction_static), tipping, math.asin(lift) if lift < 1.0 else math.inf)


def drive_rover(robot: Robot, settings: RoverSettings) -> RoverRun:
    """Drive up a ramp on all wheels, each with its own speed loop, on the full model.

    Args:
        robot: The robot; its thrusters stay off.
        settings: What to drive up.

    Returns:
        The drive.

    Raises:
        UnknownNameError: The robot has no such posture.
        RobotDescriptionError: The robot has no wheels, or does not balance (a trajectory is told in the axes of the
            balancing robot).
    """
    friction = robot.ground.friction_static if settings.friction_static is None else settings.friction_static
    model = FullModel.build(
        robot,
        ramp_terrain(settings.slope, flat_before=settings.run_up + 1.5, length=settings.way + 2.0),
        ground=dataclasses.replace(robot.ground, friction_static=friction),
    )
    plant = Plant(model)
    configuration = standing_configuration(robot, settings.posture)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, configuration)
    foremost = max(float(data.oMi[wheel.joint_id].translation[0]) for wheel in robot.wheels)
    configuration[0] = -settings.run_up - foremost
    plant.reset(configuration)
    loops = _SpeedLoops(robot, configuration)
    recorder = Recorder(plant, round(settings.duration / plant.control_period), origin=0.0)
    uphill = np.array([math.cos(settings.slope), 0.0, math.sin(settings.slope)])
    way, rolled = np.zeros(recorder.capacity), np.zeros(recorder.capacity)
    tipped = False
    while recorder.count < recorder.capacity and not tipped:
        k = recorder.count
        way[k] = pin.centerOfMass(robot.model, data, plant.configuration) @ uphill
        measurement = plant.measurement_now
        rolled[k] = robot.wheels[0].radius * float(np.mean(loops.signs * measurement.wheel_angle))
        plant.command.wheel_duty[:] = loops.duty(measurement.wheel_rate, settings.speed, plant.control_period)
        recorder.record_decision(np.zeros(4), 0.0, np.zeros(2), 0.0, Diagnostics(), 0.0)
        plant.step()
        recorder.record_outcome()
        nose = data.oMi[1].rotation[:, 0]
        tipped = math.atan2(float(nose[2]), float(nose[0])) - settings.slope > TIPPED_ANGLE
        if way[k] >= settings.way:
            break
    n = recorder.count
    climbed, slid = max(float(way[:n].max()), 0.0), float(recorder.statistics[n - 1, :, kernels.SLIP_DISTANCE].max())
    outcome = _judge(climbed >= settings.way, tipped, slid)
    dataset = build_trajectory(
        recorder,
        reduce_robot(robot),
        attributes={
            "slope_deg": math.degrees(settings.slope),
            "phases": ["drive"],
            "phase_kinds": ["drive"],
            "phase_controllers": ["none"],
            "controller": "wheel speed",
            "verdict": outcome.value,
        },
    )
    dataset["way_up_slope"] = ("time", way[:n], {"units": "m", "long_name": "centre of mass from the foot, uphill"})
    dataset["way_rolled"] = ("time", rolled[:n], {"units": "m", "long_name": "way that the wheels rolled, mean"})
    return RoverRun(
        outcome=outcome,
        climbed=climbed,
        rolled=float(rolled[n - 1]),
        slid=slid,
        limits=rover_limits(robot, friction_static=friction, posture=settings.posture),
        dataset=dataset,
    )


def _judge(arrived: bool, tipped: bool, slid: float) -> RoverOutcome:
    """How a drive ended, from whether it arrived, whether it tipped, and how far its worst wheel slid [m]."""
    if arrived:
        return RoverOutcome.CLIMBED
    if tipped:
        return RoverOutcome.TIPPED
    return RoverOutcome.SLIPPED if slid > SLIPPED_WAY else RoverOutcome.STALLED


class _SpeedLoops:
    """A PI controller for the speed of each wheel, its two poles placed at `SPEED_FREQUENCY`.

    A wheel carries its share of the robot: J w' = k1 u - k2 w - (load), J = I_w + m r^2 / n. With
    k1 u = k2 w_r + J (2 s e + s^2 integral(e)) the error obeys e'' + 2 s e' + s^2 e = 0; back-EMF adds to the damping.
    """

    def __init__(self, robot: Robot, configuration: Array) -> None:
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, configuration)
        motor, count = robot.drive_motor, len(robot.wheels)
        if motor is None:
            raise RobotDescriptionError(f"robot '{robot.name}' has no motor (table [motor]), so it cannot drive")
        axes = [data.oMi[wheel.joint_id].rotation @ wheel.axis_in_joint for wheel in robot.wheels]
        self.signs: Array = np.array([math.copysign(1.0, float(axis[1])) for axis in axes])
        self._radius: Array = np.array([wheel.radius for wheel in robot.wheels])
        inertias = [
            float(wheel.axis_in_joint @ robot.model.inertias[wheel.joint_id].inertia @ wheel.axis_in_joint)
            for wheel in robot.wheels
        ]
        self._inertia: Array = np.array(inertias) + robot.mass * self._radius**2 / count
        # The motor's constants are those of two wheels together.
        self._torque_constant, self._back_emf = 0.5 * motor.torque_constant, 0.5 * motor.back_emf_constant
        self._integral: Array = np.zeros(count)

    def duty(self, wheel_rate: Array, speed: float, period: float) -> Array:
        """Duties from the wheels' joint rates [rad/s], for a speed [m/s], every period [s]; shape (wheels,)."""
        wanted = speed / self._radius
        error = wanted - self.signs * wheel_rate
        feedback = self._inertia * (2.0 * SPEED_FREQUENCY * error + SPEED_FREQUENCY**2 * self._integral)
        duty = (self._back_emf * wanted + feedback) / self._torque_constant
        # The integral waits while a motor is at its limit.
        self._integral += np.where(np.abs(duty) < 1.0, error, 0.0) * period
        return np.asarray(self.signs * np.clip(duty, -1.0, 1.0))
