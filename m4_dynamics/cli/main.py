"""Entry point of the `m4` command: finds the command's module, runs it, turns errors into messages and exit codes."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence

from m4_dynamics import __version__
from m4_dynamics.errors import M4Error

#: Command -> (module, one-line help). A module is imported only when its command is used.
COMMANDS: dict[str, tuple[str, str]] = {
    "wair": ("m4_dynamics.cli.wair", "climb a slope on the full model and write plots, a summary and a 3D replay"),
    "mission": ("m4_dynamics.cli.mission", "run a whole manoeuvre: stand up, drive, climb, come down, sit"),
    "view": (
        "m4_dynamics.cli.view",
        "look at a run, a posture or a cell of a map in 3D, served or as one file",
    ),
    "inspect": ("m4_dynamics.cli.inspect", "show what a robot description holds and what is wrong with it"),
    "reduce": ("m4_dynamics.cli.reduce", "reduce the full model to the planar pendulum and show the residual"),
    "trim": ("m4_dynamics.cli.trim", "list the equilibria on a slope with their margins"),
    "map": ("m4_dynamics.cli.map", "map where the robot can climb over slope and thrust, and what stops it elsewhere"),
    "bench": ("m4_dynamics.cli.bench", "measure the hot paths beside their peers in one run"),
}

EXIT_OK = 0
EXIT_FAILED = 1
EXIT_ERROR = 2
EXIT_INTERRUPTED = 130


def build_parser(command: str | None) -> argparse.ArgumentParser:
    """Build the argument parser; only the named command's module is imported.

    Args:
        command: The command whose options are wanted, or None for the overview alone.

    Returns:
        The parser.
    """
    parser = argparse.ArgumentParser(
        prog="m4", description="Analysis of robots that balance on two wheels and climb by pushing into the slope."
    )
    parser.add_argument("--version", action="version", version=f"m4_dynamics {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, (module_name, summary) in COMMANDS.items():
        subparser = subparsers.add_parser(name, help=summary, description=summary[0].upper() + summary[1:] + ".")
        if name == command:
            module = importlib.import_module(module_name)
            module.add_arguments(subparser)
            subparser.set_defaults(run=module.run, parser=subparser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: The arguments after the program's name; None takes those of the process.

    Returns:
        The exit code: 0 done, 1 the run ended badly (fell, slipped), 2 bad input or infeasible, 130 interrupted.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    command = next((word for word in arguments if word in COMMANDS), None)
    parsed, unknown = build_parser(command).parse_known_args(arguments)
    if unknown:  # the command's own parser says what it takes; argparse would have the outermost one speak
        parsed.parser.error("unrecognized arguments: " + " ".join(unknown))
    try:
        return int(parsed.run(parsed))
    except M4Error as error:
        print(f"m4 {parsed.command}: {error}", file=sys.stderr)
        return EXIT_ERROR
    except KeyboardInterrupt:
        print(f"m4 {parsed.command}: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of a pipe (head, less) has gone: point stdout nowhere so that Python's exit is quiet too.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
