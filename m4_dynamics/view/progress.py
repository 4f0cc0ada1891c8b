"""A progress bar on a terminal, silence in a pipe."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

__all__ = ["Progress", "progress_bar", "status_line"]


class Progress(Protocol):
    """Takes the amount done so far and, if it has become another one, the total."""

    def __call__(self, done: float, total: float | None = None) -> None: ...


@contextmanager
def progress_bar(title: str, total: float, *, unit: str) -> Iterator[Progress | None]:
    """Show how far a long job is, with the time left.

    Args:
        title: What is going on.
        total: The amount at which it is done.
        unit: Unit of the amount.

    Yields:
        A function that takes the amount done so far and, if it has become another one, the total; None when stderr is
        not a terminal.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f}/{task.total:g} " + unit),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=total)

        def advance(done: float, total: float | None = None) -> None:
            progress.update(task, completed=done, total=total)

        yield advance


@contextmanager
def status_line() -> Iterator[Callable[[str, float], None] | None]:
    """Show what a long job is at, with a spinner.

    Yields:
        A function that takes the name of what begins and the simulated time [s], or None when stderr is no terminal.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console

    with Console(stderr=True).status("starting") as status:
        yield lambda name, simulated: status.update(f"{name} (t = {simulated:.1f} s)")
