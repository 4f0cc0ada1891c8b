"""`m4 map replay`: simulate one cell of a closed-loop map again, with its plots and its 3D replay."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("map", type=Path, metavar="MAP", help="folder of a closed-loop map")
    parser.add_argument("--slope", type=float, required=True, metavar="DEG", help="the cell nearest to this slope")
    parser.add_argument("--thrust", type=float, required=True, metavar="N", help="the cell nearest to this thrust")
    parser.add_argument("--friction", type=float, metavar="MU", help="nearest to this friction (default: the first)")
    parser.add_argument("--start", type=int, default=0, metavar="N", help="number of the start (default: 0)")
    parser.add_argument("--robot", metavar="ROBOT", help="the map's robot, if it is not the bundled M4")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the run (default: one inside the map's)")


def run(args: argparse.Namespace) -> int:
    """Simulate the cell from the start that it had, and write the run's files.

    Args:
        args: The parsed options.

    Returns:
        0: simulated, whatever came of it.

    Raises:
        M4Error: There is no such map or cell, the robot is another one, or the cell has no equilibrium to start from.
    """
    from m4_dynamics.cli.main import EXIT_OK
    from m4_dynamics.cli.map_options import STORE, command_line
    from m4_dynamics.cli.results import make_folder, write_run
    from m4_dynamics.feasibility.closed_loop import job_of_store
    from m4_dynamics.feasibility.rollout import nearest_cell, replay_cell
    from m4_dynamics.feasibility.store import open_store
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.view.climb_tables import climb_table
    from m4_dynamics.view.tables import make_console, print_note, print_tables

    robot = load_robot(args.robot)
    job = job_of_store(open_store(args.map / STORE), robot)
    index = nearest_cell(
        job, slope=math.radians(args.slope), thrust=args.thrust, friction=args.friction, start=args.start
    )
    axes = job.grid.axes
    slope, thrust = math.degrees(float(axes["slope"][index.slope])), float(axes["thrust"][index.thrust])
    friction = float(axes["friction"][index.friction])
    place = f"cell-{slope:g}-{thrust:g}-{friction:g}-{index.start}"
    folder = args.out if args.out is not None else args.map / place
    result = replay_cell(job, index, attributes={"command": command_line()})
    make_folder(folder)
    written = write_run(result.dataset, result.summary.as_dict(), robot, folder, with_viewer=True)
    console = make_console()
    print_tables(console, [climb_table(result.summary)])
    print_note(console, f"cell at {slope:g} deg, {thrust:g} N, friction {friction:g}, start {index.start}")
    print_note(console, f"{result.summary.verdict}: {result.summary.reason}")
    print_note(console, "written: " + ", ".join(str(path) for path in written))
    return EXIT_OK
