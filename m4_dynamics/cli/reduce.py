"""`m4 reduce`: reduce the full model to the planar pendulum and show the residual."""

from __future__ import annotations

import argparse
import json
import math

__all__ = ["add_arguments", "run"]

EXIT_OK = 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument("robot", nargs="?", metavar="ROBOT", help="a TOML description; without one, the bundled M4")
    parser.add_argument("--posture", metavar="NAME", help="posture of the legs (default: the balancing posture)")
    parser.add_argument(
        "--slope",
        type=float,
        default=45.0,
        metavar="DEG",
        help="inclination on which the loads of the legs and the heading are looked at (default: 45)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    """Reduce a robot.

    Args:
        args: The parsed options.

    Returns:
        0.

    Raises:
        RobotDescriptionError: If the robot does not balance on two wheels.
    """
    from m4_dynamics.errors import InvalidSettingError
    from m4_dynamics.reduced.reduction import reduce_robot
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.view.reduction_report import describe_reduction, reduction_tables
    from m4_dynamics.view.tables import make_console, print_note, print_tables

    if not abs(args.slope) < 90.0:
        raise InvalidSettingError("--slope", args.slope, "an angle between -90 and 90 deg")
    robot = load_robot(args.robot)
    description = describe_reduction(robot, reduce_robot(robot, args.posture), math.radians(args.slope))
    if args.json:
        print(json.dumps(description, indent=2, allow_nan=False))
        return EXIT_OK
    console = make_console()
    print_tables(console, reduction_tables(description))
    if "no_trim" in description["on_slope"]:
        print_note(console, f"Legs and heading are not shown: {description['on_slope']['no_trim']}. See --slope.")
    if description["residual"]["out_of_plane"] > 1e-6:
        print_note(
            console,
            "The robot is not symmetric about its sagittal plane: the pendulum leaves a side force and moments to the "
            "contacts.",
        )
    return EXIT_OK
