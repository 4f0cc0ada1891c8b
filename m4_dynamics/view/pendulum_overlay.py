"""The reduced model drawn over the full one: wheel, bar to the centre of mass, arm to the thrust, and the thrust."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.reduced.parameters import MipParameters
from m4_dynamics.view.arrows import HIDDEN_SCALE, arrow_commands, arrow_motions
from m4_dynamics.view.motion import Motion
from m4_dynamics.view.reduced_motion import PlanarMotion
from m4_dynamics.view.three import Command, Material, cylinder, ring, set_object, set_property, set_transform, sphere
from m4_dynamics.view.trail import piece_matrix

__all__ = ["pendulum_commands", "pendulum_motions"]

_LINE, _BAR, _ARM = 0.006, 0.011, 0.005  # [m] radii


def pendulum_commands(path: str, colour: str, parameters: MipParameters) -> list[Command]:
    """Commands that build the pendulum in its own plane, x forward and z up.

    Args:
        path: Its node.
        colour: sRGB hex.
        parameters: The pendulum.

    Returns:
        The commands.
    """
    material = Material(colour=colour, in_front=True)
    wheel, body = f"{path}/wheel", f"{path}/body"
    com = np.array([parameters.com_in_body[0], 0.0, parameters.com_in_body[1]])
    thrust = np.array([parameters.thrust_point_in_body[0], 0.0, parameters.thrust_point_in_body[1]])
    radius = parameters.wheel_radius
    commands = [
        set_object(f"{wheel}/rim", ring(radius, _LINE), material),
        set_object(f"{wheel}/spoke", cylinder(_LINE, 1.0, base_at_origin=True), material),
        set_transform(f"{wheel}/spoke", piece_matrix(np.zeros(3), np.array([0.0, 0.0, radius]))),
        set_object(f"{body}/bar", cylinder(_BAR, 1.0, base_at_origin=True), material),
        set_transform(f"{body}/bar", piece_matrix(np.zeros(3), com)),
        set_object(f"{body}/mass", sphere(0.028), material),
        set_transform(f"{body}/mass", piece_matrix(com, np.add(com, (0.0, 0.0, 1.0)))),
    ]
    if np.linalg.norm(thrust) > 1e-9:
        commands.append(set_object(f"{body}/arm", cylinder(_ARM, 1.0, base_at_origin=True), material))
        commands.append(set_transform(f"{body}/arm", piece_matrix(com, thrust)))
    shadowless = [command["path"] for command in commands if command["type"] == "set_object"]
    commands += [set_property(f"{one}/<object>", "castShadow", False) for one in shadowless]
    return commands + arrow_commands(f"{path}/thrust", colour)


def pendulum_motions(
    path: str,
    parameters: MipParameters,
    planar: PlanarMotion,
    thrust: NDArray[np.float64],
    *,
    metres_per_newton: float,
) -> list[Motion]:
    """Motions of the pendulum's wheel, body and thrust arrow.

    Args:
        path: Its node.
        parameters: The pendulum.
        planar: Where it is at n instants; NaN hides it.
        thrust: Total thrust, shape (n,) [N].
        metres_per_newton: Length of the arrow per force.

    Returns:
        The motions.
    """
    known = np.isfinite(planar.axle).all(axis=1) & np.isfinite(planar.pitch) & np.isfinite(planar.wheel_angle)
    axle = np.where(known[:, None], planar.axle, 0.0)
    pitch = np.where(known, planar.pitch, 0.0)
    size = np.repeat(np.where(known, 1.0, HIDDEN_SCALE)[:, None], 3, axis=1)
    forward = np.column_stack([np.cos(pitch), np.zeros(len(pitch)), -np.sin(pitch)])
    up = np.column_stack([np.sin(pitch), np.zeros(len(pitch)), np.cos(pitch)])
    along, above = parameters.thrust_point_in_body
    origin = np.where(known[:, None], axle + along * forward + above * up, np.nan)
    force = np.where(known, thrust, 0.0)[:, None] * forward
    return [
        Motion(f"{path}/wheel", axle, _about_y(np.where(known, planar.wheel_angle, 0.0)), size),
        Motion(f"{path}/body", axle, _about_y(pitch), size),
        *arrow_motions(f"{path}/thrust", origin, force, metres_per_newton=metres_per_newton),
    ]


def _about_y(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternions (x, y, z, w) of rotations about the y axis."""
    zero = np.zeros_like(angle)
    return np.column_stack([zero, np.sin(0.5 * angle), zero, np.cos(0.5 * angle)])
