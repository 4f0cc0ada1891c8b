"""Load a robot from its TOML description, or from a bare URDF.

A TOML description names the URDF and the SRDF and says what they cannot; a bare URDF still loads, without wheels,
thrusters or servos, so that it can be inspected.
"""

from __future__ import annotations

import hashlib
import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import m4_dynamics
from m4_dynamics.errors import RobotDescriptionError, UnknownNameError
from m4_dynamics.robot.description import (
    RobotDescription,
    ServoSettings,
    ThrusterSettings,
    WheelSettings,
    read_description,
)
from m4_dynamics.robot.robot import Balance, ContactPoint, Ground, Posture, Robot, Servo, Thruster, Wheel

__all__ = ["bundled_description", "load_robot"]


def bundled_description() -> Path:
    """Path of M4's TOML description, in an installed package as in a source checkout.

    Returns:
        The path.

    Raises:
        RobotDescriptionError: If neither place has it, which means a broken installation.
    """
    package = Path(m4_dynamics.__file__).resolve().parent
    places = (package / "urdf" / "m4.toml", package.parent / "urdf" / "m4.toml")
    for place in places:
        if place.is_file():
            return place
    raise RobotDescriptionError(f"the bundled robot is not where it should be: {places[0]} or {places[1]}")


def load_robot(description: Path | str | None = None) -> Robot:
    """Load a robot.

    Args:
        description: A TOML description, or a URDF; the TOML file beside a URDF with the same stem is used when there is
            one. None loads the bundled M4.

    Returns:
        The robot, on a free-flyer root.

    Raises:
        RobotDescriptionError: If a file is missing, malformed or physically impossible.
        UnknownNameError: If the description names a joint, frame or posture that the robot does not have.
    """
    path = bundled_description() if description is None else Path(description).expanduser()
    if not path.exists():
        raise RobotDescriptionError(f"{path}: no such file; expected a TOML description or a URDF")
    if not path.is_file():
        raise RobotDescriptionError(f"{path}: not a file; expected a TOML description or a URDF")
    suffix = path.suffix.lower()
    if suffix in (".urdf", ".xml") and path.with_suffix(".toml").is_file():
        path = path.with_suffix(".toml")
        suffix = ".toml"
    if suffix == ".toml":
        return _load_described(read_description(path))
    if suffix in (".urdf", ".xml"):
        return _load_bare(path)
    raise RobotDescriptionError(f"{path}: cannot tell what this is; expected a file ending in .toml or .urdf")


def _load_described(description: RobotDescription) -> Robot:
    model, collision_model, visual_model = _read_urdf(description.urdf)
    where = str(description.path)
    wheels = tuple(_wheel(model, settings, where) for settings in description.wheels)
    postures = _read_postures(model, description.srdf) if description.srdf else {}
    thrusters = tuple(_thruster(model, settings, where) for settings in description.thrusters)
    if description.balance is not None:
        _check_balance(description.balance, postures, wheels, thrusters, where)
    files = {"toml": description.path, "urdf": description.urdf}
    if description.srdf is not None:
        files["srdf"] = description.srdf
    _choose_collision_pairs(model, collision_model, description.srdf)
    return Robot(
        name=description.name,
        model=model,
        collision_model=collision_model,
        visual_model=visual_model,
        wheels=wheels,
        thrusters=thrusters,
        servos=tuple(_servo(model, settings, where) for settings in description.servos),
        contact_points=tuple(_contact_point(model, name, where) for name in description.contact_points),
        postures=MappingProxyType(postures),
        drive_motor=description.motor,
        ground=description.ground,
        balance=description.balance,
        files=MappingProxyType(files),
        file_hashes=MappingProxyType(_hashes(files)),
        assumptions=description.assumptions,
    )


def _load_bare(urdf: Path) -> Robot:
    model, collision_model, visual_model = _read_urdf(urdf)
    files = {"urdf": urdf}
    srdf = urdf.with_suffix(".srdf")
    if srdf.is_file():
        files["srdf"] = srdf
    postures = _read_postures(model, files.get("srdf"))
    _choose_collision_pairs(model, collision_model, files.get("srdf"))
    return Robot(
        name=model.name,
        model=model,
        collision_model=collision_model,
        visual_model=visual_model,
        wheels=(),
        thrusters=(),
        servos=(),
        contact_points=(),
        postures=MappingProxyType(postures),
        drive_motor=None,
        ground=Ground(),
        balance=None,
        files=MappingProxyType(files),
        file_hashes=MappingProxyType(_hashes(files)),
    )


def _hashes(files: Mapping[str, Path]) -> dict[str, str]:
    return {kind: hashlib.sha256(path.read_bytes()).hexdigest() for kind, path in files.items()}


def _read_urdf(urdf: Path) -> tuple[pin.Model, pin.GeometryModel, pin.GeometryModel]:
    if not urdf.is_file():
        raise RobotDescriptionError(f"{urdf}: no such file; expected the robot's URDF")
    # Every folder above the URDF may be the one that package:// paths start from.
    package_dirs = [str(folder) for folder in urdf.resolve().parents]
    try:
        model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
        collision_model = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.COLLISION, None, package_dirs)
        visual_model = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.VISUAL, None, package_dirs)
    except (ValueError, RuntimeError) as error:
        raise RobotDescriptionError(f"{urdf}: Pinocchio refuses it: {error}") from error
    return model, collision_model, visual_model


def _choose_collision_pairs(model: pin.Model, geometry: pin.GeometryModel, srdf: Path | None) -> None:
    """Pair every two shapes of bodies that are not neighbours, less the pairs that the SRDF disables."""
    geometry.addAllCollisionPairs()
    for pair in list(geometry.collisionPairs):
        first = geometry.geometryObjects[pair.first].parentJoint
        second = geometry.geometryObjects[pair.second].parentJoint
        if model.parents[first] == second or model.parents[second] == first:
            geometry.removeCollisionPair(pair)
    if srdf is not None:
        pin.removeCollisionPairs(model, geometry, str(srdf))


def _joint_id(model: pin.Model, name: str, where: str) -> int:
    if not model.existJointName(name):
        raise UnknownNameError("joint", name, list(model.names)[2:], where=where)
    return int(model.getJointId(name))


def _one_axis_joint_id(model: pin.Model, name: str, role: str, where: str) -> int:
    joint_id = _joint_id(model, name, where)
    if model.joints[joint_id].nv != 1:
        raise RobotDescriptionError(
            f"{where}: joint '{name}' cannot be a {role}: it has {model.joints[joint_id].nv} degrees of freedom, "
            "not one"
        )
    return joint_id


def _wheel(model: pin.Model, settings: WheelSettings, where: str) -> Wheel:
    joint_id = _one_axis_joint_id(model, settings.joint, "wheel", where)
    joint = model.joints[joint_id]
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    motion = np.asarray(data.S, dtype=float).reshape(6)
    if np.linalg.norm(motion[3:]) < 0.5:
        raise RobotDescriptionError(f"{where}: joint '{settings.joint}' slides and cannot be a wheel")
    continuous = joint.nq == 2
    if not continuous:
        lower, upper = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
        if not lower < upper:
            raise RobotDescriptionError(
                f"{where}: wheel joint '{settings.joint}' has limits {lower:g}..{upper:g} and cannot turn; make it "
                "'continuous' in the URDF, or give its limit a lower and an upper value"
            )
    return Wheel(
        joint=settings.joint,
        joint_id=joint_id,
        index_q=int(joint.idx_q),
        index_v=int(joint.idx_v),
        radius=settings.radius,
        axis_in_joint=_frozen(motion[3:]),
        continuous=continuous,
        label=_label(settings.joint),
    )


def _label(joint: str) -> str:
    return joint.replace("_wheel", "").replace("wheel_", "").replace("_joint", "").replace("_", " ")


def _thruster(model: pin.Model, settings: ThrusterSettings, where: str) -> Thruster:
    frame_id = _frame_id(model, settings.frame, where)
    frame = model.frames[frame_id]
    direction = frame.placement.rotation @ np.asarray(settings.direction)
    return Thruster(
        frame=settings.frame,
        frame_id=frame_id,
        joint_id=int(frame.parentJoint),
        position_in_joint=_frozen(frame.placement.translation),
        direction_in_joint=_frozen(direction / np.linalg.norm(direction)),
        maximum_thrust=settings.maximum_thrust,
        moment_ratio=settings.moment_ratio,
        time_constant=settings.time_constant,
    )


def _servo(model: pin.Model, settings: ServoSettings, where: str) -> Servo:
    joint_id = _one_axis_joint_id(model, settings.joint, "servo", where)
    joint = model.joints[joint_id]
    if joint.nq != 1:
        raise RobotDescriptionError(
            f"{where}: joint '{settings.joint}' is continuous; a servo needs a joint with an angle"
        )
    effort, velocity = settings.effort_limit, settings.velocity_limit
    return Servo(
        joint=settings.joint,
        joint_id=joint_id,
        index_q=int(joint.idx_q),
        index_v=int(joint.idx_v),
        stiffness=settings.stiffness,
        damping=settings.damping,
        effort_limit=float(model.effortLimit[joint.idx_v]) if effort is None else effort,
        velocity_limit=float(model.velocityLimit[joint.idx_v]) if velocity is None else velocity,
    )


def _contact_point(model: pin.Model, name: str, where: str) -> ContactPoint:
    frame = model.frames[_frame_id(model, name, where)]
    return ContactPoint(
        name=name, joint_id=int(frame.parentJoint), position_in_joint=_frozen(frame.placement.translation)
    )


def _frame_id(model: pin.Model, name: str, where: str) -> int:
    matches = [index for index, frame in enumerate(model.frames) if frame.name == name]
    if not matches:
        names = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
        raise UnknownNameError("frame", name, names, where=where)
    bodies = [index for index in matches if model.frames[index].type == pin.FrameType.BODY]
    return (bodies or matches)[0]


def _check_balance(
    balance: Balance,
    postures: Mapping[str, Posture],
    wheels: tuple[Wheel, ...],
    thrusters: tuple[Thruster, ...],
    where: str,
) -> None:
    place = f"{where}: [balance]"
    if balance.posture not in postures:
        raise UnknownNameError("posture", balance.posture, postures, where=place)
    joints = [wheel.joint for wheel in wheels]
    for joint in balance.drive_wheels:
        if joint not in joints:
            raise UnknownNameError("wheel", joint, joints, where=place)
    frames = [thruster.frame for thruster in thrusters]
    for frame in balance.thrusters:
        if frame not in frames:
            raise UnknownNameError("thruster", frame, frames, where=place)


def _read_postures(model: pin.Model, srdf: Path | None) -> dict[str, Posture]:
    """Postures of an SRDF file; Pinocchio's own reader skips unknown joints silently, this one names them."""
    if srdf is None:
        return {}
    try:
        root = ET.parse(srdf).getroot()
    except FileNotFoundError as error:
        raise RobotDescriptionError(f"{srdf}: no such file; expected the robot's SRDF") from error
    except (ET.ParseError, OSError) as error:
        raise RobotDescriptionError(f"{srdf}: not valid XML: {error}") from error
    postures = {}
    for state in root.iter("group_state"):
        name = state.get("name")
        if not name:
            raise RobotDescriptionError(f"{srdf}: a group_state has no name")
        if name in postures:
            raise RobotDescriptionError(f"{srdf}: two group_states are called '{name}'")
        postures[name] = Posture(name=name, configuration=_configuration(model, state, f"{srdf}: posture '{name}'"))
    return postures


def _configuration(model: pin.Model, state: ET.Element, where: str) -> NDArray[np.float64]:
    configuration = pin.neutral(model)
    for element in state.iter("joint"):
        name = element.get("name") or ""
        joint = model.joints[_joint_id(model, name, where)]
        text = element.get("value") or ""
        if joint.nv != 1:
            if name == model.names[1]:
                continue  # the root's pose is not part of a posture
            raise RobotDescriptionError(f"{where}: joint '{name}' has {joint.nv} degrees of freedom, not one")
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise RobotDescriptionError(f"{where}: joint '{name}' must have a finite number as value, got '{text}'")
        if joint.nq == 2:
            configuration[joint.idx_q : joint.idx_q + 2] = (math.cos(value), math.sin(value))
        else:
            configuration[joint.idx_q] = value
    return _frozen(configuration)


def _frozen(values: NDArray[np.float64]) -> NDArray[np.float64]:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
