"""The loaded robot: a Pinocchio model with its wheels, thrusters, servos, contact points and postures.

Frames: `joint` is the frame of a Pinocchio joint after its motion, so a point given "in joint" moves with the joint's
link. All units are SI.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.errors import RobotDescriptionError, UnknownNameError

__all__ = [
    "Assumption",
    "Balance",
    "ContactPoint",
    "Ground",
    "Motor",
    "Posture",
    "Robot",
    "Servo",
    "Thruster",
    "Wheel",
]

Array = NDArray[np.float64]
Item = TypeVar("Item")


@dataclass(frozen=True, slots=True, eq=False)
class Wheel:
    """A wheel, a thin disc about its joint's axis with its centre at the joint's origin.

    Attributes:
        joint: Name of the joint that spins it.
        joint_id: Index of that joint in the model.
        index_q: Start of the joint's entries in the configuration.
        index_v: The joint's entry in the velocity.
        radius: Radius [m].
        axis_in_joint: Unit vector of positive rotation, shape (3,).
        continuous: Whether the joint's configuration is (cos, sin) rather than one angle.
        label: Short name for tables and plots.
    """

    joint: str
    joint_id: int
    index_q: int
    index_v: int
    radius: float
    axis_in_joint: Array
    continuous: bool
    label: str


@dataclass(frozen=True, slots=True, eq=False)
class Thruster:
    """A propeller that pushes along a direction fixed in its frame.

    Attributes:
        frame: Name of the frame at the centre of thrust.
        frame_id: Index of that frame in the model.
        joint_id: The joint that carries the frame.
        position_in_joint: Centre of thrust, shape (3,) [m].
        direction_in_joint: Unit vector of the force on the robot, shape (3,).
        maximum_thrust: Largest thrust [N]; the least is zero.
        moment_ratio: Reaction moment on the robot about the direction per newton of thrust, signed [m].
        time_constant: First-order lag of the rotor [s]; 0 for an ideal rotor.
    """

    frame: str
    frame_id: int
    joint_id: int
    position_in_joint: Array
    direction_in_joint: Array
    maximum_thrust: float
    moment_ratio: float
    time_constant: float


@dataclass(frozen=True, slots=True)
class Servo:
    """A position-controlled joint.

    Attributes:
        joint: Name of the joint.
        joint_id: Index of the joint in the model.
        index_q: The joint's entry in the configuration.
        index_v: The joint's entry in the velocity.
        stiffness: Proportional gain [N m/rad].
        damping: Derivative gain [N m s/rad].
        effort_limit: Largest torque [N m].
        velocity_limit: Largest rate [rad/s].
    """

    joint: str
    joint_id: int
    index_q: int
    index_v: int
    stiffness: float
    damping: float
    effort_limit: float
    velocity_limit: float


@dataclass(frozen=True, slots=True, eq=False)
class ContactPoint:
    """A point of the robot, other than a wheel, that may touch the ground.

    Attributes:
        name: The frame at the point.
        joint_id: The joint that carries it.
        position_in_joint: The point, shape (3,) [m].
    """

    name: str
    joint_id: int
    position_in_joint: Array


@dataclass(frozen=True, slots=True)
class Motor:
    """The drive motors: torque = torque_constant * duty - back_emf_constant * wheel rate relative to the body.

    Attributes:
        torque_constant: k1, of the two drive wheels together [N m].
        back_emf_constant: k2, of the two drive wheels together [N m s].
    """

    torque_constant: float
    back_emf_constant: float


@dataclass(frozen=True, slots=True)
class Ground:
    """A compliant ground with Stribeck friction.

    Attributes:
        stiffness: Normal stiffness of a contact [N/m].
        damping: Normal damping of a contact [N s/m].
        transition_width: Penetration over which stiffness and damping come in [m].
        friction_static: Peak friction coefficient.
        friction_dynamic_fraction: Friction coefficient of fast sliding, as a fraction of the peak.
        stiction_speed: Sliding speed at which friction reaches its peak [m/s].
        stribeck_speed: Sliding speed over which friction falls from its peak [m/s].
        viscous_friction: Growth of the coefficient with the sliding speed [s/m].
    """

    stiffness: float = 1.0e5
    damping: float = 500.0
    transition_width: float = 1.0e-4
    friction_static: float = 0.8
    friction_dynamic_fraction: float = 0.8
    stiction_speed: float = 1.0e-4
    stribeck_speed: float = 0.02
    viscous_friction: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """A named set of joint angles.

    Attributes:
        name: The posture's name.
        configuration: Full configuration with the free-flyer at the origin, shape (nq,).
    """

    name: str
    configuration: Array


@dataclass(frozen=True, slots=True)
class Balance:
    """How the robot stands on two wheels.

    Attributes:
        posture: The posture that it balances in.
        drive_wheels: Joints of the wheels that carry it, the robot's left one first.
        thrusters: Frames of the thrusters used while balancing; may be empty.
        forward: The pendulum's forward axis in the base frame; None takes the mean thrust direction, or the base's x
            axis for a robot without thrusters.
    """

    posture: str
    drive_wheels: tuple[str, str]
    thrusters: tuple[str, ...] = ()
    forward: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class Assumption:
    """A value in the description that has no published source.

    Attributes:
        key: Path of the value in the TOML file, such as "motor.torque_constant".
        value: The value.
        reason: Why this figure.
    """

    key: str
    value: object
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """A robot as loaded from its URDF, SRDF and TOML files.

    Attributes:
        name: The robot's name.
        model: Rigid-body model with a free-flyer root.
        collision_model: Collision geometry; pairs of neighbouring bodies are left out.
        visual_model: Visual geometry.
        wheels: All wheels, driven or not.
        thrusters: All thrusters.
        servos: All position-controlled joints.
        contact_points: Points other than wheels that may touch the ground.
        postures: Name -> posture.
        drive_motor: The drive motors, or None if the description has none; read it through `motor`.
        ground: The ground's properties.
        balance: How it balances, or None for a robot that does not.
        files: "urdf", "srdf", "toml" -> path, as far as they exist.
        file_hashes: The same keys -> SHA-256 of the file.
        assumptions: Values without a published source.
    """

    name: str
    model: pin.Model
    collision_model: pin.GeometryModel
    visual_model: pin.GeometryModel
    wheels: tuple[Wheel, ...]
    thrusters: tuple[Thruster, ...]
    servos: tuple[Servo, ...]
    contact_points: tuple[ContactPoint, ...]
    postures: Mapping[str, Posture]
    drive_motor: Motor | None
    ground: Ground
    balance: Balance | None
    files: Mapping[str, Path]
    file_hashes: Mapping[str, str]
    assumptions: tuple[Assumption, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to another process; read-only mappings cannot, so they are made anew there."""
        values = [getattr(self, item.name) for item in fields(self)]
        return _robot_from_values, tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values)

    def without_visuals(self) -> Robot:
        """The robot without its visual geometry, whose meshes are megabytes in a pickle, for those who draw nothing."""
        return replace(self, visual_model=pin.GeometryModel())

    @property
    def mass(self) -> float:
        """Total mass [kg]."""
        return float(sum(inertia.mass for inertia in self.model.inertias))

    @property
    def gravity(self) -> float:
        """Gravitational acceleration [m/s2]."""
        return float(np.linalg.norm(self.model.gravity.linear))

    @property
    def motor(self) -> Motor:
        """The drive motors; a `RobotDescriptionError` says so if the description has none."""
        if self.drive_motor is None:
            raise RobotDescriptionError(
                f"robot '{self.name}' has no drive motor; add a [motor] table to its TOML description"
            )
        return self.drive_motor

    def require_balance(self) -> Balance:
        """How the robot balances.

        Raises:
            RobotDescriptionError: If its description has no [balance] table.
        """
        if self.balance is None:
            raise RobotDescriptionError(
                f"robot '{self.name}' does not say how it balances; add a [balance] table with posture and "
                "drive_wheels to its TOML description"
            )
        return self.balance

    def posture(self, name: str) -> Posture:
        """The posture of that name; `UnknownNameError` lists the valid names."""
        return self._named("posture", self.postures, name)

    def wheel(self, joint: str) -> Wheel:
        """The wheel on that joint; `UnknownNameError` lists the valid names."""
        return self._named("wheel", {wheel.joint: wheel for wheel in self.wheels}, joint)

    def thruster(self, frame: str) -> Thruster:
        """The thruster at that frame; `UnknownNameError` lists the valid names."""
        return self._named("thruster", {thruster.frame: thruster for thruster in self.thrusters}, frame)

    def servo(self, joint: str) -> Servo:
        """The servo on that joint; `UnknownNameError` lists the valid names."""
        return self._named("servo", {servo.joint: servo for servo in self.servos}, joint)

    def contact_point(self, name: str) -> ContactPoint:
        """The contact point of that name; `UnknownNameError` lists the valid names."""
        return self._named("contact point", {point.name: point for point in self.contact_points}, name)

    def frame_id(self, name: str) -> int:
        """Index of a frame; `UnknownNameError` lists the valid names, where Pinocchio returns nframes silently."""
        matches = [index for index, frame in enumerate(self.model.frames) if frame.name == name]
        if not matches:
            names = [frame.name for frame in self.model.frames if frame.name != "universe"]
            raise UnknownNameError("frame", name, names, where=f"robot '{self.name}'")
        # A URDF may give a link and a joint the same name; the link is meant.
        bodies = [index for index in matches if self.model.frames[index].type == pin.FrameType.BODY]
        return (bodies or matches)[0]

    def joint_id(self, name: str) -> int:
        """Index of a joint; `UnknownNameError` lists the valid names, where Pinocchio returns njoints silently."""
        if not self.model.existJointName(name):
            raise UnknownNameError("joint", name, list(self.model.names)[1:], where=f"robot '{self.name}'")
        return int(self.model.getJointId(name))

    def _named(self, kind: str, items: Mapping[str, Item], name: str) -> Item:
        if name not in items:
            raise UnknownNameError(kind, name, items, where=f"robot '{self.name}'")
        return items[name]


def _robot_from_values(*values: Any) -> Robot:
    """The other end of `Robot.__reduce__`."""
    restored: list[Any] = [MappingProxyType(value) if isinstance(value, dict) else value for value in values]
    return Robot(*restored)
