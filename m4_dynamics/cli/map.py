"""`m4 map`: where a robot can climb, over slope and thrust, and what stops it elsewhere."""

from __future__ import annotations

import argparse
import importlib

__all__ = ["add_arguments", "run"]

#: Kind of map -> (module, help). Only the kind that is used is imported when it runs; options are cheap.
KINDS: dict[str, tuple[str, str]] = {
    "static": ("m4_dynamics.cli.map_static", "equilibria in closed form, with margins and the limit that is active"),
    "closed-loop": ("m4_dynamics.cli.map_closed_loop", "rollouts of the controller on the full model, in parallel"),
    "attraction": (
        "m4_dynamics.cli.map_attraction",
        "from which pitches, pitch rates and wheel speeds the robot comes back to its equilibrium",
    ),
    "replay": ("m4_dynamics.cli.map_replay", "one cell of a closed-loop map again, with plots and 3D replay"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    kinds = parser.add_subparsers(dest="kind", metavar="KIND", required=True)
    for name, (module_name, summary) in KINDS.items():
        module = importlib.import_module(module_name)
        kind = kinds.add_parser(name, help=summary, description=summary[0].upper() + summary[1:] + ".")
        module.add_arguments(kind)
        kind.set_defaults(run_kind=module.run, parser=kind)


def run(args: argparse.Namespace) -> int:
    """Make the map of the kind asked for; see its module."""
    return int(args.run_kind(args))
