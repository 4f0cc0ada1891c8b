"""`m4 map replay`: simulate one cell of a closed-loop map again, with its plots and its 3D replay."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from m4_dynamics.robot.robot import Robot
    from m4_dynamics.simulation.climb import ClimbResult

__all__ = ["SimulatedCell", "add_arguments", "run", "simulate_cell"]


@dataclass(frozen=True, slots=True)
class SimulatedCell:
    """A cell of a map, simulated again.

    Attributes:
        robot: The robot.
        result: What came of it.
        place: Which cell it is, in words.
        folder_name: A name for its results.
    """

    robot: Robot
    result: ClimbResult
    place: str
    folder_name: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("map", type=Path, metavar="MAP", help="folder of a closed-loop map")
    parser.add_argument("--slope", type=float, required=True, metavar="DEG", help="the cell nearest to this slope")
    parser.add_argument("--thrust", type=float, required=True, metavar="N", help="the cell nearest to this thrust")
    parser.add_argument("--friction", type=float, metavar="MU", help="nearest to this friction (default: the first)")
    parser.add_argument("--start", type=int, default=0, metavar="N", help="number of the start (default: 0)")
    parser.add_argument("--robot", metavar="ROBOT", help="the map's robot, if it is not the bundled M4")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the run (default: one inside the map's)")


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
    from m4_dynamics.cli.map_options import STORE, command_line
    from m4_dynamics.feasibility.closed_loop import job_of_store
    from m4_dynamics.feasibility.rollout import nearest_cell, replay_cell
    from m4_dynamics.feasibility.store import open_store
    from m4_dynamics.robot.loading import load_robot

    loaded = load_robot(robot)
    job = job_of_store(open_store(folder / STORE), loaded)
    index = nearest_cell(job, slope=math.radians(slope_deg), thrust=thrust, friction=friction, start=start)
    axes = job.grid.axes
    there = math.degrees(float(axes["slope"][index.slope])), float(axes["thrust"][index.thrust])
    ground = float(axes["friction"][index.friction])
    return SimulatedCell(
        robot=loaded,
        result=replay_cell(job, index, attributes={"command": command_line()}),
        place=f"cell at {there[0]:g} deg, {there[1]:g} N, friction {ground:g}, start {index.start}",
        folder_name=f"cell-{there[0]:g}-{there[1]:g}-{ground:g}-{index.start}",
    )


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
    from m4_dynamics.cli.map_options import command_line
    from m4_dynamics.cli.results import make_folder, write_run
    from m4_dynamics.view.climb_tables import climb_table
    from m4_dynamics.view.report import climb_figures
    from m4_dynamics.view.tables import make_console, print_note, print_tables

    cell = simulate_cell(
        args.map, slope_deg=args.slope, thrust=args.thrust, friction=args.friction, start=args.start, robot=args.robot
    )
    summary = cell.result.summary
    folder = args.out if args.out is not None else args.map / cell.folder_name
    make_folder(folder)
    written = write_run(
        cell.result.dataset,
        summary.as_dict(),
        cell.robot,
        folder,
        with_viewer=True,
        table=climb_figures(summary),
        command=command_line(),
    )
    console = make_console()
    print_tables(console, [climb_table(summary)])
    print_note(console, cell.place)
    print_note(console, f"{summary.verdict}: {summary.reason}")
    print_note(console, "written: " + ", ".join(str(path) for path in written))
    return EXIT_OK
