"""`m4 trim`: list the equilibria on a slope with their margins."""

from __future__ import annotations

import argparse
import json
import math

__all__ = ["add_arguments", "run"]

EXIT_OK = 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument("robot", nargs="?", metavar="ROBOT", help="a TOML description; without one, the bundled M4")
    parser.add_argument("--slope", type=float, default=45.0, metavar="DEG", help="inclination (default: 45)")
    parser.add_argument("--friction", type=float, metavar="MU", help="static friction (default: the robot's ground)")
    parser.add_argument("--speed", type=float, default=0.0, metavar="M/S", help="climbing speed (default: 0)")
    parser.add_argument(
        "--acceleration", type=float, default=0.0, metavar="M/S2", help="acceleration along the slope (default: 0)"
    )
    given = parser.add_mutually_exclusive_group()
    given.add_argument("--thrust", type=float, metavar="N", help="all equilibria at this total thrust")
    given.add_argument("--pitch", type=float, metavar="DEG", help="the equilibrium at this pitch")
    given.add_argument(
        "--criterion",
        choices=("automatic", "least-friction", "least-thrust", "least-power"),
        help="choose by this criterion alone (default: a sweep over thrust with the choice of each)",
    )
    parser.add_argument("--posture", metavar="NAME", help="posture of the legs (default: the balancing posture)")
    parser.add_argument(
        "--rotor-radius", type=float, default=0.1, metavar="M", help="of one rotor, for the power (default: 0.1)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")


def run(args: argparse.Namespace) -> int:
    """List the equilibria.

    Args:
        args: The parsed options.

    Returns:
        0.

    Raises:
        NoTrimExists: After printing, if no equilibrium satisfies the limits; at a given thrust or pitch only if there
            is none at all.
    """
    from m4_dynamics.errors import InvalidSettingError
    from m4_dynamics.reduced.power import PowerModel
    from m4_dynamics.reduced.reduction import reduce_robot
    from m4_dynamics.reduced.trim import keeps_reserves
    from m4_dynamics.reduced.trim_overview import FREE_CRITERIA, trim_overview
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.view.tables import make_console, print_note, print_tables
    from m4_dynamics.view.trim_report import describe_trims, trim_table

    if not abs(args.slope) < 90.0:
        raise InvalidSettingError("--slope", args.slope, "an angle between -90 and 90 deg")
    robot = load_robot(args.robot)
    reduction = reduce_robot(robot, args.posture)
    friction = robot.ground.friction_static if args.friction is None else args.friction
    limits = reduction.trim_limits(friction_static=friction)
    rotors = max(1, int((reduction.thrust_shares > 0.0).sum()))
    power_model = PowerModel(thruster_count=rotors, rotor_radius=args.rotor_radius)
    overview = trim_overview(
        reduction.parameters,
        math.radians(args.slope),
        limits=limits,
        thrust=args.thrust,
        pitch=None if args.pitch is None else math.radians(args.pitch),
        criteria=FREE_CRITERIA if args.criterion is None else (args.criterion,),
        speed=args.speed,
        acceleration=args.acceleration,
        power_model=power_model,
    )
    description = describe_trims(
        robot.name,
        reduction.parameters,
        overview,
        power_model,
        slope_deg=args.slope,
        friction_static=friction,
        speed_m_s=args.speed,
        acceleration_m_s2=args.acceleration,
        thrust_range_N=limits.thrust_range,
    )
    free = args.thrust is None and args.pitch is None
    refusal = overview.refusal
    if args.json:
        print(json.dumps(description, indent=2, allow_nan=False))
    else:
        console = make_console()
        if overview.members:
            print_tables(console, [trim_table(description)])
            rotor_power = f"rotors of {args.rotor_radius:g} m radius by momentum theory (assumed) and "
            print_note(
                console,
                f"Pitch 0 is upright in the world, negative leans back; thrust 0 to {reduction.thrust_max:g} N. "
                f"Power: {rotor_power if reduction.thrust_max > 0.0 else ''}the wheel motors' losses.",
            )
        automatic = overview.selected.get("automatic")
        if automatic is not None and not keeps_reserves(reduction.parameters, automatic, limits):
            print_note(
                console,
                "No equilibrium keeps the reserves of friction, thrust and duty; the automatic choice is the one that "
                "needs the least friction.",
            )
        if refusal is not None and not free and overview.members:
            print_note(console, f"None satisfies the limits: {refusal}.")
    if refusal is not None and (free or not overview.members):
        raise refusal
    return EXIT_OK
