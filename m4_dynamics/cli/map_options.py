"""Options that all kinds of maps share: axes, robot, results."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from m4_dynamics.feasibility.job import SweepJob
    from m4_dynamics.feasibility.store import SweepStore

__all__ = [
    "MAP_FILES",
    "STORE",
    "add_axis_options",
    "add_result_options",
    "add_sweep_options",
    "claim_folder",
    "command_line",
    "parse_axis",
    "run_sweep_job",
]

#: Folder of a sweep's records inside the folder of its results, and the files beside it.
STORE = "map.zarr"
MAP_FILES = ("map.nc", "map.png", "map.html")

_VALUES_MAX = 20_000


def add_axis_options(
    parser: argparse.ArgumentParser, *, slope: str, thrust_count: int, friction: str | None = None
) -> None:
    """Declare the robot and the axes.

    Args:
        parser: The parser.
        slope: Default of the slopes.
        thrust_count: Default number of thrusts, from nothing to all that the robot has.
        friction: Default of the friction coefficients; None takes the robot's ground.
    """
    parser.add_argument("robot", nargs="?", metavar="ROBOT", help="a TOML description; without one, the bundled M4")
    values = "each axis: START:STOP:COUNT, or numbers with commas"
    parser.add_argument("--slope", default=slope, metavar="DEG", help=f"inclination, {values} (default: {slope})")
    parser.add_argument(
        "--thrust", metavar="N", help=f"total thrust (default: {thrust_count} values up to the robot's maximum)"
    )
    shown = "the robot's ground" if friction is None else friction
    parser.add_argument(
        "--friction", default=friction, metavar="MU", help=f"static friction coefficient (default: {shown})"
    )
    parser.set_defaults(thrust_count=thrust_count)


def add_result_options(parser: argparse.ArgumentParser, *, folder: str) -> None:
    """Declare where results go.

    Args:
        parser: The parser.
        folder: Default folder.
    """
    parser.add_argument("--out", type=Path, default=Path(folder), metavar="DIR", help=f"folder (default: {folder})")
    parser.add_argument("--force", action="store_true", help="replace a map that is already in the folder")
    parser.add_argument("--json", action="store_true", help="print a summary as JSON instead of a table")


def add_sweep_options(parser: argparse.ArgumentParser, *, duration: float, starts: str, adaptive: str) -> None:
    """Declare what all sweeps of rollouts share: plant, controller, starts, where they run.

    Args:
        parser: The parser.
        duration: Default duration of a rollout [s].
        starts: In what the starts of one cell differ.
        adaptive: For which maps running the boundary alone is worth it.
    """
    parser.add_argument(
        "--plant",
        default="full",
        choices=("full", "mip"),
        help="full: the full model, with the reduced one beside it; mip: the reduced model alone (default: full)",
    )
    parser.add_argument(
        "--controller",
        default="default",
        choices=("default", "paper", "paper-zero", "lqr", "pid"),
        help="as for m4 wair (default: default)",
    )
    parser.add_argument(
        "--duration", type=float, default=duration, metavar="S", help=f"of a rollout (default: {duration:g})"
    )
    parser.add_argument(
        "--starts",
        type=int,
        default=1,
        metavar="N",
        help=f"rollouts in each cell, which differ in {starts} (default: 1)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help=f"of {starts} (default: 0)")
    parser.add_argument(
        "--yaw-error", type=float, default=0.5, metavar="DEG", help="initial headings up to this (default: 0.5)"
    )
    parser.add_argument("--adaptive", action="store_true", help=f"run cells near the boundary only; for {adaptive}")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=int, metavar="N", help="processes on this machine (default: one for each processor; 0: none)"
    )
    where.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler, tcp://host:port, with its workers")
    parser.add_argument("--resume", action="store_true", help="go on with the map that is in the folder")


def run_sweep_job(args: argparse.Namespace, job: SweepJob) -> SweepStore:
    """Run what a map lacks, with a progress bar, as the options say.

    Args:
        args: Options of `add_sweep_options` and `add_result_options`.
        job: What to run.

    Returns:
        The store in the folder of the results.

    Raises:
        M4Error: Options contradict each other, there is a map already, or the run fails.
    """
    from m4_dynamics.errors import InvalidSettingError
    from m4_dynamics.feasibility.run import run_job
    from m4_dynamics.view.progress import progress_bar

    if args.resume and args.force:
        raise InvalidSettingError("--resume --force", "both", "one of them: go on with the map, or replace it")
    claim_folder(args.out, force=args.force or args.resume, names=MAP_FILES)
    total = math.prod(len(axis.values) for axis in job.store_axes.values())
    with progress_bar("rolling out", total, unit="rollouts") as advance:
        return run_job(
            job,
            args.out / STORE,
            resume=args.resume,
            force=args.force,
            workers=args.workers,
            scheduler=args.scheduler,
            on_progress=advance,
        )


def parse_axis(option: str, text: str) -> NDArray[np.float64]:
    """Read an axis.

    Args:
        option: The option's name, for messages.
        text: "0:80:161" (first, last, how many), "0.3,0.5,0.8" or "45".

    Returns:
        The values.

    Raises:
        InvalidSettingError: It is none of these.
    """
    import numpy as np

    from m4_dynamics.errors import InvalidSettingError

    valid = "START:STOP:COUNT (such as 0:80:161), or numbers with commas"
    try:
        if ":" in text:
            start, stop, count = text.split(":")
            number = int(count)
            if not 1 <= number <= _VALUES_MAX:
                raise InvalidSettingError(option, text, f"{valid}, with a count from 1 to {_VALUES_MAX}")
            values = np.linspace(float(start), float(stop), number)
        else:
            values = np.array([float(word) for word in text.split(",")])
    except ValueError:
        raise InvalidSettingError(option, text, valid) from None
    if not np.isfinite(values).all():
        raise InvalidSettingError(option, text, valid)
    if (np.diff(values) <= 0.0).any():
        raise InvalidSettingError(option, text, f"{valid}, increasing")
    return values


def claim_folder(folder: Path, *, force: bool, names: Sequence[str]) -> None:
    """Make the results' folder, and refuse to overwrite a map without being told to.

    Args:
        folder: The folder.
        force: Whether maps in it may be replaced.
        names: Files and folders that would be overwritten.

    Raises:
        ResultFileError: It cannot be made, or it holds a map already.
    """
    from m4_dynamics.cli.results import make_folder
    from m4_dynamics.errors import ResultFileError

    make_folder(folder)
    for name in names:
        if (folder / name).exists() and not force:
            raise ResultFileError(f"{folder / name} exists already; name another folder with --out, or use --force")


def command_line() -> str:
    """The command that is running, for the record."""
    return shlex.join(["m4", *sys.argv[1:]])
