"""A robot's postures side by side, standing on level ground, as one self-contained page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.errors import RobotDescriptionError
from m4_dynamics.output import replacing
from m4_dynamics.reduced.reduction import reduce_robot
from m4_dynamics.robot.dimensions import OverallDimensions, extent
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.arrows import arrow_commands, arrow_motions
from m4_dynamics.view.bodies import robot_commands
from m4_dynamics.view.ground import TILE_LENGTH, ground_commands
from m4_dynamics.view.motion import Motion
from m4_dynamics.view.offline_page import camera_facts, offline_page, rounded
from m4_dynamics.view.overlays import COM_COLOUR, THRUST_COLOUR, LegendEntry
from m4_dynamics.view.scene import Bounds, joint_motions, placing_commands, surroundings
from m4_dynamics.view.silhouette import surface_points
from m4_dynamics.view.three import Command, Material, set_object, set_property, sphere

__all__ = ["ZERO_POSTURE", "posture_html", "standing_in_posture", "write_posture_html"]

#: Name of the posture with all joints at zero, for robots that have no other.
ZERO_POSTURE = "all joints at zero"

Array = NDArray[np.float64]

_VIEW_DIRECTION = (-0.05, -1.0, 0.48)
_TURN = math.radians(-62.0)  # of every robot about the vertical: its front is seen, and its left side
_GAP = 0.32  # [m] between robots
_ROW = 1.35  # distance of rows over that of robots in a row
_MARGIN = 0.35  # [m] of ground around them
_ARROW = 0.22  # [m]


@dataclass(frozen=True, slots=True, eq=False)
class _Standing:
    """A robot in a posture, somewhere on the ground."""

    name: str
    configuration: Array
    size: OverallDimensions


def write_posture_html(robot: Robot, postures: Sequence[str], path: Path | str) -> Path:
    """Write postures of a robot as one offline page.

    Args:
        robot: The robot.
        postures: Their names, at least one.
        path: The page's file.

    Returns:
        The path.

    Raises:
        UnknownNameError: The robot has no such posture.
        ResultFileError: The file cannot be written.
    """
    page = posture_html(robot, postures)
    with replacing(Path(path)) as partial:
        partial.write_text(page, encoding="utf-8")
    return Path(path)


def posture_html(robot: Robot, postures: Sequence[str]) -> str:
    """Postures of a robot as the text of one offline page.

    Args:
        robot: The robot.
        postures: Their names, at least one; `ZERO_POSTURE` is always valid.

    Returns:
        The page.

    Raises:
        UnknownNameError: The robot has no such posture.
        RobotDescriptionError: The robot has no bodies to show.
    """
    # The tallest stand behind, so that they hide nobody.
    standing = sorted((_standing(robot, name) for name in postures), key=lambda one: -round(one.size.height, 2))
    places = _places(standing)
    commands: list[Command] = []
    motions: list[Motion] = []
    labels, low, high = [], np.full(3, np.inf), np.full(3, -np.inf)
    for index, (one, place) in enumerate(zip(standing, places, strict=True)):
        turned = _turned(one.configuration, place)
        commands += robot_commands(robot, root=_root(index))
        motions += joint_motions(robot, turned[None], root=_root(index))
        commands += _mark_commands(robot, index)
        motions += _mark_motions(robot, one.name, turned, index)
        size = one.size
        labels.append(
            {
                "text": one.name.replace("_", " "),
                "detail": f"{size.length:.2f} × {size.width:.2f} × {size.height:.2f} m",
                "place": rounded((place[0], place[1] - 0.4 * math.hypot(size.length, size.width) - 0.05, 0.0), 3),
            }
        )
        reach = 0.5 * math.hypot(size.length, size.width)
        low = np.minimum(low, (place[0] - reach, place[1] - reach, 0.0))
        high = np.maximum(high, (place[0] + reach, place[1] + reach, size.height))
    bounds = Bounds(tuple(low.tolist()), tuple(high.tolist()))
    profile = np.array([[low[0] - _MARGIN, 0.0], [high[0] + _MARGIN, 0.0]])
    half_width = float(max(-low[1], high[1])) + _MARGIN
    ground = ground_commands(profile, half_width=TILE_LENGTH * math.ceil(half_width / TILE_LENGTH))
    legend = [LegendEntry("dot", COM_COLOUR, "centre of mass", tuple(f"{_root(k)}_com" for k in range(len(places))))]
    if robot.thrusters:
        nodes = tuple(f"{_root(k)}_thrust" for k in range(len(places)))
        legend.insert(0, LegendEntry("arrow", THRUST_COLOUR, "way that propellers push", nodes))
    title = f"{robot.name}: {'postures' if len(postures) > 1 else standing[0].name.replace('_', ' ')}"
    return offline_page(
        title=title,
        commands=[*surroundings(bounds), *ground, *commands, *placing_commands(motions)],
        facts={
            "conditions": [f"{robot.mass:.3g} kg", "length × width × height"],
            "labels": labels,
            "legend": [asdict(entry) for entry in legend],
            "scale": f"tiles: {100.0 * TILE_LENGTH:.3g} cm",
            "frames_per_second": 1.0,
            "start_time": 0.0,
            "times": [0.0],
            "readouts": [],
            "phases": [],
            "camera": camera_facts(bounds.low, bounds.high, _VIEW_DIRECTION, follow=None, following=False),
        },
    )


def standing_in_posture(robot: Robot, name: str) -> Array:
    """Stand a robot on the ground z = 0 in a posture.

    Args:
        robot: The robot.
        name: A posture's name, or `ZERO_POSTURE`.

    Returns:
        The configuration, shape (nq,): base level and lowest point on the ground; in the balancing posture upright on
        its drive wheels, with the centre of mass above the axle.

    Raises:
        UnknownNameError: The robot has no such posture.
        RobotDescriptionError: The robot has no bodies to show.
    """
    if name == ZERO_POSTURE:
        q = np.array(pin.neutral(robot.model))
    else:
        q = np.array(robot.posture(name).configuration, dtype=float)
    if robot.balance is not None and robot.drive_motor is not None and name == robot.balance.posture:
        reduction = reduce_robot(robot)
        forward, up = reduction.parameters.com_in_body
        rotation = reduction.frame.base_rotation_in_world(0.0, -math.atan2(forward, up))
        q[3:7] = pin.Quaternion(rotation).coeffs()
    q[2] -= _extent(robot, q, np.array([0.0, 0.0, 1.0]))[0]
    return q


def _standing(robot: Robot, name: str) -> _Standing:
    q = standing_in_posture(robot, name)
    spans = [_extent(robot, q, axis) for axis in np.eye(3)]
    # Where a robot stands is where the middle of its outline is.
    for axis in (0, 1):
        q[axis] -= 0.5 * sum(spans[axis])
    return _Standing(name, q, OverallDimensions(*(high - low for low, high in spans)))


def _extent(robot: Robot, configuration: Array, direction: Array) -> tuple[float, float]:
    """Lowest and highest coordinate of the robot's collision shapes, or of its visual ones if it has no others."""
    if robot.collision_model.ngeoms:
        return extent(robot, configuration, direction)
    data, visual_data = robot.model.createData(), robot.visual_model.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.visual_model, visual_data, configuration)
    reached = [
        (points @ np.asarray(placement.rotation).T + np.asarray(placement.translation)) @ direction
        for shape, placement in zip(robot.visual_model.geometryObjects, visual_data.oMg, strict=True)
        if (points := surface_points(shape.geometry)) is not None
    ]
    if not reached:
        raise RobotDescriptionError(f"robot '{robot.name}' has neither collision nor visual geometry to show")
    values = np.concatenate(reached)
    return float(values.min()), float(values.max())


def _places(standing: Sequence[_Standing]) -> list[tuple[float, float]]:
    """Places (x, y) in rows: one row of up to three, else two or more, the first row behind."""
    columns = len(standing) if len(standing) <= 3 else math.ceil(math.sqrt(1.4 * len(standing)))
    rows = math.ceil(len(standing) / columns)
    pitch = max(math.hypot(one.size.length, one.size.width) for one in standing) + _GAP
    places = []
    for index in range(len(standing)):
        row, column = divmod(index, columns)
        in_row = min(columns, len(standing) - row * columns)
        places.append((pitch * (column - 0.5 * (in_row - 1)), _ROW * pitch * (0.5 * (rows - 1) - row)))
    return places


def _turned(configuration: Array, place: tuple[float, float]) -> Array:
    """The configuration, turned about the vertical and moved."""
    q = configuration.copy()
    turn = pin.SE3(pin.utils.rotate("z", _TURN), np.array([*place, 0.0]))
    base = turn * pin.XYZQUATToSE3(q[:7])
    q[:7] = pin.SE3ToXYZQUAT(base)
    return q


def _root(index: int) -> str:
    return f"/posture_{index}"


def _mark_commands(robot: Robot, index: int) -> list[Command]:
    """Arrows of the propellers and the ball of the centre of mass."""
    commands = [set_object(f"{_root(index)}_com/ball", sphere(0.018), Material(colour=COM_COLOUR, in_front=True))]
    commands.append(set_property(f"{_root(index)}_com/ball/<object>", "castShadow", False))
    for order in range(len(robot.thrusters)):
        commands += arrow_commands(f"{_root(index)}_thrust/{order}", THRUST_COLOUR)
    return commands


def _mark_motions(robot: Robot, name: str, configuration: Array, index: int) -> list[Motion]:
    data = robot.model.createData()
    com = np.array(pin.centerOfMass(robot.model, data, configuration))
    motions = [Motion(f"{_root(index)}_com", com[None])]
    balance = robot.balance
    for order, thruster in enumerate(robot.thrusters):
        # While it balances, only some of the propellers push.
        idle = balance is not None and name == balance.posture and thruster.frame not in balance.thrusters
        placement = data.oMi[thruster.joint_id]
        origin = placement.act(np.array(thruster.position_in_joint))
        direction = np.zeros(3) if idle else placement.rotation @ thruster.direction_in_joint
        motions += arrow_motions(
            f"{_root(index)}_thrust/{order}", origin[None], direction[None], metres_per_newton=_ARROW
        )
    return motions
