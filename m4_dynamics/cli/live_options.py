"""The options `--live`, `--host` and `--no-browser` of the commands that simulate."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from m4_dynamics.robot.robot import Robot
    from m4_dynamics.view.live import LiveView

__all__ = ["add_live_arguments", "live_view"]

_WAIT_FOR_BROWSER = 5.0  # [s] at most, for a browser that was asked to open


def add_live_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--live", action="store_true", help="show the run in 3D as it happens, at the pace of real time"
    )
    parser.add_argument("--host", default="127.0.0.1", metavar="ADDRESS", help="of --live (default: 127.0.0.1)")
    parser.add_argument("--port", type=int, default=0, metavar="N", help="of --live (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="of --live: print the address, open no browser")


@contextmanager
def live_view(args: argparse.Namespace, robot: Robot) -> Iterator[LiveView | None]:
    """Serve the live view while the block runs, if it is wanted.

    Args:
        args: The parsed options.
        robot: The robot.

    Yields:
        The view, whose `observe` is to be called after every control period; None without `--live`.

    Raises:
        InvalidSettingError: The address cannot be had.
    """
    if not args.live:
        yield None
        return
    from m4_dynamics.view.live import LiveView
    from m4_dynamics.view.serving import can_open_browser, open_browser

    with LiveView(robot, host=args.host, port=args.port) as view:
        print(f"live view: {view.url}", file=sys.stderr, flush=True)
        if not args.no_browser and can_open_browser():
            open_browser(view.url)
            view.wait_for_viewer(_WAIT_FOR_BROWSER)
        yield view
