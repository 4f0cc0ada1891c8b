"""`m4 view`: look at a run, at postures or at a cell of a map, in the browser or as one file."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray

    from m4_dynamics.robot.robot import Robot

__all__ = ["add_arguments", "run"]

_OF_MAPS = ("slope", "thrust", "friction", "start")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument(
        "subject", nargs="?", type=Path, metavar="RUN|MAP",
        help="a run's folder or its trajectory.nc; or, with --slope and --thrust, the folder of a closed-loop map",
    )  # fmt: skip
    parser.add_argument("--robot", metavar="ROBOT", help="TOML description or URDF; without one, the bundled M4")
    parser.add_argument("--posture", metavar="NAME", help="show the robot in this posture")
    parser.add_argument("--all-postures", action="store_true", help="show all postures of the robot side by side")
    parser.add_argument("--slope", type=float, metavar="DEG", help="of a map: the cell nearest to this slope")
    parser.add_argument("--thrust", type=float, metavar="N", help="of a map: the cell nearest to this thrust")
    parser.add_argument("--friction", type=float, metavar="MU", help="of a map: nearest to this (default: the first)")
    parser.add_argument("--start", type=int, metavar="N", help="of a map: number of the start (default: 0)")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write one page that works offline, and end")
    parser.add_argument("--host", default="127.0.0.1", metavar="ADDRESS", help="listen here (default: 127.0.0.1)")
    parser.add_argument("--port", type=int, default=0, metavar="N", help="listen on this port (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="print the address and open no browser")


def run(args: argparse.Namespace) -> int:
    """Make the page; write it, or serve it until an interrupt.

    Args:
        args: The parsed options.

    Returns:
        0: written, or looked at.

    Raises:
        M4Error: There is nothing to show, or no place to show it.
    """
    from m4_dynamics.cli.main import EXIT_OK
    from m4_dynamics.output import replacing
    from m4_dynamics.view.serving import PageServer, can_open_browser, open_browser

    _check(args)
    if args.html is not None:
        _require_folder(args.html)
    page = _page(args)
    if args.html is not None:
        with replacing(args.html) as partial:
            partial.write_text(page, encoding="utf-8")
        print(f"written: {args.html}")
        return EXIT_OK
    server = PageServer(page, host=args.host, port=args.port)
    try:
        print(f"{server.url} (Ctrl-C ends it)", flush=True)
        if not args.no_browser and can_open_browser():
            open_browser(server.url)
        server.run()
    except KeyboardInterrupt:
        print(file=sys.stderr)
    return EXIT_OK


def _check(args: argparse.Namespace) -> None:
    """Refuse options that contradict each other before anything is loaded."""
    from m4_dynamics.errors import M4Error

    if args.posture is not None and args.all_postures:
        raise M4Error("--posture and --all-postures exclude each other; give one of them")
    of_map = [f"--{name}" for name in _OF_MAPS if getattr(args, name) is not None]
    if args.subject is None:
        if of_map:
            raise M4Error(f"{of_map[0]} chooses a cell of a map; give the folder of a closed-loop map with it")
        if args.robot is None and args.posture is None and not args.all_postures:
            raise M4Error(
                "there is nothing to view; give a run's folder, or --posture NAME, --all-postures or --robot ROBOT"
            )
        return
    if args.posture is not None or args.all_postures:
        raise M4Error(f"{args.subject} is a run and has its own postures; leave --posture and --all-postures out")
    if of_map and (args.slope is None or args.thrust is None):
        raise M4Error(f"a cell of a map takes both --slope and --thrust, got {', '.join(of_map)} alone")


def _require_folder(path: Path) -> None:
    """Fail before the work if the page has no place to go."""
    from m4_dynamics.errors import ResultFileError

    if not path.parent.is_dir():
        raise ResultFileError(f"cannot write {path}: the folder {path.parent} does not exist")


def _page(args: argparse.Namespace) -> str:
    """The page asked for."""
    from m4_dynamics.errors import ResultFileError
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.view.gallery import ZERO_POSTURE, posture_html
    from m4_dynamics.view.replay import replay_html

    robot = load_robot(args.robot)
    if args.subject is None:
        if args.posture is not None:
            return posture_html(robot, [args.posture])
        return posture_html(robot, list(robot.postures) or [ZERO_POSTURE])
    dataset = _simulated_cell(args) if args.slope is not None else _recorded_run(args.subject)
    name = dataset.attrs.get("robot", robot.name)
    if name != robot.name:
        raise ResultFileError(f"{args.subject} was made with robot '{name}'; give its description with --robot")
    _compare_files(dataset, robot)
    return replay_html(dataset, robot)


def _recorded_run(path: Path) -> xarray.Dataset:
    from m4_dynamics.cli.map_options import STORE
    from m4_dynamics.errors import ResultFileError
    from m4_dynamics.simulation.trajectory import load_trajectory

    if (path / STORE).exists():
        raise ResultFileError(f"{path} holds a map; choose one of its cells with --slope DEG --thrust N")
    return load_trajectory(path)


def _simulated_cell(args: argparse.Namespace) -> xarray.Dataset:
    """The cell of a map, simulated again."""
    from m4_dynamics.cli.map_replay import simulate_cell
    from m4_dynamics.errors import ResultFileError

    cell = simulate_cell(
        args.subject, slope_deg=args.slope, thrust=args.thrust, friction=args.friction, start=args.start or 0,
        robot=args.robot,
    )  # fmt: skip
    print(f"{cell.place}; {cell.result.summary.verdict}: {cell.result.summary.reason}", flush=True)
    if cell.result.dataset is None:
        raise ResultFileError(f"nothing was simulated at {cell.place}: {cell.result.summary.reason}")
    return cell.result.dataset


def _compare_files(dataset: xarray.Dataset, robot: Robot) -> None:
    """Say so if the robot's files have changed since the run."""
    changed = [
        robot.files[kind].name
        for kind, digest in robot.file_hashes.items()
        if dataset.attrs.get(f"sha256_{kind}", digest) != digest
    ]
    if changed:
        print(f"note: {', '.join(changed)} changed since the run; its bodies may look different", file=sys.stderr)
