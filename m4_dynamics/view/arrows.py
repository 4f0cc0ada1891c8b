"""Force arrows: a shaft and a head, made once, then moved, turned and stretched."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.view.motion import Motion, quaternions_onto
from m4_dynamics.view.three import Command, Material, cone, cylinder, set_object, set_property

__all__ = ["HIDDEN_SCALE", "arrow_commands", "arrow_motions", "round_scale"]

HIDDEN_SCALE = 1e-5  # of something that is not to be seen; zero would make its transform singular
_SHAFT_RADIUS, _HEAD_RADIUS, _HEAD_LENGTH = 0.010, 0.027, 0.070  # [m]
_LEAST_LENGTH = 4e-3  # [m] shorter arrows are hidden
_KNOCKS = 5e-3  # share of the instants in which a force may be larger, as at a corner of the ground
_LONGEST_ARROW = 0.65  # [m] wanted for the largest force in sight


def arrow_commands(path: str, colour: str) -> list[Command]:
    """Commands that build an arrow along its node's z axis.

    Args:
        path: The arrow's node; the motion places it.
        colour: sRGB hex.

    Returns:
        The commands: a shaft of unit length and a head, drawn over everything else.
    """
    material = Material(colour=colour, in_front=True)
    shaft, head = f"{path}/shaft/rod", f"{path}/head/tip"
    return [
        set_object(shaft, cylinder(_SHAFT_RADIUS, 1.0, base_at_origin=True), material),
        set_object(head, cone(_HEAD_RADIUS, _HEAD_LENGTH, base_at_origin=True), material),
        # An arrow is a sign, not a body: it throws no shadow.
        *(set_property(f"{one}/<object>", "castShadow", False) for one in (shaft, head)),
    ]


def arrow_motions(path: str, origin: ArrayLike, force: ArrayLike, *, metres_per_newton: float) -> list[Motion]:
    """Motions that show a force over time.

    Args:
        path: The arrow's node.
        origin: Point of application, shape (n, 3) [m]; NaN where there is none.
        force: Force in the same frame, shape (n, 3) [N].
        metres_per_newton: Length of an arrow per force.

    Returns:
        Motions of the node, its shaft and its head; the arrow shrinks to nothing without a force or point.
    """
    places, forces = np.asarray(origin, dtype=float), np.asarray(force, dtype=float)
    known = np.isfinite(places).all(axis=1) & np.isfinite(forces).all(axis=1)
    vectors = np.where(known[:, None], forces, 0.0) * metres_per_newton
    length = np.linalg.norm(vectors, axis=1)
    seen = length > _LEAST_LENGTH
    # An arrow shorter than twice its head shrinks as a whole, so that it keeps its looks.
    size = np.where(seen, np.minimum(1.0, length / (2.0 * _HEAD_LENGTH)), HIDDEN_SCALE)
    shaft = np.maximum(length / size - _HEAD_LENGTH, _HEAD_LENGTH)
    count = len(length)
    ones = np.ones(count)
    tip = np.column_stack([np.zeros(count), np.zeros(count), shaft])
    return [
        Motion(path, _hold(places, known), quaternions_onto(vectors), np.repeat(size[:, None], 3, axis=1)),
        Motion(f"{path}/shaft", scale=np.column_stack([ones, ones, shaft])),
        Motion(f"{path}/head", position=tip),
    ]


def round_scale(forces: Iterable[ArrayLike]) -> float:
    """A round length per force at which the largest force, short knocks aside, makes an arrow of good length.

    Args:
        forces: Forces, each of shape (..., 3) [N].

    Returns:
        1, 2 or 5 times a power of ten [m/N].
    """
    largest = 0.0
    for force in forces:
        lengths = np.linalg.norm(np.asarray(force, dtype=float), axis=-1).ravel()
        lengths = lengths[np.isfinite(lengths)]
        if lengths.size:
            largest = max(largest, float(np.quantile(lengths, 1.0 - _KNOCKS)))
    if largest <= 0.0:
        return 0.01
    wanted = _LONGEST_ARROW / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    step = max(factor for factor in (1.0, 2.0, 5.0) if factor * power <= wanted * (1.0 + 1e-9))
    return float(step * power)


def _hold(places: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Replace unknown points by the last known one, so that a hidden arrow stays near where it was."""
    if not known.any():
        return np.zeros_like(places)
    index = np.where(known, np.arange(len(known)), -1)
    index = np.maximum.accumulate(index)
    index[index < 0] = int(np.argmax(known))
    return places[index]
