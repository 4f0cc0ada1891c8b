"""`m4 map replay`: simulate one cell of a closed-loop map again, with its report, its plots and its 3D replay."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from m4_dynamics.cli.map_cells import SimulatedCell

__all__ = ["add_arguments", "run", "simulate_cell"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("map", type=Path, metavar="MAP", help="folder of a closed-loop map")
    parser.add_argument("--slope", type=float, required=True, metavar="DEG", help="the cell nearest to this slope")
    parser.add_argument("--thrust", type=float, required=True, metavar="N", help="the cell nearest to this thrust")
    parser.add_argument("--friction", type=float, metavar="MU", help="nearest to this friction (default: the first)")
    parser.add_argument("--start", type=int, default=0, metavar="N", help="number of the start (default: 0)")
    parser.add_argument("--robot", metavar="ROBOT", help="the map's robot, if it is not the bundled M4")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the run (default: one in the map's folder)")


def simulate_cell(
    folder: Path, *, slope_deg: float, thrust: float, friction: float | None, start: int, robot: str | None
) -> SimulatedCell:
    """Simulate a cell from the start that it had.

    Args:
        folder: Folder of the closed-loop map.
        slope_deg: The cell nearest to this slope [deg].
        thrust: Nearest to this thrust [N].
        friction: Nearest to this friction; None takes the first.
        start: Number of the start.
        robot: The map's robot, if it is not the bundled M4.

    Returns:
        The cell.

    Raises:
        M4Error: There is no such map or cell, the robot is another one, or the cell has no equilibrium to start from.
    """
    from m4_dynamics.cli.map_cells import simulate
    from m4_dynamics.cli.map_options import STORE, command_line
    from m4_dynamics.feasibility.closed_loop import job_of_store
    from m4_dynamics.feasibility.rollout import nearest_cell
    from m4_dynamics.feasibility.store import open_store
    from m4_dynamics.robot.loading import load_robot

    loaded = load_robot(robot)
    store = open_store(folder / STORE)
    job = job_of_store(store, loaded)
    index = nearest_cell(job, slope=math.radians(slope_deg), thrust=thrust, friction=friction, start=start)
    return simulate(job, index, robot=loaded, fingerprint=store.fingerprint, command=command_line())


def run(args: argparse.Namespace) -> int:
    """Simulate the cell from the start that it had, write the run's files, and link them from the map's page.

    Args:
        args: The parsed options.

    Returns:
        0: simulated, whatever came of it.

    Raises:
        M4Error: There is no such map or cell, the robot is another one, or the cell has no equilibrium to start from.
    """
    from m4_dynamics.cli.main import EXIT_OK
    from m4_dynamics.cli.map_cells import refresh_page, write_cell
    from m4_dynamics.view.climb_tables import climb_table
    from m4_dynamics.view.tables import make_console, print_note, print_tables

    cell = simulate_cell(
        args.map, slope_deg=args.slope, thrust=args.thrust, friction=args.friction, start=args.start, robot=args.robot
    )
    summary = cell.result.summary
    folder = args.out if args.out is not None else args.map / cell.folder_name
    written = write_cell(cell, folder)
    console = make_console()
    print_tables(console, [climb_table(summary)])
    print_note(console, cell.place)
    print_note(console, f"{summary.verdict}: {summary.reason}")
    print_note(console, "written: " + ", ".join(str(path) for path in written))
    page = refresh_page(args.map, folder, robot=args.robot)
    if page is not None:
        print_note(console, f"linked from: {page}")
    return EXIT_OK
