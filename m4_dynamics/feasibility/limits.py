"""The limits of a cell by name, and which of them is the active one."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["LIMIT_LABELS", "Limit", "limit_meanings"]


class Limit(IntEnum):
    """What bounds a cell.

    The active limit of a cell is the one with the smallest margin relative to its natural size: in a feasible cell the
    limit that is nearest, in any other the one that is missed most.

    Attributes:
        EQUILIBRIUM: No pitch balances the robot at this thrust.
        FRICTION: The ground's grip.
        NORMAL_FORCE: The wheels leave the ground, or nearly.
        THRUST: A bound of the thrusters.
        TORQUE: The motors' torque at standstill.
        MOTOR_SPEED: Torque and speed together take more than full duty, though the torque alone does not.
        CLEARANCE: The body or a leg touches the ground.
        PITCH_WINDOW: The body leans too far from the slope's normal.
        COLLISION: Two bodies of the robot overlap in this posture.
    """

    EQUILIBRIUM = 0
    FRICTION = 1
    NORMAL_FORCE = 2
    THRUST = 3
    TORQUE = 4
    MOTOR_SPEED = 5
    CLEARANCE = 6
    PITCH_WINDOW = 7
    COLLISION = 8


LIMIT_LABELS: dict[Limit, str] = {
    Limit.EQUILIBRIUM: "no equilibrium",
    Limit.FRICTION: "friction",
    Limit.NORMAL_FORCE: "normal force",
    Limit.THRUST: "thrust",
    Limit.TORQUE: "motor torque",
    Limit.MOTOR_SPEED: "motor speed",
    Limit.CLEARANCE: "ground clearance",
    Limit.PITCH_WINDOW: "pitch window",
    Limit.COLLISION: "self-collision",
}


def limit_meanings() -> str:
    """Names of the limits in the order of their codes, in one line of lower-case words, as file formats want them."""
    return " ".join(limit.name.lower() for limit in Limit)
