"""The TOML file beside a URDF: what a URDF cannot say, parsed into dataclasses.

Only the file's own form is checked here (keys, types, signs); whether a named joint exists is for `loading` to say.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from m4_dynamics.errors import RobotDescriptionError
from m4_dynamics.robot.robot import Assumption, Balance, Ground, Motor

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


class _Table:
    """One TOML table that knows where it stands, hands out checked values and notices keys that nobody asked for."""

    def __init__(self, file: Path, path: str, values: object) -> None:
        self.file = file
        self.path = path
        if not isinstance(values, dict):
            raise RobotDescriptionError(f"{file}: [{path}] must be a table, got {_type_name(values)}")
        self.values: dict[str, Any] = values
        self.known: list[str] = []

    def error(self, key: str, problem: str) -> RobotDescriptionError:
        return RobotDescriptionError(f"{self.file}: [{self.path}] {key} {problem}")

    def take(self, key: str) -> Any:
        self.known.append(key)
        return self.values.get(key)

    def require(self, key: str, wanted: str) -> Any:
        value = self.take(key)
        if value is None:
            raise self.error(key, f"is missing; expected {wanted}")
        return value

    def check_number(
        self,
        key: str,
        value: object,
        *,
        above: float | None = None,
        least: float | None = None,
        most: float | None = None,
    ) -> float:
        wanted = _range_in_words(above, least, most)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(key, f"must be {wanted}, got {_type_name(value)} {value!r}")
        number = float(value)
        too_small = (above is not None and number <= above) or (least is not None and number < least)
        if not math.isfinite(number) or too_small or (most is not None and number > most):
            raise self.error(key, f"must be {wanted}, got {number!r}")
        return number

    def number(
        self,
        key: str,
        *,
        default: float | None = None,
        above: float | None = None,
        least: float | None = None,
        most: float | None = None,
    ) -> float:
        value = self.take(key)
        if value is None:
            if default is None:
                raise self.error(key, f"is missing; expected {_range_in_words(above, least, most)}")
            return default
        return self.check_number(key, value, above=above, least=least, most=most)

    def number_of_each(
        self,
        key: str,
        names: tuple[str, ...],
        *,
        default: float | None = None,
        optional: bool = False,
        above: float | None = None,
        least: float | None = None,
    ) -> dict[str, float | None]:
        """One number for all names, or a table with a number for each name."""
        value = self.take(key)
        if value is None:
            if default is None and not optional:
                raise self.error(
                    key, f"is missing; expected {_range_in_words(above, least, None)}, or a table of one per name"
                )
            return dict.fromkeys(names, default)
        if not isinstance(value, dict):
            return dict.fromkeys(names, self.check_number(key, value, above=above, least=least))
        unknown = [name for name in value if name not in names]
        if unknown:
            raise self.error(key, f"names '{unknown[0]}', which is not in this table's list; valid: {', '.join(names)}")
        missing = [name for name in names if name not in value]
        if missing:
            raise self.error(key, f"has no number for '{missing[0]}'")
        return {name: self.check_number(f"{key}.{name}", value[name], above=above, least=least) for name in names}

    def check_text(self, key: str, value: object) -> str:
        if not isinstance(value, str) or not value:
            raise self.error(key, f"must be a non-empty string, got {_type_name(value)} {value!r}")
        return value

    def text(self, key: str, *, default: str | None = None) -> str:
        value = self.take(key)
        if value is None:
            if default is None:
                raise self.error(key, "is missing; expected a string")
            return default
        return self.check_text(key, value)

    def names(self, key: str, *, length: int | None = None, optional: bool = False) -> tuple[str, ...]:
        value = self.take(key)
        wanted = "a list of names" if length is None else f"a list of {length} names"
        if value is None:
            if optional:
                return ()
            raise self.error(key, f"is missing; expected {wanted}")
        if not isinstance(value, list) or (length is not None and len(value) != length):
            raise self.error(key, f"must be {wanted}, got {value!r}")
        names = tuple(self.check_text(f"{key}[{index}]", name) for index, name in enumerate(value))
        repeated = [name for name in names if names.count(name) > 1]
        if repeated:
            raise self.error(key, f"names '{repeated[0]}' more than once")
        return names

    def direction(self, key: str, value: object) -> tuple[float, float, float]:
        if not isinstance(value, list) or len(value) != 3:
            raise self.error(key, f"must be a list of three numbers, got {value!r}")
        x, y, z = (self.check_number(f"{key}[{index}]", number) for index, number in enumerate(value))
        if math.sqrt(x * x + y * y + z * z) < 1e-9:
            raise self.error(key, "must not be zero")
        return (x, y, z)

    def finish(self) -> None:
        unknown = [key for key in self.values if key not in self.known]
        if unknown:
            place = f"[{self.path}] " if self.path else ""
            raise RobotDescriptionError(
                f"{self.file}: {place}unknown key '{unknown[0]}'; valid: {', '.join(self.known)}"
            )


def _type_name(value: object) -> str:
    names = {
        bool: "the boolean",
        int: "the integer",
        float: "the number",
        str: "the string",
        list: "the list",
        dict: "the table",
    }
    return names.get(type(value), type(value).__name__)


def _range_in_words(above: float | None, least: float | None, most: float | None) -> str:
    parts = []
    if above is not None:
        parts.append(f"above {above:g}")
    if least is not None:
        parts.append(f"of at least {least:g}")
    if most is not None:
        parts.append(f"up to {most:g}")
    return " ".join(["a number", " and ".join(parts)]).strip()


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
    top = _Table(path, "", values)

    def table(name: str) -> _Table | None:
        content = top.take(name)
        return None if content is None else _Table(path, name, content)

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


def _given(numbers: Mapping[str, float | None], name: str) -> float:
    value = numbers[name]
    assert value is not None  # number_of_each returns None only where optional=True was asked for
    return value


def _wheels(table: _Table | None) -> tuple[WheelSettings, ...]:
    if table is None:
        return ()
    joints = table.names("joints")
    radius = table.number_of_each("radius", joints, above=0.0)
    table.finish()
    return tuple(WheelSettings(joint=joint, radius=_given(radius, joint)) for joint in joints)


def _thrusters(table: _Table | None) -> tuple[ThrusterSettings, ...]:
    if table is None:
        return ()
    frames = table.names("frames")
    given = table.take("direction")
    direction = (0.0, 0.0, 1.0) if given is None else table.direction("direction", given)
    maximum = table.number_of_each("maximum_thrust", frames, above=0.0)
    moment_ratio = table.number_of_each("moment_ratio", frames, default=0.0)
    time_constant = table.number_of_each("time_constant", frames, default=0.0, least=0.0)
    table.finish()
    return tuple(
        ThrusterSettings(
            frame=frame,
            direction=direction,
            maximum_thrust=_given(maximum, frame),
            moment_ratio=_given(moment_ratio, frame),
            time_constant=_given(time_constant, frame),
        )
        for frame in frames
    )


def _servos(table: _Table | None) -> tuple[ServoSettings, ...]:
    if table is None:
        return ()
    joints = table.names("joints")
    stiffness = table.number_of_each("stiffness", joints, above=0.0)
    damping = table.number_of_each("damping", joints, least=0.0)
    effort_limit = table.number_of_each("effort_limit", joints, optional=True, above=0.0)
    velocity_limit = table.number_of_each("velocity_limit", joints, optional=True, above=0.0)
    table.finish()
    return tuple(
        ServoSettings(
            joint=joint,
            stiffness=_given(stiffness, joint),
            damping=_given(damping, joint),
            effort_limit=effort_limit[joint],
            velocity_limit=velocity_limit[joint],
        )
        for joint in joints
    )


def _contact_points(table: _Table | None) -> tuple[str, ...]:
    if table is None:
        return ()
    points = table.names("points")
    table.finish()
    return points


def _motor(table: _Table | None) -> Motor | None:
    if table is None:
        return None
    motor = Motor(
        torque_constant=table.number("torque_constant", above=0.0),
        back_emf_constant=table.number("back_emf_constant", least=0.0),
    )
    table.finish()
    return motor


def _ground(table: _Table | None) -> Ground:
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


def _balance(table: _Table | None) -> Balance | None:
    if table is None:
        return None
    left, right = table.names("drive_wheels", length=2)
    forward = table.take("forward")
    balance = Balance(
        posture=table.text("posture"),
        drive_wheels=(left, right),
        thrusters=table.names("thrusters", optional=True),
        forward=None if forward is None else table.direction("forward", forward),
    )
    table.finish()
    return balance


def _assumptions(table: _Table | None, values: Mapping[str, Any]) -> tuple[Assumption, ...]:
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
