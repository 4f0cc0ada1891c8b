"""Tables on a terminal and in a pipe."""

from __future__ import annotations

import io

import pytest

from m4_dynamics.view.tables import cell, make_console, make_table, print_note, print_tables


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def printed(stream: io.StringIO) -> str:
    console = make_console(stream)
    rows = [["short", 1.0], ["x" * 300, 0.123456]]
    print_tables(console, [make_table("Title", ["name", "value [m]"], rows)])
    print_note(console, "A note of many words. " * 20)
    return stream.getvalue()


def test_pipe_gets_full_width_without_styling() -> None:
    text = printed(io.StringIO())
    assert "\x1b" not in text
    assert "x" * 300 in text
    assert len([line for line in text.splitlines() if line.startswith("A note")]) == 1


def test_terminal_gets_lines_that_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setenv("TERM", "xterm")
    text = printed(Terminal())
    assert "\x1b" in text
    assert "x" * 300 not in text
    assert text.count("x") == 300  # folded, not cut


def test_numbers_are_flush_right_and_text_is_not() -> None:
    stream = io.StringIO()
    make_console(stream).print(make_table("T", ["name", "number"], [["a", 1.5], ["b", 22.25], ["c", "-"]]))
    lines = [line for line in stream.getvalue().splitlines() if line[:1] in ("a", "b", "c")]
    assert lines == ["a         1.5", "b       22.25", "c           -"]


def test_markup_in_cells_and_headings_is_shown_as_it_is() -> None:
    stream = io.StringIO()
    make_console(stream).print(make_table("[bold]T", ["[red]name"], [["[robot] urdf"]]))
    text = stream.getvalue()
    assert "[bold]T" in text
    assert "[red]name" in text
    assert "[robot] urdf" in text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.0, "1"),
        (0.123456, "0.1235"),
        (-1e-20, "-1e-20"),
        (0.0, "0"),
        (-0.0, "0"),
        (123456.0, "1.235e+05"),
        (3, "3"),
        (True, "yes"),
        (False, "no"),
        (None, "-"),
        ("text", "text"),
    ],
)
def test_cells(value: object, text: str) -> None:
    assert cell(value) == text
