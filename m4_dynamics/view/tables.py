"""Tables on the terminal, all of one style.

On a terminal they fit its width and have colours. In a pipe they are plain and as wide as they need to be, so that no
figure is cut off on its way to grep or to a file.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from typing import TextIO

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

__all__ = ["cell", "make_console", "make_table", "print_note", "print_tables"]

#: Wide enough for any row; a table takes only what it needs of it.
_PIPE_WIDTH = 4000

_STYLES = {"error": "bold red", "warning": "yellow", "note": "dim"}


def make_console(stream: TextIO | None = None) -> Console:
    """A console for tables.

    Args:
        stream: Where to print; None prints to stdout.

    Returns:
        The console.
    """
    target = sys.stdout if stream is None else stream
    width = None if target.isatty() else _PIPE_WIDTH
    return Console(file=target, width=width, highlight=False, soft_wrap=False)


def make_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Table:
    """A titled table; columns that hold numbers alone are set flush right.

    Args:
        title: The title.
        columns: The column's headings, units included.
        rows: Their cells: strings as they are, floats to four significant digits.

    Returns:
        The table, to be printed on a console from `make_console`.
    """
    table = Table(
        title=Text(title, style="bold"), title_justify="left", box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False
    )
    content = [list(row) for row in rows]
    for index, column in enumerate(columns):
        values = [row[index] for row in content]
        numeric = any(_is_number(value) for value in values) and all(
            _is_number(value) or value in ("", "-") for value in values
        )
        table.add_column(escape(column), justify="right" if numeric else "left", overflow="fold")
    for row in content:
        table.add_row(*(Text(cell(value), style=_STYLES.get(str(value), "")) for value in row))
    return table


def cell(value: object) -> str:
    """A value as a table shows it: floats to four significant digits, None as a dash."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        rounded = float(f"{value:.4g}")
        return f"{rounded:.4g}" if rounded else "0"
    return str(value)


def print_tables(console: Console, tables: Iterable[Table]) -> None:
    """Print tables one below the other, a blank line after each."""
    for table in tables:
        # A title within the table would be broken at the width of its columns.
        title, table.title = table.title, None
        if title is not None:
            console.print(title, soft_wrap=not console.is_terminal)
        console.print(table)
        table.title = title
        console.print()


def print_note(console: Console, text: str) -> None:
    """A line of explanation under a table."""
    console.print(Text(text, style="dim"), soft_wrap=not console.is_terminal)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
