"""Friction cones, as high as the normal force: a force arrow ends on the cone's rim when friction is used up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.view.arrows import HIDDEN_SCALE
from m4_dynamics.view.motion import Motion, quaternions_onto
from m4_dynamics.view.three import Command, Material, funnel, ring_about_z, set_object, set_property

__all__ = ["cone_commands", "cone_motion", "ground_normals"]

_OPACITY = 0.15
_RIM = 0.012  # radius of the rim's section, over the cone's height
_AT_CORNER = 2e-3  # [m] contacts this near to a convex corner may be on it
_LEAST_FORCE = 0.2  # [N] smaller normal forces have no cone to see


def cone_commands(path: str, colour: str, friction: float) -> list[Command]:
    """Commands that build a cone of unit height that opens along its node's z axis.

    Args:
        path: The cone's node; the motion places it.
        colour: sRGB hex.
        friction: Static friction coefficient, the tangent of half the cone's angle.

    Returns:
        The commands.
    """
    skin, rim = f"{path}/skin", f"{path}/rim"
    return [
        set_object(skin, funnel(friction, 1.0), Material(colour=colour, opacity=_OPACITY, see_through=True)),
        set_object(rim, ring_about_z(friction, _RIM, height=1.0), Material(colour=colour, opacity=0.75)),
        *(set_property(f"{one}/<object>", "castShadow", False) for one in (skin, rim)),
    ]


def cone_motion(
    path: str,
    contact: NDArray[np.float64],
    force: NDArray[np.float64],
    normal: NDArray[np.float64],
    *,
    metres_per_newton: float,
) -> Motion:
    """Motion of a cone over time.

    Args:
        path: The cone's node.
        contact: Its tip, shape (n, 3) [m]; NaN where there is no contact.
        force: Force of the ground, shape (n, 3) [N].
        normal: Unit normal of the ground there, shape (n, 3).
        metres_per_newton: Height of the cone per normal force.

    Returns:
        The motion; the cone shrinks to nothing without contact.
    """
    known = np.asarray(np.isfinite(contact).all(axis=1) & np.isfinite(force).all(axis=1))
    pressing = (np.where(known[:, None], force, 0.0) * normal).sum(axis=1)
    size = np.where(pressing > _LEAST_FORCE, pressing * metres_per_newton, HIDDEN_SCALE)
    places = np.where(known[:, None], contact, 0.0)
    return Motion(path, places, quaternions_onto(normal), np.repeat(size[:, None], 3, axis=1))


def ground_normals(
    profile: NDArray[np.float64], contact: NDArray[np.float64], centre: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Normals of the ground where wheels touch it.

    Args:
        profile: Corners (x, z) of the terrain, shape (k, 2) [m].
        contact: Contact points, shape (n, 3) [m]; NaN gives a vertical normal.
        centre: Centres of the wheel at the same instants, shape (n, 3) [m].

    Returns:
        Unit normals, shape (n, 3): of the nearest piece of ground; on a convex corner, towards the wheel's centre.
    """
    known = np.asarray(np.isfinite(contact).all(axis=1))
    points = np.where(known[:, None], contact, 0.0)[:, [0, 2]]
    starts, steps = profile[:-1], np.diff(profile, axis=0)
    squared = (steps * steps).sum(axis=1)
    share = np.clip(((points[:, None] - starts) * steps).sum(axis=2) / squared, 0.0, 1.0)
    distance = np.linalg.norm(points[:, None] - starts - share[..., None] * steps, axis=2)
    nearest = np.argmin(distance, axis=1)
    chosen = steps[nearest] / np.sqrt(squared[nearest])[:, None]
    flat = np.column_stack([-chosen[:, 1], chosen[:, 0]])
    slopes = np.arctan2(steps[:, 1], steps[:, 0])
    for corner, falls in zip(profile[1:-1], np.diff(slopes) < 0.0, strict=True):
        if falls:
            here = np.linalg.norm(points - corner, axis=1) < _AT_CORNER
            towards = centre[here][:, [0, 2]] - points[here]
            flat[here] = towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
    flat[~known] = 0.0, 1.0
    return np.column_stack([flat[:, 0], np.zeros(len(flat)), flat[:, 1]])
