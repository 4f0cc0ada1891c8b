"""`m4 map attraction`: the region of attraction of an equilibrium, by rollouts on all processors."""

from __future__ import annotations

import argparse
import json

__all__ = ["add_arguments", "run"]

EXIT_OK = 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    from m4_dynamics.cli.map_options import add_result_options, add_sweep_options

    parser.add_argument("robot", nargs="?", metavar="ROBOT", help="a TOML description; without one, the bundled M4")
    parser.add_argument("--slope", type=float, default=45.0, metavar="DEG", help="inclination (default: 45)")
    parser.add_argument("--thrust", type=float, metavar="N", help="of the equilibrium (default: inside all limits)")
    parser.add_argument("--friction", type=float, metavar="MU", help="static friction (default: the robot's ground)")
    ranges = "START:STOP:COUNT, or numbers with commas"
    for option, default, unit, meaning in (
        ("--pitch-range", "-50:50:21", "DEG", "initial pitch less the equilibrium's"),
        ("--rate-range", "-250:250:21", "DEG/S", "initial pitch rate"),
        ("--wheel-speed", "0", "M/S", "initial speed of the axle uphill, the wheels rolling"),
    ):
        # A value that starts with a minus sign is taken for an option unless it is written --option=value.
        parser.add_argument(
            option, default=default, metavar=unit, help=f"{meaning}, as {option}={ranges} (default: {default})"
        )
    add_sweep_options(parser, duration=3.0, starts="heading", adaptive="maps of 33 x 33 cells and more")
    add_result_options(parser, folder="runs/map-attraction")


def run(args: argparse.Namespace) -> int:
    """Run the rollouts that are missing, write map and picture, print what they say.

    Args:
        args: The parsed options.

    Returns:
        0.

    Raises:
        M4Error: An option is not valid, no equilibrium exists, a file cannot be written, or the scheduler cannot be
            reached.
    """
    import math

    import numpy as np

    from m4_dynamics.cli.map_options import command_line, parse_axis, run_sweep_job
    from m4_dynamics.feasibility.attraction import (
        AttractionGrid,
        AttractionSettings,
        attraction_dataset,
        make_attraction_job,
    )
    from m4_dynamics.feasibility.files import save_map
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.view.attraction_plots import plot_attraction
    from m4_dynamics.view.attraction_tables import attraction_tables, describe_attraction, describe_equilibrium
    from m4_dynamics.view.map_page import write_map_page
    from m4_dynamics.view.tables import make_console, print_note, print_tables

    grid = AttractionGrid(
        wheel_speed=parse_axis("--wheel-speed", args.wheel_speed),
        pitch_error=np.radians(parse_axis("--pitch-range", args.pitch_range)),
        pitch_rate=np.radians(parse_axis("--rate-range", args.rate_range)),
    )
    settings = AttractionSettings(
        slope=math.radians(args.slope),
        friction=args.friction,
        thrust=args.thrust,
        plant=args.plant,
        controller=args.controller,
        duration=args.duration,
        starts=args.starts,
        seed=args.seed,
        yaw_error_max=math.radians(args.yaw_error),
        adaptive=args.adaptive,
    )
    job = make_attraction_job(load_robot(args.robot), grid, settings)
    store = run_sweep_job(args, job)
    dataset = attraction_dataset(store, job, command=command_line())
    written = [
        save_map(dataset, args.out / "map.nc"),
        plot_attraction(dataset, args.out / "map.png"),
        write_map_page(dataset, args.out / "map.html"),
    ]
    if args.json:
        print(json.dumps(describe_attraction(dataset), indent=2, allow_nan=False))
    else:
        console = make_console()
        print_tables(console, attraction_tables(dataset))
        print_note(console, describe_equilibrium(dataset))
        print_note(console, "written: " + ", ".join(str(path) for path in (store.path, *written)))
    return EXIT_OK
