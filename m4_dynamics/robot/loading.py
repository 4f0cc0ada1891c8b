"""Load a robot from its TOML description, or from a bare URDF.

A TOML description names the URDF and the SRDF and says what they cannot; a bare URDF still loads, without wheels,
thrusters or servos, so that it can be inspected.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import coal
import numpy as np
import pinocchio as pin
from lxml import etree
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
from m4_dynamics.robot.finding import InvalidUrdfError, has_errors
from m4_dynamics.robot.inertia import model_inertia_findings
from m4_dynamics.robot.postures import read_postures
from m4_dynamics.robot.robot import Balance, ContactPoint, Ground, Posture, Robot, Servo, Thruster, Wheel
from m4_dynamics.robot.urdf_masses import inertial_syntax_findings, mass_findings

__all__ = ["bundled_description", "find_description", "load_robot"]


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
        RobotDescriptionError: If a file is missing or malformed; an `InvalidUrdfError` says what is wrong in a URDF.
        UnknownNameError: If the description names a joint, frame or posture that the robot does not have.
    """
    path = find_description(description)
    if path.suffix.lower() == ".toml":
        return _load_described(read_description(path))
    return _load_bare(path)


def find_description(description: Path | str | None = None) -> Path:
    """The file that describes a robot.

    Args:
        description: As for `load_robot`.

    Returns:
        The TOML description, or the URDF if there is none.

    Raises:
        RobotDescriptionError: If there is no such file, or its name ends neither in .toml nor in .urdf or .xml.
    """
    path = bundled_description() if description is None else Path(description).expanduser()
    if not path.is_file():
        problem = "not a file" if path.exists() else "no such file"
        raise RobotDescriptionError(f"{path}: {problem}; expected a TOML description or a URDF")
    suffix = path.suffix.lower()
    if suffix not in (".toml", ".urdf", ".xml"):
        raise RobotDescriptionError(f"{path}: cannot tell what this is; expected a file ending in .toml or .urdf")
    beside = path.with_suffix(".toml")
    return beside if beside.is_file() else path


def _load_described(description: RobotDescription) -> Robot:
    model, collision_model, visual_model = _read_urdf(description.urdf)
    where = str(description.path)
    wheels = tuple(_wheel(model, settings, where) for settings in description.wheels)
    postures = read_postures(model, description.srdf) if description.srdf else {}
    thrusters = tuple(_thruster(model, settings, where) for settings in description.thrusters)
    if description.balance is not None:
        if description.srdf is None:
            raise RobotDescriptionError(
                f"{where}: [balance] names the posture '{description.balance.posture}', but [robot] has no srdf; "
                "postures are the <group_state> elements of an SRDF file"
            )
        _check_balance(description.balance, postures, wheels, thrusters, where)
    servos = tuple(_servo(model, settings, where) for settings in description.servos)
    for joint in {wheel.joint for wheel in wheels} & {servo.joint for servo in servos}:
        raise RobotDescriptionError(f"{where}: joint '{joint}' is listed both under [wheels] and under [servos]")
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
        servos=servos,
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
    postures = read_postures(model, srdf) if srdf.is_file() else {}
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
        meshes = coal.CachedMeshLoader(coal.NODE_TYPE.BV_OBBRSS)  # reads a mesh once, however many bodies share it
        collision_model = pin.buildGeomFromUrdf(
            model, str(urdf), pin.GeometryType.COLLISION, None, package_dirs, meshes
        )
    except (ValueError, RuntimeError) as error:
        raise _refused(urdf, error) from error
    try:
        visual_model = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.VISUAL, None, package_dirs, meshes)
    except (ValueError, RuntimeError) as error:
        # Motion does not need what is only seen; `m4 inspect` warns of it, and what collides is seen instead.
        refusal = _refused(urdf, error)
        missing = any(finding.what.startswith("visual mesh") for finding in refusal.findings)
        if has_errors(refusal.findings) or not missing:
            raise refusal from error
        visual_model = collision_model.copy()
    _check_masses(model, urdf)
    return model, collision_model, visual_model


def _refused(urdf: Path, error: Exception) -> InvalidUrdfError:
    from m4_dynamics.robot.diagnosis import diagnose_urdf

    return InvalidUrdfError(urdf, diagnose_urdf(urdf), f"not a usable URDF ({error})")


def _check_masses(model: pin.Model, urdf: Path) -> None:
    """Refuse what Pinocchio takes silently although no motion follows from it."""
    root = etree.parse(str(urdf)).getroot()
    findings = [*inertial_syntax_findings(root), *mass_findings(root)]
    if not has_errors(findings):
        findings += model_inertia_findings(model)
    if has_errors(findings):
        raise InvalidUrdfError(urdf, findings, "its masses or inertias are not usable")


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


def _frozen(values: NDArray[np.float64]) -> NDArray[np.float64]:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
