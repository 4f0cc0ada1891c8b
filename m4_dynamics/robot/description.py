"""The TOML file beside a URDF: what a URDF cannot say, parsed into dataclasses.

Only the file's own form is checked here (keys, types, signs); whether a named joint exists is for `loading` to say.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from m4_dynamics.errors import RobotDescriptionError
from m4_dynamics.robot.robot import Assumption, Balance, Ground, Motor
from m4_dynamics.robot.toml_table import TomlTable

__all__ = ["RobotDescription", "ServoSettings", "ThrusterSettings", "WheelSettings", "read_description"]


@dataclass(frozen=True, slots=True)
class WheelSettings:
    """One wheel as described.

    Attributes:
        joint: Name of the joint.
        radius: Radius [m].
    """

    joint: str
    radius: float


@dataclass(frozen=True, slots=True)
class ThrusterSettings:
    """One thruster as described.

    Attributes:
        frame: Name of the frame.
        direction: Direction of the force in the frame, shape (3,), of any length but zero.
        maximum_thrust: Largest thrust [N].
        moment_ratio: Reaction moment about the direction per newton, signed [m].
        time_constant: Lag of the rotor [s].
    """

    frame: str
    direction: tuple[float, float, float]
    maximum_thrust: float
    moment_ratio: float
    time_constant: float


@dataclass(frozen=True, slots=True)
class ServoSettings:
    """One servo as described.

    Attributes:
        joint: Name of the joint.
        stiffness: Proportional gain [N m/rad].
        damping: Derivative gain [N m s/rad].
        effort_limit: Largest torque [N m]; None takes the URDF's.
        velocity_limit: Largest rate [rad/s]; None takes the URDF's.
    """

    joint: str
    stiffness: float
    damping: float
    effort_limit: float | None
    velocity_limit: float | None


@dataclass(frozen=True, slots=True)
class RobotDescription:
    """A whole TOML file.

    Attributes:
        path: The file.
        name: The robot's name.
        urdf: Path of the URDF.
        srdf: Path of the SRDF, or None.
        wheels: The wheels.
        thrusters: The thrusters.
        servos: The servos.
        contact_points: Frames of points that may touch the ground.
        motor: The drive motors, or None.
        ground: The ground.
        balance: How the robot balances, or None.
        assumptions: Values without a published source.
    """

    path: Path
    name: str
    urdf: Path
    srdf: Path | None
    wheels: tuple[WheelSettings, ...]
    thrusters: tuple[ThrusterSettings, ...]
    servos: tuple[ServoSettings, ...]
    contact_points: tuple[str, ...]
    motor: Motor | None
    ground: Ground
    balance: Balance | None
    assumptions: tuple[Assumption, ...]


def read_description(path: Path) -> RobotDescription:
    """Read and check a robot's TOML file.

    Args:
        path: The file; paths inside it are relative to its folder.

    Returns:
        The description.

    Raises:
        RobotDescriptionError: If the file is missing or malformed, or a key is missing, unknown, of the wrong type or
            out of range; the message names file, table and key.
    """
    values = _read_toml(path)
    top = TomlTable(path, "", values)

    def table(name: str) -> TomlTable | None:
        content = top.take(name)
        return None if content is None else TomlTable(path, name, content)

    robot = table("robot")
    if robot is None:
        raise RobotDescriptionError(f"{path}: the table [robot] is missing; it names the robot and its URDF")
    name = robot.text("name", default=path.stem)
    urdf = path.parent / robot.text("urdf")
    srdf_name = robot.text("srdf", default="")
    robot.finish()
    description = RobotDescription(
        path=path,
        name=name,
        urdf=urdf,
        srdf=path.parent / srdf_name if srdf_name else None,
        wheels=_wheels(table("wheels")),
        thrusters=_thrusters(table("thrusters")),
        servos=_servos(table("servos")),
        contact_points=_contact_points(table("contact")),
        motor=_motor(table("motor")),
        ground=_ground(table("ground")),
        balance=_balance(table("balance")),
        assumptions=_assumptions(table("assumed"), values),
    )
    top.finish()
    if description.balance is not None and description.motor is None:
        raise RobotDescriptionError(f"{path}: [balance] needs a [motor] table with the constants of the drive motors")
    return description


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise RobotDescriptionError(f"{path}: no such file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise RobotDescriptionError(f"{path}: cannot be read ({error})") from error
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise RobotDescriptionError(f"{path}: not valid TOML: {error}") from error


def _wheels(table: TomlTable | None) -> tuple[WheelSettings, ...]:
    if table is None:
        return ()
    joints = table.names("joints")
    radius = table.number_of_each("radius", joints, above=0.0)
    table.finish()
    return tuple(WheelSettings(joint=joint, radius=radius[joint]) for joint in joints)


def _thrusters(table: TomlTable | None) -> tuple[ThrusterSettings, ...]:
    if table is None:
        return ()
    frames = table.names("frames")
    direction = table.direction("direction") or (0.0, 0.0, 1.0)
    maximum = table.number_of_each("maximum_thrust", frames, above=0.0)
    moment_ratio = table.number_of_each("moment_ratio", frames, default=0.0)
    time_constant = table.number_of_each("time_constant", frames, default=0.0, least=0.0)
    table.finish()
    return tuple(
        ThrusterSettings(
            frame=frame,
            direction=direction,
            maximum_thrust=maximum[frame],
            moment_ratio=moment_ratio[frame],
            time_constant=time_constant[frame],
        )
        for frame in frames
    )


def _servos(table: TomlTable | None) -> tuple[ServoSettings, ...]:
    if table is None:
        return ()
    joints = table.names("joints")
    stiffness = table.number_of_each("stiffness", joints, above=0.0)
    damping = table.number_of_each("damping", joints, least=0.0)
    effort_limit = table.optional_number_of_each("effort_limit", joints, above=0.0)
    velocity_limit = table.optional_number_of_each("velocity_limit", joints, above=0.0)
    table.finish()
    return tuple(
        ServoSettings(
            joint=joint,
            stiffness=stiffness[joint],
            damping=damping[joint],
            effort_limit=None if effort_limit is None else effort_limit[joint],
            velocity_limit=None if velocity_limit is None else velocity_limit[joint],
        )
        for joint in joints
    )


def _contact_points(table: TomlTable | None) -> tuple[str, ...]:
    if table is None:
        return ()
    points = table.names("points")
    table.finish()
    return points


def _motor(table: TomlTable | None) -> Motor | None:
    if table is None:
        return None
    motor = Motor(
        torque_constant=table.number("torque_constant", above=0.0),
        back_emf_constant=table.number("back_emf_constant", least=0.0),
    )
    table.finish()
    return motor


def _ground(table: TomlTable | None) -> Ground:
    default = Ground()
    if table is None:
        return default
    ground = Ground(
        stiffness=table.number("stiffness", default=default.stiffness, above=0.0),
        damping=table.number("damping", default=default.damping, least=0.0),
        transition_width=table.number("transition_width", default=default.transition_width, above=0.0),
        friction_static=table.number("friction_static", default=default.friction_static, least=0.0),
        friction_dynamic_fraction=table.number(
            "friction_dynamic_fraction", default=default.friction_dynamic_fraction, least=0.0, most=1.0
        ),
        stiction_speed=table.number("stiction_speed", default=default.stiction_speed, above=0.0),
        stribeck_speed=table.number("stribeck_speed", default=default.stribeck_speed, above=0.0),
        viscous_friction=table.number("viscous_friction", default=default.viscous_friction, least=0.0),
    )
    table.finish()
    return ground


def _balance(table: TomlTable | None) -> Balance | None:
    if table is None:
        return None
    left, right = table.names("drive_wheels", length=2)
    balance = Balance(
        posture=table.text("posture"),
        drive_wheels=(left, right),
        thrusters=table.names("thrusters", optional=True),
        forward=table.direction("forward"),
    )
    table.finish()
    return balance


def _assumptions(table: TomlTable | None, values: Mapping[str, Any]) -> tuple[Assumption, ...]:
    if table is None:
        return ()
    assumptions = []
    for key, reason in table.values.items():
        node: Any = values
        for word in key.split("."):
            if not isinstance(node, dict) or word not in node:
                raise RobotDescriptionError(f"{table.file}: [assumed] '{key}' is not a key of this file")
            node = node[word]
        assumptions.append(Assumption(key=key, value=node, reason=table.check_text(f"'{key}'", reason)))
    return tuple(assumptions)
