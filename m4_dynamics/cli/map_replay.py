"""`m4 map replay`: simulate one cell of a closed-loop map again, with its plots and its 3D replay."""

from __future__ import annotations

import argparse
import math
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray

    from m4_dynamics.feasibility.cell import CellIndex
    from m4_dynamics.feasibility.rollout import RolloutJob
    from m4_dynamics.robot.robot import Robot
    from m4_dynamics.simulation.climb import ClimbResult

__all__ = [
    "SimulatedCell",
    "add_arguments",
    "find_cell",
    "run",
    "simulate_cell",
    "write_cell",
    "write_cell_page",
]

PAGE = "map.html"


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


def find_cell(
    folder: Path, *, slope_deg: float, thrust: float, friction: float | None, start: int, robot: str | None
) -> tuple[RolloutJob, CellIndex]:
    """Find a cell of a map.

    Args:
        folder: Folder of the closed-loop map.
        slope_deg: The cell nearest to this slope [deg].
        thrust: Nearest to this thrust [N].
        friction: Nearest to this friction; None takes the first.
        start: Number of the start.
        robot: The map's robot, if it is not the bundled M4.

    Returns:
        What the map is made of, and which cell it is.

    Raises:
        M4Error: There is no such map or cell, or the robot is another one.
    """
    from m4_dynamics.cli.map_options import STORE
    from m4_dynamics.feasibility.closed_loop import job_of_store
    from m4_dynamics.feasibility.rollout import nearest_cell
    from m4_dynamics.feasibility.store import open_store
    from m4_dynamics.robot.loading import load_robot

    job = job_of_store(open_store(folder / STORE), load_robot(robot))
    return job, nearest_cell(job, slope=math.radians(slope_deg), thrust=thrust, friction=friction, start=start)


def simulate_cell(job: RolloutJob, index: CellIndex) -> SimulatedCell:
    """Simulate a cell from the start that it had.

    Args:
        job: What the map is made of.
        index: The cell.

    Returns:
        The cell.

    Raises:
        M4Error: The cell has no equilibrium to start from.
    """
    from m4_dynamics.cli.map_options import command_line
    from m4_dynamics.feasibility.rollout import replay_cell
    from m4_dynamics.view.cell_reports import cell_folder

    axes = job.grid.axes
    slope, thrust = float(axes["slope"][index.slope]), float(axes["thrust"][index.thrust])
    friction = float(axes["friction"][index.friction])
    return SimulatedCell(
        robot=job.robot,
        result=replay_cell(job, index, attributes={"command": command_line()}),
        place=f"cell at {math.degrees(slope):g} deg, {thrust:g} N, friction {friction:g}, start {index.start}",
        folder_name=cell_folder(slope, thrust, friction, index.start),
    )


def write_cell(cell: SimulatedCell, folder: Path) -> list[Path]:
    """Write the files of a cell's run, its report among them.

    Args:
        cell: The cell.
        folder: Where to.

    Returns:
        The files.

    Raises:
        ResultFileError: One cannot be written.
    """
    from m4_dynamics.cli.map_options import command_line
    from m4_dynamics.cli.results import make_folder, write_run
    from m4_dynamics.view.report import climb_figures

    make_folder(folder)
    summary = cell.result.summary
    return write_run(
        cell.result.dataset,
        summary.as_dict(),
        cell.robot,
        folder,
        with_viewer=True,
        table=climb_figures(summary),
        command=command_line(),
    )


def write_cell_page(dataset: xarray.Dataset, folder: Path, *, robot: str | None) -> Path:
    """Write the page of a closed-loop map, with links to the reports that lie in the map's folder.

    Args:
        dataset: The map.
        folder: Its folder.
        robot: The map's robot, if it is not the bundled M4.

    Returns:
        The page's file.

    Raises:
        ResultFileError: It cannot be written.
    """
    from m4_dynamics.view.cell_reports import reports_beside
    from m4_dynamics.view.map_page import write_map_page

    arguments = shlex.join([str(folder), *(() if robot is None else ("--robot", robot))])
    reports = reports_beside(dataset, folder)
    return write_map_page(dataset, folder / PAGE, replay_arguments=arguments, reports=reports)


def run(args: argparse.Namespace) -> int:
    """Simulate the cell from the start that it had, and write the run's files; the map's page links to them.

    Args:
        args: The parsed options.

    Returns:
        0: simulated, whatever came of it.

    Raises:
        M4Error: There is no such map or cell, the robot is another one, or the cell has no equilibrium to start from.
    """
    from m4_dynamics.cli.main import EXIT_OK
    from m4_dynamics.feasibility.files import MAP_FILE, load_map
    from m4_dynamics.view.climb_tables import climb_table
    from m4_dynamics.view.tables import make_console, print_note, print_tables

    job, index = find_cell(
        args.map, slope_deg=args.slope, thrust=args.thrust, friction=args.friction, start=args.start, robot=args.robot
    )
    cell = simulate_cell(job, index)
    written = write_cell(cell, args.out if args.out is not None else args.map / cell.folder_name)
    # A map that is not done yet has no page; a run elsewhere is not among its reports.
    if args.out is None and (args.map / MAP_FILE).is_file() and (args.map / PAGE).is_file():
        written.append(write_cell_page(load_map(args.map), args.map, robot=args.robot))
    console = make_console()
    summary = cell.result.summary
    print_tables(console, [climb_table(summary)])
    print_note(console, cell.place)
    print_note(console, f"{summary.verdict}: {summary.reason}")
    print_note(console, "written: " + ", ".join(str(path) for path in written))
    return EXIT_OK
