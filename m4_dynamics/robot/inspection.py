"""Everything worth knowing about a loaded robot, as plain values for tables and JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from m4_dynamics.robot.dimensions import overall_dimensions
from m4_dynamics.robot.finding import Finding
from m4_dynamics.robot.robot import Posture, Robot

__all__ = ["describe_robot"]

#: Pinocchio writes "no limit" as the largest double.
_UNLIMITED = 1e300


def describe_robot(
    robot: Robot, findings: Iterable[Finding] = (), *, standing_axes: ArrayLike | None = None
) -> dict[str, Any]:
    """Describe a robot.

    Args:
        robot: The robot.
        findings: What is odd about it.
        standing_axes: Forward, lateral and up of the balancing robot as columns in the base frame, shape (3, 3), to
            give the balancing posture's dimensions as it stands too; None leaves them out.

    Returns:
        Values that `json` can write: SI units unless the key ends in another one.
    """
    return {
        "robot": robot.name,
        "mass_kg": robot.mass,
        "gravity_m_s2": robot.gravity,
        "degrees_of_freedom": int(robot.model.nv),
        "files": {kind: {"path": str(path), "sha256": robot.file_hashes[kind]} for kind, path in robot.files.items()},
        "bodies": _bodies(robot),
        "joints": _joints(robot),
        "wheels": [
            {
                "joint": wheel.joint,
                "radius_m": wheel.radius,
                "axis_in_joint": _numbers(wheel.axis_in_joint),
                "continuous": wheel.continuous,
                "drive": robot.balance is not None and wheel.joint in robot.balance.drive_wheels,
            }
            for wheel in robot.wheels
        ],
        "thrusters": [
            {
                "frame": thruster.frame,
                "carried_by": robot.model.names[thruster.joint_id],
                "maximum_thrust_N": thruster.maximum_thrust,
                "moment_ratio_m": thruster.moment_ratio,
                "time_constant_s": thruster.time_constant,
                "balancing": robot.balance is not None and thruster.frame in robot.balance.thrusters,
            }
            for thruster in robot.thrusters
        ],
        "servos": [
            {
                "joint": servo.joint,
                "stiffness_Nm_rad": servo.stiffness,
                "damping_Nms_rad": servo.damping,
                "effort_limit_Nm": _limit(servo.effort_limit),
                "velocity_limit_rad_s": _limit(servo.velocity_limit),
            }
            for servo in robot.servos
        ],
        "contact_points": [
            {
                "name": point.name,
                "carried_by": robot.model.names[point.joint_id],
                "position_in_joint_m": _numbers(point.position_in_joint),
            }
            for point in robot.contact_points
        ],
        "motor": None if robot.drive_motor is None else asdict(robot.drive_motor),
        "ground": asdict(robot.ground),
        "balance": None if robot.balance is None else asdict(robot.balance),
        "postures": _postures(robot, standing_axes),
        "assumed": [asdict(assumption) for assumption in robot.assumptions],
        "findings": [asdict(finding) for finding in findings],
    }


def _numbers(array: ArrayLike) -> list[float]:
    """The entries of an array, without the noise of a computed zero."""
    return [0.0 if abs(entry) < 1e-12 else float(entry) for entry in np.asarray(array, dtype=float)]


def _limit(value: float, scale: float = 1.0) -> float | None:
    """A limit in other units, or None for no limit."""
    return None if not math.isfinite(value) or abs(value) > _UNLIMITED else float(value * scale)


def _bodies(robot: Robot) -> list[dict[str, Any]]:
    """The moving bodies; links fixed to one another are one body, named after the link that its joint moves."""
    model = robot.model
    links: dict[int, str] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            links.setdefault(frame.parentJoint, frame.name)
    bodies = []
    for joint_id in range(1, model.njoints):
        inertia = model.inertias[joint_id]
        bodies.append(
            {
                "name": links.get(joint_id, model.names[joint_id]),
                "moved_by": model.names[joint_id],
                "mass_kg": float(inertia.mass),
                "com_in_joint_m": _numbers(inertia.lever),
                "principal_moments_kg_m2": _numbers(np.linalg.eigvalsh(inertia.inertia)),
            }
        )
    return bodies


def _joints(robot: Robot) -> list[dict[str, Any]]:
    model = robot.model
    roles = {wheel.joint_id: "wheel" for wheel in robot.wheels} | {servo.joint_id: "servo" for servo in robot.servos}
    joints = []
    for joint_id in range(1, model.njoints):
        joint = model.joints[joint_id]
        kind = _joint_type(joint)
        bounded = joint.nq == 1
        scale = 1.0 if kind == "prismatic" else math.degrees(1.0)
        joints.append(
            {
                "name": model.names[joint_id],
                "type": kind,
                "parent": model.names[model.parents[joint_id]],
                "unit": "m" if kind == "prismatic" else "deg",
                "lower": _limit(float(model.lowerPositionLimit[joint.idx_q]), scale) if bounded else None,
                "upper": _limit(float(model.upperPositionLimit[joint.idx_q]), scale) if bounded else None,
                "effort": _limit(float(model.effortLimit[joint.idx_v])) if joint.nv == 1 else None,
                "velocity": _limit(float(model.velocityLimit[joint.idx_v]), scale) if joint.nv == 1 else None,
                "role": roles.get(joint_id, "root" if joint_id == 1 else None),
            }
        )
    return joints


def _joint_type(joint: pin.JointModel) -> str:
    name = str(joint.shortname()).removeprefix("JointModel")
    if name.startswith(("RUB", "RevoluteUnbounded")):
        return "continuous"
    if name.startswith(("Revolute", "RX", "RY", "RZ")):
        return "revolute"
    if name.startswith("P") and joint.nv == 1:
        return "prismatic"
    return {"FreeFlyer": "floating", "Planar": "planar"}.get(name, name)


def _postures(robot: Robot, standing_axes: ArrayLike | None) -> list[dict[str, Any]]:
    if robot.collision_model.ngeoms == 0:
        return [_posture(robot, posture, None) for posture in robot.postures.values()]
    rows = []
    for posture in robot.postures.values():
        rows.append(_posture(robot, posture, np.eye(3)))
        if standing_axes is not None and robot.balance is not None and posture.name == robot.balance.posture:
            rows.append(_posture(robot, posture, standing_axes, attitude="balancing"))
    return rows


def _posture(robot: Robot, posture: Posture, axes: ArrayLike | None, attitude: str = "base level") -> dict[str, Any]:
    size = None if axes is None else overall_dimensions(robot, posture.configuration, axes_in_world=axes)
    finite = {
        key: value if value is not None and math.isfinite(value) else None
        for key, value in (asdict(size) if size is not None else dict.fromkeys(("length", "width", "height"))).items()
    }
    angles = {}
    for joint_id in range(2, robot.model.njoints):
        joint = robot.model.joints[joint_id]
        if joint.nq == 1:
            scale = 1.0 if _joint_type(joint) == "prismatic" else math.degrees(1.0)
            angles[robot.model.names[joint_id]] = float(posture.configuration[joint.idx_q] * scale)
    return {
        "name": posture.name,
        "attitude": attitude,
        "length_m": finite["length"],
        "width_m": finite["width"],
        "height_m": finite["height"],
        "angles_deg": angles,
    }
