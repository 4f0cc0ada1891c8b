"""Colours and words that all pictures of maps share."""

from __future__ import annotations

from m4_dynamics.feasibility.limits import Limit

__all__ = ["LIMIT_COLOURS", "VERDICT_COLOURS"]

#: Tints that leave lines and labels on top of them legible.
LIMIT_COLOURS: dict[Limit, str] = {
    Limit.EQUILIBRIUM: "#C3CAD1",
    Limit.FRICTION: "#F2B08A",
    Limit.NORMAL_FORCE: "#A9D6F2",
    Limit.THRUST: "#8B97A1",
    Limit.TORQUE: "#CBA4C8",
    Limit.MOTOR_SPEED: "#F3D27A",
    Limit.CLEARANCE: "#8FCDB6",
    Limit.PITCH_WINDOW: "#8FB6D9",
    Limit.COLLISION: "#4A545E",
}

VERDICT_COLOURS: dict[str, str] = {
    "climbed": "#FFFFFF",
    "lagged": "#F3D27A",
    "slipped": "#F2B08A",
    "fell": "#B5533C",
    "infeasible": "#C3CAD1",
    "aborted": "#4A545E",
}
