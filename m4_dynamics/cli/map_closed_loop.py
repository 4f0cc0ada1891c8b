"""`m4 map closed-loop`: rollouts of the controller over slope, thrust and friction, on all processors."""

from __future__ import annotations

import argparse
import json

__all__ = ["add_arguments", "run"]

EXIT_OK = 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    from m4_dynamics.cli.map_options import add_axis_options, add_result_options, add_sweep_options

    add_axis_options(parser, slope="0:80:21", thrust_count=21)
    parser.add_argument("--speed", type=float, default=0.2, metavar="M/S", help="climbing speed (default: 0.2)")
    parser.add_argument(
        "--pitch-error", type=float, default=5.0, metavar="DEG", help="initial pitch errors up to this (default: 5)"
    )
    add_sweep_options(parser, duration=4.0, starts="pitch and heading", adaptive="maps of 33 x 33 cells and more")
    add_result_options(parser, folder="runs/map-closed-loop")
    parser.add_argument(
        "--reports",
        action="store_true",
        help="also write the report of every cell in which statics and rollouts disagree; the page links to it",
    )


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

    from m4_dynamics.cli.map_cells import write_page, write_reports_of_disagreements
    from m4_dynamics.cli.map_options import command_line, parse_axis, run_sweep_job
    from m4_dynamics.feasibility.cell import RolloutSettings
    from m4_dynamics.feasibility.closed_loop import closed_loop_dataset, make_job
    from m4_dynamics.feasibility.files import save_map
    from m4_dynamics.feasibility.grid import MapGrid
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.view.closed_loop_plots import plot_closed_loop
    from m4_dynamics.view.closed_loop_tables import closed_loop_tables, describe_closed_loop
    from m4_dynamics.view.tables import make_console, print_note, print_tables

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
    job = make_job(robot, grid, settings)
    store = run_sweep_job(args, job)
    dataset = closed_loop_dataset(store, job, command=command_line())
    written = [
        save_map(dataset, args.out / "map.nc"),
        plot_closed_loop(dataset, args.out / "map.png"),
        write_page(dataset, args.out, robot=args.robot),
    ]
    reports = None
    if args.reports:
        reports = write_reports_of_disagreements(dataset, job, args.out, robot=robot, option=args.robot)
    if args.json:
        print(json.dumps(describe_closed_loop(dataset), indent=2, allow_nan=False))
    else:
        console = make_console()
        print_tables(console, closed_loop_tables(dataset))
        print_note(console, "written: " + ", ".join(str(path) for path in (store.path, *written)))
        if reports is not None:
            print_note(console, f"reports written: {reports}, linked from {args.out / 'map.html'}")
    return EXIT_OK
