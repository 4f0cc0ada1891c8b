"""Cells of a closed-loop map simulated again: their reports in the map's folder, and the page that links to them."""

from __future__ import annotations

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
    "refresh_page",
    "simulate",
    "write_cell",
    "write_page",
    "write_reports_of_disagreements",
]

PAGE = "map.html"


@dataclass(frozen=True, slots=True)
class SimulatedCell:
    """A cell of a map, simulated again.

    Attributes:
        robot: The robot.
        result: What came of it.
        index: Which cell it is.
        fingerprint: Of the map's store.
        place: Which cell it is, in words.
        folder_name: A name for its results.
        command: The command line that simulates it.
    """

    robot: Robot
    result: ClimbResult
    index: CellIndex
    fingerprint: str
    place: str
    folder_name: str
    command: str


def simulate(job: RolloutJob, index: CellIndex, *, robot: Robot, fingerprint: str, command: str) -> SimulatedCell:
    """Simulate a cell from the start that it had.

    Args:
        job: The map's job.
        index: The cell and the number of the start.
        robot: The map's robot, with what is seen of it.
        fingerprint: Of the map's store.
        command: The command line that does this, for the record.

    Returns:
        The cell.

    Raises:
        NoTrimExists: The cell has no equilibrium to start from.
        M4Error: It cannot be simulated.
        KeyboardInterrupt: The climb was interrupted.
    """
    from m4_dynamics.feasibility.rollout import replay_cell
    from m4_dynamics.simulation.verdict import Verdict

    slope, thrust, ground = _place(job, index)
    result = replay_cell(job, index, attributes={"command": command})
    if result.summary.verdict == Verdict.ABORTED and "interrupted" in result.summary.reason:
        # A climb keeps what it has when it is interrupted; half a run would pass for the cell's.
        raise KeyboardInterrupt
    return SimulatedCell(
        robot=robot,
        result=result,
        index=index,
        fingerprint=fingerprint,
        place=f"cell at {slope:g} deg, {thrust:g} N, friction {ground:g}, start {index.start}",
        folder_name=f"cell-{slope:g}-{thrust:g}-{ground:g}-{index.start}",
        command=command,
    )


def write_cell(cell: SimulatedCell, folder: Path) -> list[Path]:
    """Write a cell's run with its report.

    Args:
        cell: The cell.
        folder: Where to; it is made if need be.

    Returns:
        The files written.

    Raises:
        ResultFileError: A file cannot be written.
    """
    from m4_dynamics.cli.results import make_folder, write_run
    from m4_dynamics.view.cell_reports import cell_record
    from m4_dynamics.view.report import climb_figures

    make_folder(folder)
    summary = cell.result.summary
    return write_run(
        cell.result.dataset,
        {**summary.as_dict(), **cell_record(cell.fingerprint, cell.index)},
        cell.robot,
        folder,
        with_viewer=True,
        table=climb_figures(summary),
        command=cell.command,
    )


def write_page(dataset: xarray.Dataset, folder: Path, *, robot: str | None) -> Path:
    """Write a closed-loop map's page with links to the reports that are in its folder.

    Args:
        dataset: The map.
        folder: Its folder.
        robot: The map's robot as given on the command line.

    Returns:
        The page.

    Raises:
        ResultFileError: It cannot be written.
    """
    from m4_dynamics.view.cell_reports import find_cell_reports
    from m4_dynamics.view.map_page import write_map_page

    return write_map_page(
        dataset,
        folder / PAGE,
        subject=shlex.join([str(folder), *_robot_option(robot)]),
        reports=find_cell_reports(dataset, folder),
    )


def refresh_page(folder: Path, run: Path, *, robot: str | None) -> Path | None:
    """Write a map's page anew so that it links to a run inside its folder.

    Args:
        folder: The map's folder.
        run: The run's folder.
        robot: The map's robot as given on the command line.

    Returns:
        The page; None if the run lies elsewhere, or if the map is not finished and has no page yet.

    Raises:
        ResultFileError: The map cannot be read, or the page not be written.
    """
    from m4_dynamics.feasibility.files import MAP_FILE, load_map

    inside = run.resolve().parent == folder.resolve()
    if not inside or not (folder / PAGE).is_file() or not (folder / MAP_FILE).is_file():
        return None
    return write_page(load_map(folder), folder, robot=robot)


def write_reports_of_disagreements(
    dataset: xarray.Dataset, job: RolloutJob, folder: Path, *, robot: Robot, option: str | None
) -> int:
    """Write the report of every cell in which statics and rollouts disagree, from the start that ended worst.

    Reports that are there already stay; cells without an equilibrium have nothing to replay. The map's page is
    written anew at the end, or when an interrupt or an error is the end.

    Args:
        dataset: The map.
        job: Its job.
        folder: Its folder.
        robot: The robot.
        option: The robot as given on the command line.

    Returns:
        How many were written.

    Raises:
        M4Error: A cell cannot be simulated, or a file not be written.
    """
    from m4_dynamics.errors import NoTrimExists
    from m4_dynamics.view.cell_reports import find_cell_reports
    from m4_dynamics.view.progress import progress_bar

    there = {report.index for report in find_cell_reports(dataset, folder)}
    wanted = [index for index in _disagreeing(dataset) if index not in there]
    fingerprint, written = str(dataset.attrs["fingerprint"]), 0
    try:
        with progress_bar("writing reports", len(wanted), unit="reports") as advance:
            for done, index in enumerate(wanted):
                if advance is not None:
                    advance(done)
                command = _replay_command(job, index, folder, option)
                try:
                    cell = simulate(job, index, robot=robot, fingerprint=fingerprint, command=command)
                except NoTrimExists:
                    continue
                write_cell(cell, folder / cell.folder_name)
                written += 1
    finally:
        write_page(dataset, folder, robot=option)
    return written


def _disagreeing(dataset: xarray.Dataset) -> list[CellIndex]:
    """The cells in which statics and rollouts disagree, each with the start that ended worst."""
    import numpy as np

    from m4_dynamics.feasibility.cell import CellIndex

    cells = ("friction", "slope", "thrust")
    worst = dataset["verdict"].argmax("start").transpose(*cells).to_numpy()
    apart = dataset["disagreement"].transpose(*cells).to_numpy() > 0
    return [CellIndex(int(m), int(i), int(j), int(worst[m, i, j])) for m, i, j in np.argwhere(apart)]


def _place(job: RolloutJob, index: CellIndex) -> tuple[float, float, float]:
    """Slope [deg], thrust [N] and friction of a cell."""
    axes = job.grid.axes
    slope, thrust = float(axes["slope"][index.slope]), float(axes["thrust"][index.thrust])
    return math.degrees(slope), thrust, float(axes["friction"][index.friction])


def _replay_command(job: RolloutJob, index: CellIndex, folder: Path, robot: str | None) -> str:
    """The command that simulates one cell alone."""
    slope, thrust, ground = _place(job, index)
    words = ["m4", "map", "replay", str(folder), "--slope", f"{slope:.8g}", "--thrust", f"{thrust:.8g}"]
    words += ["--friction", f"{ground:.8g}", "--start", str(index.start), *_robot_option(robot)]
    return shlex.join(words)


def _robot_option(robot: str | None) -> list[str]:
    return [] if robot is None else ["--robot", robot]
