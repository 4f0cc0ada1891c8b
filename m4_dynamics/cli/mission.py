"""`m4 mission`: run a whole manoeuvre on the full model."""

from __future__ import annotations

import argparse
import json
import shlex
from pathlib import Path

from m4_dynamics.cli.live_options import add_live_arguments, live_view


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument(
        "mission", nargs="?", default="wair15", metavar="MISSION",
        help="wair15, wair45, uprighting, landing, or a TOML file (default: wair15)",
    )  # fmt: skip
    parser.add_argument("--robot", metavar="ROBOT", help="a TOML description; without one, the bundled M4")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the results (default: runs/MISSION)")
    parser.add_argument(
        "--realistic", action="store_true", help="rotor lag, encoders, IMU, delay, limits and battery of a real robot"
    )
    parser.add_argument("--no-viewer", action="store_true", help="do not write viewer.html")
    parser.add_argument("--list", action="store_true", help="list the missions that come with the package")
    add_live_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print the summary as JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    """Run a mission, write its results, print its phases.

    Args:
        args: The parsed options.

    Returns:
        0 completed; 1 failed; 130 interrupted.
    """
    from m4_dynamics.cli.main import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK
    from m4_dynamics.cli.results import make_folder, write_run
    from m4_dynamics.mission.loading import load_mission, shipped_missions
    from m4_dynamics.mission.runner import run_mission
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.simulation.fidelity import Fidelity
    from m4_dynamics.view.mission_tables import mission_table, missions_table
    from m4_dynamics.view.progress import status_line
    from m4_dynamics.view.report import mission_figures
    from m4_dynamics.view.tables import make_console, print_note, print_tables

    console = make_console()
    if args.list:
        print_tables(console, [missions_table([load_mission(name) for name in shipped_missions()])])
        return EXIT_OK
    mission = load_mission(args.mission)
    robot = load_robot(args.robot)
    mission.check_against(robot)
    folder = args.out if args.out is not None else Path("runs") / mission.name
    make_folder(folder)
    command = shlex.join(
        ["m4", "mission", args.mission]
        + (["--robot", args.robot] if args.robot else [])
        + (["--realistic"] if args.realistic else [])
    )
    with status_line() as report, live_view(args, robot) as live:
        fidelity = Fidelity.realistic() if args.realistic else Fidelity()
        result = run_mission(
            robot,
            mission,
            fidelity=fidelity,
            attributes={"command": command},
            on_progress=report,
            observer=None if live is None else live.observe,
        )
    summary = result.summary
    written = write_run(
        result.dataset,
        summary.as_dict(),
        robot,
        folder,
        with_viewer=not args.no_viewer,
        table=mission_figures(summary),
        command=command,
    )
    if args.json:
        print(json.dumps(summary.as_dict(), indent=2, allow_nan=False))
    else:
        print_tables(console, [mission_table(summary)])
        print_note(console, f"{summary.verdict}: {summary.reason}")
        print_note(console, "written: " + ", ".join(str(path) for path in written))
    if summary.verdict == "interrupted":
        return EXIT_INTERRUPTED
    return EXIT_OK if summary.verdict == "completed" else EXIT_FAILED
