"""What a scene shows beyond robot and ground, in groups that its legend names and switches on and off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import xarray
from numpy.typing import NDArray

from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.arrows import arrow_commands, arrow_motions
from m4_dynamics.view.cones import cone_commands, cone_motion, ground_normals
from m4_dynamics.view.frames import Frames
from m4_dynamics.view.ghost import ghost_commands, ghost_motions
from m4_dynamics.view.motion import Motion
from m4_dynamics.view.pendulum_overlay import pendulum_commands, pendulum_motions
from m4_dynamics.view.reduced_motion import ReducedMotion, sample_reduced
from m4_dynamics.view.rotors import rotor_commands, rotor_motion, rotor_path
from m4_dynamics.view.style import COLOURS
from m4_dynamics.view.three import Command, Material, set_object, set_property, sphere
from m4_dynamics.view.trail import trail_commands, trail_corners, trail_motions

__all__ = [
    "COM_COLOUR",
    "CONTACT_COLOUR",
    "GHOST_COLOUR",
    "REDUCED_COLOUR",
    "THRUST_COLOUR",
    "TRAIL",
    "LegendEntry",
    "Overlays",
    "legend_entries",
    "overlay_commands",
    "overlay_motions",
    "overlays_of",
]

THRUST_COLOUR = COLOURS["purple"]
CONTACT_COLOUR = COLOURS["green"]
COM_COLOUR = COLOURS["orange"]
REDUCED_COLOUR = "#D01C3F"
GHOST_COLOUR = COLOURS["sky"]
#: Node of the trail of the centre of mass.
TRAIL = "/trail"


@dataclass(frozen=True, slots=True, eq=False)
class Overlays:
    """What there is to show besides arrows and the centre of mass.

    Attributes:
        friction: Static friction coefficient of the cones; None shows none.
        profile: Corners (x, z) of the whole terrain, shape (k, 2) [m].
        reduced: The reduced model and its reference, or None.
        trail: Indices of the instants at which the trail of the centre of mass has its corners, or None.
    """

    friction: float | None
    profile: NDArray[np.float64]
    reduced: ReducedMotion | None = None
    trail: NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """One line of the legend.

    Attributes:
        kind: Its picture: "arrow", "cone", "dot", "trail", "pendulum", "ghost" or "disc".
        colour: sRGB hex.
        text: What is shown.
        nodes: The nodes that it switches.
        shown: Whether they are seen at first.
    """

    kind: str
    colour: str
    text: str
    nodes: tuple[str, ...]
    shown: bool = True


def overlays_of(dataset: xarray.Dataset, robot: Robot, frames: Frames) -> Overlays:
    """Everything that a trajectory has to show.

    Args:
        dataset: The trajectory.
        robot: The robot that made it.
        frames: The instants shown.

    Returns:
        The overlays.
    """
    friction = float(dataset.attrs.get("friction_static", np.nan))
    return Overlays(
        friction=friction if np.isfinite(friction) and friction > 0.0 else None,
        profile=np.column_stack([dataset["terrain_x"].values, dataset["terrain_z"].values]),
        reduced=sample_reduced(dataset, robot, frames),
        trail=trail_corners(frames.elapsed, frames.com),
    )


def overlay_commands(robot: Robot, frames: Frames, overlays: Overlays) -> list[Command]:
    """Commands that build everything beyond robot and ground; the motions put it into its place.

    Args:
        robot: The robot.
        frames: The instants shown; only the trail depends on them.
        overlays: What there is to show.

    Returns:
        The commands.
    """
    commands: list[Command] = []
    for thruster in robot.thrusters:
        commands += rotor_commands(robot, thruster, THRUST_COLOUR)
        commands += arrow_commands(_thrust_path(thruster.frame), THRUST_COLOUR)
    for wheel in robot.wheels:
        commands += arrow_commands(_contact_path(wheel.joint), CONTACT_COLOUR)
        if overlays.friction is not None:
            commands += cone_commands(_cone_path(wheel.joint), CONTACT_COLOUR, overlays.friction)
    commands.append(set_object("/com/ball", sphere(0.018), Material(colour=COM_COLOUR, in_front=True)))
    commands.append(set_property("/com/ball/<object>", "castShadow", False))
    if overlays.trail is not None:
        commands += trail_commands(TRAIL, COM_COLOUR, frames.com[overlays.trail])
    reduced = overlays.reduced
    if reduced is not None:
        commands += pendulum_commands("/reduced", REDUCED_COLOUR, reduced.reduction.parameters)
        if reduced.reference is not None:
            commands += ghost_commands("/ghost", GHOST_COLOUR, robot, reduced.reduction)
    return commands


def overlay_motions(robot: Robot, frames: Frames, overlays: Overlays, *, metres_per_newton: float) -> list[Motion]:
    """Motions of everything beyond robot and ground.

    Args:
        robot: The robot.
        frames: The instants.
        overlays: What there is to show.
        metres_per_newton: Length of a force arrow per force.

    Returns:
        The motions, over the same instants; pieces of the trail have instants of their own.
    """
    motions: list[Motion] = []
    nowhere = np.full((len(frames.time), 3), np.nan)
    for thruster in robot.thrusters:
        origin = frames.thrust_position.get(thruster.frame, nowhere)
        force = frames.thrust_force.get(thruster.frame, nowhere)
        motions += arrow_motions(_thrust_path(thruster.frame), origin, force, metres_per_newton=metres_per_newton)
        motions.append(rotor_motion(robot, thruster, np.linalg.norm(force, axis=1)))
    centres = _wheel_centres(robot, frames) if overlays.friction is not None else {}
    for wheel in robot.wheels:
        origin = frames.contact_position.get(wheel.joint, nowhere)
        force = frames.contact_force.get(wheel.joint, nowhere)
        motions += arrow_motions(_contact_path(wheel.joint), origin, force, metres_per_newton=metres_per_newton)
        if wheel.joint in centres:
            normal = ground_normals(overlays.profile, origin, centres[wheel.joint])
            motions.append(
                cone_motion(_cone_path(wheel.joint), origin, force, normal, metres_per_newton=metres_per_newton)
            )
    motions.append(Motion("/com", frames.com))
    if overlays.trail is not None:
        corners = overlays.trail
        end = float(frames.elapsed[-1])
        motions += trail_motions(TRAIL, frames.elapsed[corners], frames.com[corners], end)
    reduced = overlays.reduced
    if reduced is not None:
        parameters = reduced.reduction.parameters
        motions += pendulum_motions(
            "/reduced", parameters, reduced.true, reduced.thrust, metres_per_newton=metres_per_newton
        )
        if reduced.reference is not None:
            motions += ghost_motions("/ghost", robot, reduced.reduction, reduced.reference)
    return motions


def legend_entries(robot: Robot, overlays: Overlays) -> tuple[LegendEntry, ...]:
    """The lines of the legend.

    Args:
        robot: The robot.
        overlays: What there is to show.

    Returns:
        One entry per group of nodes.
    """
    rotors = tuple(rotor_path(robot, thruster) for thruster in robot.thrusters)
    entries = []
    if robot.thrusters:
        entries.append(LegendEntry("arrow", THRUST_COLOUR, "thrust on the robot", ("/thrust", *rotors)))
    entries.append(LegendEntry("arrow", CONTACT_COLOUR, "ground on a wheel", ("/contact",)))
    if overlays.friction is not None:
        entries.append(LegendEntry("cone", CONTACT_COLOUR, "friction cone", ("/cone",)))
    entries.append(LegendEntry("dot", COM_COLOUR, "centre of mass", ("/com",)))
    if overlays.trail is not None:
        entries.append(LegendEntry("trail", COM_COLOUR, "its trail", (TRAIL,)))
    if overlays.reduced is not None:
        entries.append(LegendEntry("pendulum", REDUCED_COLOUR, "reduced model", ("/reduced",), shown=False))
        if overlays.reduced.reference is not None:
            entries.append(LegendEntry("ghost", GHOST_COLOUR, "reference", ("/ghost",), shown=False))
    return tuple(entries)


def _wheel_centres(robot: Robot, frames: Frames) -> dict[str, NDArray[np.float64]]:
    """Joint -> centre of its wheel in the world at every instant, shape (n, 3) [m]."""
    data = robot.model.createData()
    centres = {wheel.joint: np.empty((len(frames.time), 3)) for wheel in robot.wheels}
    for index, configuration in enumerate(frames.configuration):
        pin.forwardKinematics(robot.model, data, configuration)
        for wheel in robot.wheels:
            centres[wheel.joint][index] = data.oMi[wheel.joint_id].translation
    return centres


def _thrust_path(frame: str) -> str:
    return f"/thrust/{frame.replace('/', '_')}"


def _contact_path(joint: str) -> str:
    return f"/contact/{joint.replace('/', '_')}"


def _cone_path(joint: str) -> str:
    return f"/cone/{joint.replace('/', '_')}"
