"""The files that a run leaves behind, for every command that runs something."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray

    from m4_dynamics.robot.robot import Robot
    from m4_dynamics.view.report import FigureTable

__all__ = ["make_folder", "write_run"]


def make_folder(folder: Path) -> None:
    """Make the results' folder before the work, so that a bad name fails at once.

    Args:
        folder: The folder.

    Raises:
        ResultFileError: It cannot be made.
    """
    from m4_dynamics.errors import ResultFileError

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultFileError(f"cannot make the folder {folder}: {error.strerror or error}") from error


def write_run(
    dataset: xarray.Dataset | None,
    summary: Mapping[str, Any],
    robot: Robot,
    folder: Path,
    *,
    with_viewer: bool,
    table: FigureTable,
    command: str,
) -> list[Path]:
    """Write trajectory, plots, replay, report and summary.

    Args:
        dataset: The trajectory; None when nothing was simulated.
        summary: Plain values.
        robot: The robot.
        folder: Where to; it exists.
        with_viewer: Whether to write viewer.html, and to embed it in the report.
        table: The figures, for the report.
        command: The command line that made the run, for the report.

    Returns:
        The files written.

    Raises:
        ResultFileError: A file cannot be written.
    """
    from m4_dynamics.simulation.trajectory import save_trajectory
    from m4_dynamics.view.plots import plot_ground_forces, plot_states
    from m4_dynamics.view.replay import replay_html
    from m4_dynamics.view.report import report_html

    written = []
    replay = None
    if dataset is not None:
        written.append(save_trajectory(dataset, folder / "trajectory.nc"))
        written.append(plot_states(dataset, folder / "states.png"))
        written.append(plot_ground_forces(dataset, folder / "ground_forces.png"))
        if with_viewer:
            replay = replay_html(dataset, robot)
            written.append(_write_text(folder / "viewer.html", replay))
    report = report_html(dataset, summary, robot, table=table, command=command, replay=replay)
    written.append(_write_text(folder / "report.html", report))
    text = json.dumps(summary, indent=2, allow_nan=False) + "\n"
    written.append(_write_text(folder / "summary.json", text))
    return written


def _write_text(path: Path, text: str) -> Path:
    from m4_dynamics.output import replacing

    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")
    return path
