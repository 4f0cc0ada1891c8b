"""Options that all kinds of maps share: axes, robot, results."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["add_axis_options", "add_result_options", "claim_folder", "command_line", "parse_axis"]

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
