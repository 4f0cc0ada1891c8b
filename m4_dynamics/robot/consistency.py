"""Check that a loaded robot agrees with itself: its URDF, its postures and what its TOML description says about them.

What is checked here loads without complaint and yet cannot be meant: a posture outside the joints' limits or with
colliding legs, a wheel whose stated radius is not that of its shape, drive wheels that are not on one axle.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.robot.dimensions import support
from m4_dynamics.robot.finding import Finding
from m4_dynamics.robot.robot import Balance, Posture, Robot, Wheel

__all__ = ["consistency_findings", "self_collisions"]

#: Drive wheels may be cambered this far from their common axle [rad] ...
_ANGLE_TOLERANCE = math.radians(5.0)
#: ... and their centres this far off it [m].
_AXLE_TOLERANCE = 1e-3
#: A wheel's stated radius and its shape may differ by this fraction.
_RADIUS_TOLERANCE = 0.02


def consistency_findings(robot: Robot) -> tuple[Finding, ...]:
    """Find contradictions in a loaded robot.

    Args:
        robot: The robot.

    Returns:
        The findings, in no particular order.
    """
    findings = []
    for posture in robot.postures.values():
        findings += _limit_findings(robot, posture)
        pairs = self_collisions(robot, posture.configuration)
        if pairs:
            what = f"bodies collide: {'; '.join(f'{first} with {second}' for first, second in pairs)}"
            hint = "change the angles, or disable the pair in the SRDF if its shapes are meant to overlap"
            findings.append(Finding("warning", f"posture '{posture.name}'", what, hint))
    for wheel in robot.wheels:
        findings += _wheel_findings(robot, wheel)
    if "toml" in robot.files:
        findings += _drive_findings(robot)
    if robot.ground.stiction_speed >= robot.ground.stribeck_speed:
        what = f"stiction_speed {robot.ground.stiction_speed:g} is not below stribeck_speed"
        hint = "friction then never reaches friction_static; make stiction_speed much smaller"
        findings.append(Finding("warning", "[ground]", what, hint))
    if robot.balance is not None:
        findings += _balance_findings(robot, robot.balance)
    return tuple(findings)


def self_collisions(robot: Robot, configuration: NDArray[np.float64]) -> list[tuple[str, str]]:
    """Pairs of bodies, other than neighbours, whose collision shapes overlap.

    Args:
        robot: The robot.
        configuration: Full configuration, shape (nq,).

    Returns:
        Names of the two shapes of each pair.
    """
    geometry = robot.collision_model
    data, geometry_data = robot.model.createData(), geometry.createData()
    pin.computeCollisions(robot.model, data, geometry, geometry_data, configuration, False)
    return [
        (geometry.geometryObjects[pair.first].name, geometry.geometryObjects[pair.second].name)
        for pair, result in zip(geometry.collisionPairs, geometry_data.collisionResults, strict=True)
        if result.isCollision()
    ]


def _limit_findings(robot: Robot, posture: Posture) -> list[Finding]:
    findings = []
    for joint_id in range(2, robot.model.njoints):
        joint = robot.model.joints[joint_id]
        if joint.nq != 1:
            continue
        angle = posture.configuration[joint.idx_q]
        lower, upper = robot.model.lowerPositionLimit[joint.idx_q], robot.model.upperPositionLimit[joint.idx_q]
        if not lower - 1e-9 <= angle <= upper + 1e-9:
            what = f"joint '{robot.model.names[joint_id]}' stands at {angle:g}, outside its limits {lower:g}..{upper:g}"
            findings.append(Finding("warning", f"posture '{posture.name}'", what, "change the angle or the limits"))
    return findings


def _wheel_findings(robot: Robot, wheel: Wheel) -> list[Finding]:
    """Compare the stated radius with how far the wheel's shapes reach from its axis."""
    shapes = [shape for shape in robot.collision_model.geometryObjects if shape.parentJoint == wheel.joint_id]
    if not shapes:
        return []
    axis = wheel.axis_in_joint
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    reach = 0.0
    for angle in np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False):
        direction = math.cos(angle) * first + math.sin(angle) * second
        for shape in shapes:
            placement = shape.placement
            in_shape = placement.rotation.T @ direction
            reach = max(reach, float(direction @ placement.translation) + support(shape.geometry, in_shape))
    if abs(reach - wheel.radius) <= _RADIUS_TOLERANCE * wheel.radius:
        return []
    what = f"its radius is stated as {wheel.radius:g} m, but its collision shape reaches {reach:.4g} m from its axis"
    return [Finding("warning", f"wheel '{wheel.joint}'", what, "make the two agree")]


def _drive_findings(robot: Robot) -> list[Finding]:
    """Every joint should be driven or held, within what the URDF says that it can bear."""
    findings = []
    moved = {wheel.joint_id for wheel in robot.wheels} | {servo.joint_id for servo in robot.servos}
    for joint_id in range(2, robot.model.njoints):
        if joint_id not in moved:
            hint = "list it under [servos] or [wheels], or make it fixed"
            where = f"joint '{robot.model.names[joint_id]}'"
            findings.append(Finding("warning", where, "is neither a wheel nor held by a servo: it swings freely", hint))
    for servo in robot.servos:
        bearable = float(robot.model.effortLimit[servo.index_v])
        if servo.effort_limit > bearable:
            what = f"effort_limit {servo.effort_limit:g} N m is above the {bearable:g} N m of the URDF"
            findings.append(Finding("warning", f"servo '{servo.joint}'", what, "make the two agree"))
    return findings


def _balance_findings(robot: Robot, balance: Balance) -> list[Finding]:
    where = "[balance]"
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.posture(balance.posture).configuration)
    left, right = (robot.wheel(joint) for joint in balance.drive_wheels)
    findings = []
    if abs(left.radius - right.radius) > 1e-9:
        what = f"the drive wheels differ in radius: {left.radius:g} and {right.radius:g} m"
        findings.append(Finding("error", where, what, "use two equal wheels"))
    between = data.oMi[left.joint_id].translation - data.oMi[right.joint_id].translation
    track = float(np.linalg.norm(between))
    if track < 1e-6:
        what = "the drive wheels have the same centre"
        return [*findings, Finding("error", where, what, "use two wheels side by side")]
    axle = between / track
    for wheel in (left, right):
        axis = data.oMi[wheel.joint_id].rotation @ wheel.axis_in_joint
        tilt = math.acos(min(1.0, abs(float(axis @ axle))))
        if tilt > _ANGLE_TOLERANCE:
            what = (
                f"in posture '{balance.posture}' the axis of wheel '{wheel.joint}' is {math.degrees(tilt):.1f} deg off "
                "the line between the drive wheels"
            )
            findings.append(Finding("error", where, what, "the drive wheels must be coaxial to balance on them"))
    if float(axle[1]) < 0.0:
        what = f"drive wheel '{left.joint}' is named first, but is on the robot's right"
        findings.append(Finding("warning", where, what, "name the robot's left drive wheel first"))
    findings += _thrust_findings(robot, balance, data, axle)
    com = pin.centerOfMass(robot.model, data, robot.posture(balance.posture).configuration)
    from_axle = com - data.oMi[right.joint_id].translation
    if float(np.linalg.norm(from_axle - (from_axle @ axle) * axle)) < _AXLE_TOLERANCE:
        what = f"in posture '{balance.posture}' the centre of mass is on the axle: no way is up"
        findings.append(Finding("error", where, what, "raise the body above the wheels"))
    return findings


def _thrust_findings(robot: Robot, balance: Balance, data: pin.Data, axle: NDArray[np.float64]) -> list[Finding]:
    if not balance.thrusters:
        return []
    thrusters = [robot.thruster(frame) for frame in balance.thrusters]
    directions = [data.oMi[thruster.joint_id].rotation @ thruster.direction_in_joint for thruster in thrusters]
    mean = np.mean(directions, axis=0)
    strength = float(np.linalg.norm(mean))
    if strength < 1e-6:
        what = f"in posture '{balance.posture}' the thrusters cancel each other"
        return [Finding("error", "[balance]", what, "list thrusters that push the same way")]
    findings = []
    if strength < 0.9:
        what = f"in posture '{balance.posture}' the thrusters push apart: {1.0 - strength:.0%} of thrust is lost"
        findings.append(Finding("warning", "[balance]", what, "list thrusters that push the same way"))
    sideways = math.degrees(math.asin(min(1.0, abs(float(mean @ axle)) / strength)))
    if sideways > math.degrees(_ANGLE_TOLERANCE):
        what = f"in posture '{balance.posture}' the thrust points {sideways:.1f} deg out of the plane of the wheels"
        findings.append(Finding("warning", "[balance]", what, "turn the thrusters or change the posture"))
    return findings
