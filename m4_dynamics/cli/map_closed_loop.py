"""`m4 map closed-loop`: rollouts of the controller over slope, thrust and friction, on all processors."""

from __future__ import annotations

import argparse
import json

__all__ = ["add_arguments", "run"]

EXIT_OK = 0
STORE = "map.zarr"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    from m4_dynamics.cli.map_options import add_axis_options, add_result_options

    add_axis_options(parser, slope="0:80:21", thrust_count=21)
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
    parser.add_argument("--speed", type=float, default=0.2, metavar="M/S", help="climbing speed (default: 0.2)")
    parser.add_argument("--duration", type=float, default=4.0, metavar="S", help="of a rollout (default: 4)")
    parser.add_argument("--starts", type=int, default=1, metavar="N", help="rollouts in each cell (default: 1)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the starts' errors (default: 0)")
    parser.add_argument(
        "--pitch-error", type=float, default=5.0, metavar="DEG", help="initial pitch errors up to this (default: 5)"
    )
    parser.add_argument(
        "--yaw-error", type=float, default=0.5, metavar="DEG", help="initial headings up to this (default: 0.5)"
    )
    parser.add_argument(
        "--adaptive", action="store_true", help="run cells near the boundary only; for maps of 50 x 50 cells and more"
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=int, metavar="N", help="processes on this machine (default: one for each processor; 0: none)"
    )
    where.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler, tcp://host:port, with its workers")
    parser.add_argument("--resume", action="store_true", help="go on with the map that is in the folder")
    add_result_options(parser, folder="runs/map-closed-loop")


def run(args: argparse.Namespace) -> int:
    """Run the rollouts that are missing, write map and picture, print what they say.

    Args:
        args: The parsed options.

    Returns:
        0.

    Raises:
        M4Error: An option is not valid, a file cannot be written, or the scheduler cannot be reached.
    """
    import math

    import numpy as np

    from m4_dynamics.cli.map_options import claim_folder, command_line, parse_axis
    from m4_dynamics.errors import InvalidSettingError
    from m4_dynamics.feasibility.cell import RolloutSettings
    from m4_dynamics.feasibility.closed_loop import closed_loop_dataset, make_job
    from m4_dynamics.feasibility.files import save_map
    from m4_dynamics.feasibility.grid import MapGrid
    from m4_dynamics.feasibility.run import run_job
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.view.closed_loop_plots import plot_closed_loop
    from m4_dynamics.view.closed_loop_tables import closed_loop_tables, describe_closed_loop
    from m4_dynamics.view.map_page import write_map_page
    from m4_dynamics.view.progress import progress_bar
    from m4_dynamics.view.tables import make_console, print_note, print_tables

    if args.resume and args.force:
        raise InvalidSettingError("--resume --force", "both", "one of them: go on with the map, or replace it")
    robot = load_robot(args.robot)
    balance = robot.require_balance()
    thrust_max = sum(one.maximum_thrust for one in robot.thrusters if one.frame in balance.thrusters)
    every = np.unique(np.linspace(0.0, thrust_max, args.thrust_count))
    grid = MapGrid(
        slope=np.radians(parse_axis("--slope", args.slope)),
        thrust=every if args.thrust is None else parse_axis("--thrust", args.thrust),
        friction=robot.ground.friction_static if args.friction is None else parse_axis("--friction", args.friction),
    )
    settings = RolloutSettings(
        plant=args.plant,
        controller=args.controller,
        speed=args.speed,
        duration=args.duration,
        starts=args.starts,
        seed=args.seed,
        pitch_error_max=math.radians(args.pitch_error),
        yaw_error_max=math.radians(args.yaw_error),
        adaptive=args.adaptive,
    )
    claim_folder(args.out, force=args.force or args.resume, names=("map.nc", "map.png", "map.html"))
    job = make_job(robot, grid, settings)
    with progress_bar("rolling out", grid.cells * settings.starts, unit="rollouts") as advance:
        store = run_job(
            job,
            args.out / STORE,
            resume=args.resume,
            force=args.force,
            workers=args.workers,
            scheduler=args.scheduler,
            on_progress=advance,
        )
    dataset = closed_loop_dataset(store, job, command=command_line())
    written = [
        save_map(dataset, args.out / "map.nc"),
        plot_closed_loop(dataset, args.out / "map.png"),
        write_map_page(dataset, args.out / "map.html"),
    ]
    if args.json:
        print(json.dumps(describe_closed_loop(dataset), indent=2, allow_nan=False))
    else:
        console = make_console()
        print_tables(console, closed_loop_tables(dataset))
        print_note(console, "written: " + ", ".join(str(path) for path in (args.out / STORE, *written)))
    return EXIT_OK
