"""What the scripts in `analysis/` share: a run from a folder, or run now; one folder for the pictures; plain errors."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray

    from m4_dynamics.robot.robot import Robot

__all__ = ["draw_from_run"]


def draw_from_run(
    description: str | None, draw: Callable[[xarray.Dataset, Robot, Path], None], *, mission: str
) -> None:
    """Run a script that draws something from a run: read its options, get the run, draw.

    Args:
        description: What the script shows; its first line becomes the help.
        draw: Takes the trajectory, the robot and the folder of the pictures, and writes them.
        mission: The mission that is run when no run is given.
    """
    from m4_dynamics.cli.results import make_folder
    from m4_dynamics.errors import M4Error
    from m4_dynamics.mission.loading import load_mission
    from m4_dynamics.mission.runner import run_mission
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.simulation.trajectory import load_trajectory

    parser = argparse.ArgumentParser(description=(description or "").strip().splitlines()[0])
    parser.add_argument("run", type=Path, nargs="?", help="folder of a run (default: runs the mission now)")
    parser.add_argument("--mission", default=mission, help=f"mission to run without a run (default: {mission})")
    parser.add_argument("--robot", type=Path, help="the robot's TOML or URDF (default: M4)")
    parser.add_argument("--out", type=Path, default=Path("runs/analysis"), help="folder of the pictures")
    options = parser.parse_args()
    try:
        robot = load_robot(options.robot)
        if options.run is not None:
            dataset = load_trajectory(options.run)
        else:
            result = run_mission(robot, load_mission(options.mission))
            print(f"mission {options.mission}: {result.summary.verdict}, {result.summary.reason}")
            dataset = result.dataset
        make_folder(options.out)
        draw(dataset, robot, options.out)
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
