"""`m4 map static`: equilibria in closed form over slope, thrust, friction, speed and posture."""

from __future__ import annotations

import argparse
import json
import math
import time

__all__ = ["add_arguments", "run"]

EXIT_OK = 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    from m4_dynamics.cli.map_options import add_axis_options, add_result_options

    add_axis_options(parser, slope="0:85:341", thrust_count=217, friction="0.4:1.2:9")
    parser.add_argument("--speed", default="0", metavar="M/S", help="climbing speed (default: 0)")
    parser.add_argument("--posture", metavar="NAME", help="posture of the legs (default: the balancing posture)")
    parser.add_argument(
        "--posture-angle", metavar="DEG", help="angle of the joints named with --posture-joint, as a further axis"
    )
    parser.add_argument(
        "--posture-joint",
        action="append",
        default=[],
        metavar="NAME",
        help="joint that turns along the axis --posture-angle; may be given several times",
    )
    parser.add_argument(
        "--rotor-radius", type=float, default=0.1, metavar="M", help="of one rotor, for the power (default: 0.1)"
    )
    parser.add_argument(
        "--figure-of-merit", type=float, default=0.6, help="of a rotor, for the power (default: 0.6, assumed)"
    )
    add_result_options(parser, folder="runs/map-static")


def run(args: argparse.Namespace) -> int:
    """Compute the map, write it with its pictures, print what it says.

    Args:
        args: The parsed options.

    Returns:
        0.

    Raises:
        M4Error: An option is not valid, or a file cannot be written.
    """
    import numpy as np

    from m4_dynamics.cli.map_options import claim_folder, command_line, parse_axis
    from m4_dynamics.errors import InvalidSettingError
    from m4_dynamics.feasibility.curves import map_curves
    from m4_dynamics.feasibility.files import save_map
    from m4_dynamics.feasibility.grid import MapGrid
    from m4_dynamics.feasibility.postures import posture_cases
    from m4_dynamics.feasibility.provenance import robot_provenance
    from m4_dynamics.feasibility.static import static_map
    from m4_dynamics.reduced.power import PowerModel
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.view.map_page import write_map_page
    from m4_dynamics.view.map_plots import plot_static_curves, plot_static_map
    from m4_dynamics.view.map_tables import describe_curves, static_tables
    from m4_dynamics.view.tables import make_console, print_note, print_tables

    robot = load_robot(args.robot)
    balance = robot.require_balance()
    balancing = [thruster for thruster in robot.thrusters if thruster.frame in balance.thrusters]
    thrust_max = sum(thruster.maximum_thrust for thruster in balancing)
    if args.thrust is not None:
        thrust = parse_axis("--thrust", args.thrust)
    else:
        thrust = np.unique(np.linspace(0.0, thrust_max, args.thrust_count))
    if bool(args.posture_joint) != (args.posture_angle is not None):
        raise InvalidSettingError(
            "--posture-angle", args.posture_angle, "to come together with --posture-joint, which names what turns"
        )
    turned = args.posture_angle is not None
    grid = MapGrid(
        slope=np.radians(parse_axis("--slope", args.slope)),
        thrust=thrust,
        friction=parse_axis("--friction", args.friction),
        speed=parse_axis("--speed", args.speed),
        posture_angle=np.radians(parse_axis("--posture-angle", args.posture_angle)) if turned else np.nan,
        posture_joints=tuple(args.posture_joint),
    )
    power_model = PowerModel(
        thruster_count=max(1, len(balancing)), rotor_radius=args.rotor_radius, figure_of_merit=args.figure_of_merit
    )
    files = ("map.nc", "map.png", "curves.png", "map.html")
    claim_folder(args.out, force=args.force, names=files)
    cases = posture_cases(robot, grid, posture=args.posture)
    started = time.perf_counter()
    dataset = static_map(cases, grid, power_model=power_model)
    elapsed = time.perf_counter() - started
    dataset.attrs.update(
        robot_provenance(robot, command=command_line()),
        posture=args.posture or balance.posture,
        rotor_radius=args.rotor_radius,
        figure_of_merit=args.figure_of_merit,
    )
    curves = map_curves(dataset)
    written = [
        save_map(dataset, args.out / "map.nc"),
        plot_static_map(dataset, args.out / "map.png"),
        plot_static_curves(curves, args.out / "curves.png"),
        write_map_page(dataset, args.out / "map.html"),
    ]
    if args.json:
        print(json.dumps(describe_curves(curves), indent=2, allow_nan=False))
    else:
        console = make_console()
        print_tables(console, static_tables(dataset, curves))
        if not math.isnan(float(curves["posture_angle"][0])):
            print_note(console, "Tables and pictures show the first posture angle; map.nc holds all.")
        print_note(console, f"{grid.cells} cells, both branches, computed in {elapsed:.2f} s")
        print_note(console, "written: " + ", ".join(str(path) for path in written))
    return EXIT_OK
