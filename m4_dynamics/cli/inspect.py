"""`m4 inspect`: show what a robot description holds and what is wrong with it."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from m4_dynamics.robot.finding import Finding
    from m4_dynamics.robot.robot import Robot

__all__ = ["add_arguments", "run"]

EXIT_OK = 0
EXIT_ERROR = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument(
        "robot", nargs="?", metavar="ROBOT", help="a TOML description or a URDF; without one, the bundled M4"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    """Inspect a robot.

    Args:
        args: The parsed options.

    Returns:
        0, or 2 if anything found is an error.
    """
    from m4_dynamics.robot.description import read_description
    from m4_dynamics.robot.diagnosis import diagnose_urdf
    from m4_dynamics.robot.finding import has_errors
    from m4_dynamics.robot.inspection import describe_robot
    from m4_dynamics.robot.loading import find_description, load_robot
    from m4_dynamics.view.robot_tables import findings_table, robot_tables
    from m4_dynamics.view.tables import make_console, print_tables

    path = find_description(args.robot)
    urdf = read_description(path).urdf if path.suffix.lower() == ".toml" else path
    findings = diagnose_urdf(urdf)
    if has_errors(findings):
        # The robot cannot be loaded: what is wrong with it is all that can be shown.
        description: dict[str, Any] = {"robot": None, "urdf": str(urdf), "findings": _as_values(findings)}
    else:
        robot = load_robot(path)
        findings = (*findings, *_consistency(robot))
        description = describe_robot(robot, findings, standing_axes=_standing_axes(robot, findings))
    if args.json:
        print(json.dumps(description, indent=2, allow_nan=False))
        return EXIT_ERROR if has_errors(findings) else EXIT_OK
    console = make_console()
    if description["robot"] is None:
        print_tables(console, [findings_table(f"Not a usable robot: {urdf}", description["findings"])])
    else:
        print_tables(console, robot_tables(description))
    return EXIT_ERROR if has_errors(findings) else EXIT_OK


def _as_values(findings: tuple[Finding, ...]) -> list[dict[str, Any]]:
    from dataclasses import asdict

    return [asdict(finding) for finding in findings]


def _consistency(robot: Robot) -> tuple[Finding, ...]:
    from m4_dynamics.robot.consistency import consistency_findings

    return consistency_findings(robot)


def _standing_axes(robot: Robot, findings: tuple[Finding, ...]) -> Any:
    """The balancing robot's axes, as far as it has any."""
    from m4_dynamics.robot.finding import has_errors

    if robot.balance is None or has_errors(findings):
        return None
    from m4_dynamics.reduced.reduction import balance_frame

    return balance_frame(robot, robot.posture(robot.balance.posture).configuration).rotation_in_base
