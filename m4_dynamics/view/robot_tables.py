"""Tables that show what a robot is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from m4_dynamics.view.tables import cell, make_table

__all__ = ["findings_table", "robot_tables"]


def findings_table(title: str, findings: Sequence[Mapping[str, str]]) -> Table:
    """A table of what is wrong.

    Args:
        title: The title.
        findings: Severity, where, what and hint of each.

    Returns:
        The table.
    """
    columns = ["severity", "where", "what", "hint"]
    return make_table(title, columns, ([finding[column] for column in columns] for finding in findings))


def robot_tables(description: Mapping[str, Any]) -> list[Table]:
    """One table for each kind of part that the robot has.

    Args:
        description: As `m4_dynamics.robot.inspection.describe_robot` gives it.

    Returns:
        The tables, the findings last.
    """
    described = ("motor", "ground", "balance") if "toml" in description["files"] else ()
    overview: list[list[object]] = [
        ["robot", description["robot"]],
        ["mass [kg]", cell(description["mass_kg"])],
        ["degrees of freedom", description["degrees_of_freedom"]],
        ["moving bodies", len(description["bodies"])],
        *([f"{kind} file", file["path"]] for kind, file in description["files"].items()),
    ]
    tables: list[tuple[str, list[str], list[list[object]]]] = [
        ("Robot", ["", "value"], overview),
        (
            "Bodies",
            ["body", "moved by", "mass [kg]", "CoM in joint [m]", "principal moments [kg m2]"],
            [
                [
                    body["name"],
                    body["moved_by"],
                    body["mass_kg"],
                    _vector(body["com_in_joint_m"]),
                    _vector(body["principal_moments_kg_m2"]),
                ]
                for body in description["bodies"]
            ],
        ),
        (
            "Joints",
            ["joint", "type", "parent", "lower", "upper", "unit", "effort [N m or N]", "speed [unit/s]", "role"],
            [
                [
                    joint[key]
                    for key in ("name", "type", "parent", "lower", "upper", "unit", "effort", "velocity", "role")
                ]
                for joint in description["joints"]
            ],
        ),
        (
            "Wheels",
            ["joint", "radius [m]", "axis in joint", "continuous", "drive wheel"],
            [
                [
                    wheel["joint"],
                    wheel["radius_m"],
                    _vector(wheel["axis_in_joint"]),
                    wheel["continuous"],
                    wheel["drive"],
                ]
                for wheel in description["wheels"]
            ],
        ),
        (
            "Thrusters",
            ["frame", "carried by", "max thrust [N]", "moment/thrust [m]", "rotor lag [s]", "used to balance"],
            [list(thruster.values()) for thruster in description["thrusters"]],
        ),
        (
            "Servos",
            ["joint", "stiffness [N m/rad]", "damping [N m s/rad]", "effort [N m]", "speed [rad/s]"],
            [list(servo.values()) for servo in description["servos"]],
        ),
        (
            "Contact points",
            ["frame", "carried by", "position in joint [m]"],
            [
                [point["name"], point["carried_by"], _vector(point["position_in_joint_m"])]
                for point in description["contact_points"]
            ],
        ),
        (
            "Postures (overall dimensions of the collision geometry)",
            ["posture", "attitude", "length [m]", "width [m]", "height [m]"],
            [
                [posture[key] for key in ("name", "attitude", "length_m", "width_m", "height_m")]
                for posture in description["postures"]
            ],
        ),
        (
            "Motor, ground and balance",
            ["", "value"],
            [
                [f"{table}.{key}", ", ".join(value) if isinstance(value, tuple) else cell(value)]
                for table in described
                for key, value in (description[table] or {}).items()
            ],
        ),
        (
            "Assumed values",
            ["key", "value", "reason"],
            [[assumed["key"], cell(assumed["value"]), assumed["reason"]] for assumed in description["assumed"]],
        ),
    ]
    shown = [make_table(title, columns, rows) for title, columns, rows in tables if rows]
    nothing = [{"severity": "none", "where": "-", "what": "nothing wrong was found", "hint": ""}]
    return [*shown, findings_table("Findings", description["findings"] or nothing)]


def _vector(values: Sequence[float]) -> str:
    return " ".join(cell(value) for value in values)
