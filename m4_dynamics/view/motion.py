"""Motions of the scene's nodes: where each is at each instant. A replay plays them, a live view sends them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.view.three import Command, typed_array

__all__ = ["Motion", "animation_command", "motion_matrix", "quaternions_onto"]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """One node over n instants, in its parent's frame.

    Attributes:
        path: The node.
        position: Positions, shape (n, 3) [m], or None for a node that is not moved.
        quaternion: Rotations (x, y, z, w), shape (n, 4), or None for a node that doesn't turn.
        scale: Factors along the node's own axes, shape (n, 3), or None for a node of constant size.
        times: Its own instants, from zero to the scene's end, shape (n,) [s], or None for those of the scene.
    """

    path: str
    position: NDArray[np.float64] | None = None
    quaternion: NDArray[np.float64] | None = None
    scale: NDArray[np.float64] | None = None
    times: NDArray[np.float64] | None = None


def animation_command(motions: Sequence[Motion], times: NDArray[np.float64], frames_per_second: float) -> Command:
    """One command that plays all motions together, over and over.

    Args:
        motions: The motions, all over the same instants but for those that have their own.
        times: The instants, from zero on, shape (n,) [s].
        frames_per_second: Rate that the viewer shows [1/s]; the tracks are timed in these frames.

    Returns:
        The command.
    """
    frames = typed_array(times * frames_per_second)
    ends = typed_array(times[[0, -1]] * frames_per_second)
    animations = []
    for motion in motions:
        tracks: list[dict[str, Any]] = []
        for name, kind, values in (
            ("position", "vector3", motion.position),
            ("quaternion", "quaternion", motion.quaternion),
            ("scale", "vector3", motion.scale),
        ):
            if values is not None:
                if (values == values[0]).all():  # nothing moves: its two ends say so
                    key_times, key_values = ends, typed_array(values[[0, -1]])
                elif motion.times is not None:
                    key_times, key_values = typed_array(motion.times * frames_per_second), typed_array(values)
                else:
                    key_times, key_values = frames, typed_array(values)
                tracks.append({"name": f".{name}", "type": kind, "times": key_times, "values": key_values})
        animations.append(
            {"path": motion.path, "clip": {"fps": frames_per_second, "name": "default", "tracks": tracks}}
        )
    # Colour and visibility tracks don't play, and nothing can be created on the way: nodes only move, turn and scale.
    options = {"play": True, "repetitions": float("inf")}
    return {"type": "set_animation", "path": "", "animations": animations, "options": options}


def motion_matrix(motion: Motion, index: int) -> NDArray[np.float64]:
    """A node's homogeneous transform at one instant.

    Args:
        motion: The motion.
        index: Number of the instant.

    Returns:
        The transform in the parent's frame, shape (4, 4).
    """
    matrix = np.eye(4)
    if motion.quaternion is not None:
        x, y, z, w = motion.quaternion[index]
        matrix[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    if motion.scale is not None:
        matrix[:3, :3] = matrix[:3, :3] * motion.scale[index]
    if motion.position is not None:
        matrix[:3, 3] = motion.position[index]
    return matrix


def quaternions_onto(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shortest rotations that turn the z axis onto directions.

    Args:
        directions: Vectors of any length, shape (n, 3); a zero vector gives no rotation.

    Returns:
        Quaternions (x, y, z, w), shape (n, 4).
    """
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    unit = np.divide(directions, length, out=np.tile([0.0, 0.0, 1.0], (len(directions), 1)), where=length > 1e-12)
    quaternions = np.column_stack([-unit[:, 1], unit[:, 0], np.zeros(len(unit)), 1.0 + unit[:, 2]])
    opposite = quaternions[:, 3] < 1e-9
    quaternions[opposite] = (1.0, 0.0, 0.0, 0.0)
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))
