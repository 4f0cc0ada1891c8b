"""`m4 wair`: climb a slope on the full model and write plots, a summary and a 3D replay."""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
from pathlib import Path

from m4_dynamics.cli.live_options import add_live_arguments, live_view

CONTROLLER_HELP = """\
default: MPC about the trim with a terminal cost; paper: the paper's MPC (no terminal cost); paper-zero: the same with
raw inputs in its cost; lqr: saturated LQR of the trim; pid: wheels alone, for
flat ground"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument("robot", nargs="?", metavar="ROBOT", help="a TOML description; without one, the bundled M4")
    parser.add_argument("--slope", type=float, required=True, metavar="DEG", help="inclination of the ground [deg]")
    parser.add_argument(
        "--friction", type=float, metavar="MU", help="static friction coefficient (default: the robot's)"
    )
    parser.add_argument("--speed", type=float, default=0.3, metavar="M/S", help="climbing speed [m/s] (default: 0.3)")
    parser.add_argument(
        "--thrust",
        default="auto",
        metavar="auto|N",
        help="total thrust of the trim [N] (default: auto, inside all limits)",
    )
    parser.add_argument(
        "--controller",
        default="default",
        choices=("default", "paper", "paper-zero", "lqr", "pid"),
        help=CONTROLLER_HELP,
    )
    parser.add_argument("--duration", type=float, default=10.0, metavar="S", help="simulated time [s] (default: 10)")
    parser.add_argument(
        "--pitch-error", type=float, default=5.0, metavar="DEG", help="initial pitch less the trim's [deg] (default: 5)"
    )
    parser.add_argument(
        "--yaw-error",
        type=float,
        default=0.5,
        metavar="DEG",
        help="initial heading, left of uphill [deg] (default: 0.5)",
    )
    parser.add_argument(
        "--realistic",
        action="store_true",
        help="rotor lag, servo and motor limits, encoder counts, IMU noise with attitude estimation, control delay and "
        "battery sag (default: the paper's ideal plant)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the sensors' noise (default: 0)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the results (default: runs/wair-SLOPE)")
    parser.add_argument("--no-viewer", action="store_true", help="do not write viewer.html")
    add_live_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print the summary as JSON instead of a table")


def run(args: argparse.Namespace) -> int:
    """Climb, write the results, print the figures.

    Args:
        args: The parsed options.

    Returns:
        0 climbed; 1 slipped, fell, lagged; 2 infeasible; 130 interrupted.
    """
    from m4_dynamics.cli.main import EXIT_ERROR, EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK
    from m4_dynamics.cli.results import make_folder, write_run
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.simulation.climb import ClimbSettings, run_climb
    from m4_dynamics.simulation.fidelity import Fidelity
    from m4_dynamics.simulation.verdict import Verdict
    from m4_dynamics.view.climb_tables import climb_table
    from m4_dynamics.view.progress import progress_bar
    from m4_dynamics.view.report import climb_figures
    from m4_dynamics.view.tables import make_console, print_note, print_tables

    robot = load_robot(args.robot)
    settings = ClimbSettings(
        slope=math.radians(args.slope),
        friction_static=args.friction,
        speed=args.speed,
        thrust=parse_thrust(args.thrust),
        controller=args.controller,
        duration=args.duration,
        pitch_error=math.radians(args.pitch_error),
        yaw_error=math.radians(args.yaw_error),
        fidelity=Fidelity.realistic(seed=args.seed) if args.realistic else Fidelity.ideal(),
    )
    folder = args.out if args.out is not None else Path("runs") / f"wair-{args.slope:g}"
    make_folder(folder)
    command = shlex.join(["m4", "wair", *command_words(args)])
    with (
        progress_bar(f"climbing {args.slope:g} deg", settings.duration, unit="s") as advance,
        live_view(args, robot) as live,
    ):
        observer = None if live is None else live.observe
        result = run_climb(robot, settings, attributes={"command": command}, on_progress=advance, observer=observer)
    summary = result.summary
    written = write_run(
        result.dataset,
        summary.as_dict(),
        robot,
        folder,
        with_viewer=not args.no_viewer,
        table=climb_figures(summary),
        command=command,
    )
    if args.json:
        print(json.dumps(summary.as_dict(), indent=2, allow_nan=False))
    elif summary.verdict == Verdict.INFEASIBLE:
        # Nothing was simulated; why is said below.
        print_note(make_console(), "written: " + ", ".join(str(path) for path in written))
    else:
        console = make_console()
        print_tables(console, [climb_table(summary)])
        if summary.fidelity:
            print_note(console, "plant: " + ", ".join(summary.fidelity))
        for remark in summary.remarks:
            print_note(console, f"note: {remark}")
        print_note(console, f"{summary.verdict}: {summary.reason}")
        print_note(console, "written: " + ", ".join(str(path) for path in written))
    if summary.verdict == Verdict.INFEASIBLE:
        print(f"m4 wair: infeasible: {summary.reason}", file=sys.stderr)
        return EXIT_ERROR
    if summary.verdict == Verdict.ABORTED:
        return EXIT_INTERRUPTED if "interrupted" in summary.reason else EXIT_FAILED
    return EXIT_OK if summary.verdict == Verdict.CLIMBED else EXIT_FAILED


def parse_thrust(text: str) -> float | None:
    """Read `--thrust`.

    Args:
        text: "auto" or a number of newtons.

    Returns:
        The thrust [N], or None for auto.

    Raises:
        InvalidSettingError: It is neither.
    """
    from m4_dynamics.errors import InvalidSettingError

    if text == "auto":
        return None
    try:
        return float(text)
    except ValueError:
        raise InvalidSettingError("--thrust", text, "auto, or a number of newtons") from None


def command_words(args: argparse.Namespace) -> list[str]:
    """The options that reproduce a run, those that differ in nothing but where results go left out."""
    words = [args.robot] if args.robot else []
    for name in ("slope", "friction", "speed", "thrust", "controller", "duration", "pitch_error", "yaw_error"):
        value = getattr(args, name)
        if value is not None:
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            words += [f"--{name.replace('_', '-')}", shown]
    if args.realistic:
        words += ["--realistic", "--seed", str(args.seed)]
    return words
