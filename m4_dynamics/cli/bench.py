"""`m4 bench`: measure the hot paths beside their peers in one run."""

from __future__ import annotations

import argparse
import json
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

    from m4_dynamics.bench.suite import Measurement


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument("robot", nargs="?", metavar="ROBOT", help="a TOML description; without one, the bundled M4")
    parser.add_argument("--slope", type=float, default=45.0, metavar="DEG", help="of the climbs [deg] (default: 45)")
    parser.add_argument("--rounds", type=int, default=15, metavar="N", help="bursts of each contender (default: 15)")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    """Measure and print.

    Args:
        args: The parsed options.

    Returns:
        0.
    """
    import numpy as np

    from m4_dynamics.bench.suite import bench_closed_loop, bench_control_step, bench_simulation_step, bench_static_map
    from m4_dynamics.cli.main import EXIT_OK
    from m4_dynamics.errors import InvalidSettingError
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.view.progress import progress_bar
    from m4_dynamics.view.tables import make_console, make_table, print_note, print_tables

    if args.rounds < 1:
        raise InvalidSettingError("--rounds", args.rounds, "at least 1")
    robot, slope = load_robot(args.robot), math.radians(args.slope)
    climbs = max(3, args.rounds // 3)
    # Before all others, which import what the first map does.
    with progress_bar("static map", args.rounds + 1, unit="maps") as advance:
        maps = bench_static_map(robot, rounds=args.rounds, on_progress=advance)
    with progress_bar("closed loop", climbs, unit="climbs") as advance:
        factors = bench_closed_loop(robot, slope=slope, rounds=climbs, on_progress=advance)
    with progress_bar("control step", args.rounds, unit="rounds") as advance:
        control = bench_control_step(robot, slope=slope, steps=200, rounds=args.rounds, on_progress=advance)
    with progress_bar("simulation step", args.rounds, unit="rounds") as advance:
        simulation = bench_simulation_step(robot, steps=1000, rounds=args.rounds, on_progress=advance)
    if args.json:
        values = {
            "static_map": {"cells": 1_000_000, "first_s": maps.first, "later_s": maps.later.tolist()},
            "closed_loop": {"slope_deg": args.slope, "real_time_factor": [float(factor) for factor in factors]},
            "control_step": [_as_dict(entry) for entry in control],
            "simulation_step": [_as_dict(entry) for entry in simulation],
        }
        print(json.dumps(values, indent=2, allow_nan=False))
        return EXIT_OK
    console = make_console()
    lowest, middle, highest = float(np.min(factors)), float(np.median(factors)), float(np.max(factors))
    closed_loop = make_table(
        f"Closed loop: climb of {args.slope:g} deg, 10 s, plant at 1 ms, MPC at 200 Hz, everything recorded",
        ("real-time factor", "least", "median", "greatest"),
        [(f"{climbs} climbs", lowest, middle, highest)],
    )
    lower, median, upper = np.percentile(maps.later, [25.0, 50.0, 75.0])
    static = make_table(
        "Static map of 1000 slopes x 1000 thrusts: both branches, all margins, active limit, power; one thread",
        ("time [s]", "first, with imports", "median of later ones", "+-"),
        [(f"{args.rounds + 1} maps", maps.first, float(median), f"{50.0 * (upper - lower) / median:.0f} %")],
    )
    print_tables(
        console,
        [
            static,
            closed_loop,
            _peer_table("Control step: linearise, condense, solve", control),
            _peer_table("Simulation step of 1 ms, standing on four wheels", simulation),
        ],
    )
    print_note(console, "Contenders take turns in bursts; medians over the rounds. Ratio: time over this package's.")
    return EXIT_OK


def _as_dict(entry: Measurement) -> dict[str, str | float | None]:
    return {
        "name": entry.name,
        "microseconds": entry.microseconds,
        "spread": entry.spread,
        "ratio": entry.ratio,
        "note": entry.note,
    }


def _peer_table(title: str, entries: list[Measurement]) -> Table:
    from m4_dynamics.view.tables import make_table

    rows = [
        (
            entry.name,
            entry.microseconds,
            None if entry.spread is None else f"{100.0 * entry.spread:.0f} %",
            entry.ratio,
            entry.note,
        )
        for entry in entries
    ]
    return make_table(title, ("contender", "us a step", "+-", "ratio", ""), rows)
