"""The report of a run: one page to read on a laptop or a phone, with figures, plots, 3D replay and provenance.

The page draws its own plots with a small script, so that it stays light: the replay, which is much larger, is
compressed inside and starts when the reader asks for it.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
import operator
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata, resources
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray
from numpy.typing import NDArray

from m4_dynamics import __version__
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.climb_tables import climb_rows
from m4_dynamics.view.mission_tables import mission_columns, mission_rows
from m4_dynamics.view.offline_page import PAGE_POLICY
from m4_dynamics.view.phases import phases_of
from m4_dynamics.view.report_panels import report_panels
from m4_dynamics.view.tables import cell

if TYPE_CHECKING:
    from m4_dynamics.mission.summary import MissionSummary
    from m4_dynamics.simulation.verdict import ClimbSummary

__all__ = ["FigureTable", "climb_figures", "meets", "mission_figures", "report_html"]

_PACKAGES = ("pin", "proxsuite", "numba", "numpy", "scipy", "meshcat")
_GOOD = ("climbed", "completed")
_COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}


@dataclass(frozen=True, slots=True)
class FigureTable:
    """A table of figures.

    Attributes:
        caption: What the figures are of.
        columns: Headings.
        rows: The cells as they are shown.
        met: Of each row, whether its limit is met; None without one.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    met: tuple[bool | None, ...]


def climb_figures(summary: ClimbSummary) -> FigureTable:
    """A climb's figures beside their limits."""
    rows = [row for row in climb_rows(summary) if row[0] != "verdict" and row[1] is not None]
    shown = tuple((name, cell(value), _signs(unit), _signs(limit)) for name, value, unit, limit in rows)
    met = tuple(meets(value, limit) for _, value, _, limit in rows)
    return FigureTable("Figures of the climb", ("figure", "value", "unit", "limit"), shown, met)


def mission_figures(summary: MissionSummary) -> FigureTable:
    """A mission's phases with their figures; a phase is met if it was done."""
    rows = tuple(tuple(cell(value) for value in row) for row in mission_rows(summary))
    met = tuple(figures.ended == "done" for figures in summary.phases)
    return FigureTable("Phases of the mission", mission_columns(), rows, met)


def meets(value: object, limit: str) -> bool | None:
    """Whether a figure meets its limit.

    Args:
        value: The figure.
        limit: A comparison such as "<= 5", a count that must be equal such as "0", or a friction such as "mu_s 0.8",
            which must not be exceeded.

    Returns:
        The answer; None where the limit is no such comparison or the value no number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    word, _, number = limit.rpartition(" ")
    try:
        bound = float(number)
    except ValueError:
        return None
    if word == "":
        return value == bound
    if word == "mu_s":
        return value <= bound
    return _COMPARISONS[word](value, bound) if word in _COMPARISONS else None


def report_html(
    dataset: xarray.Dataset | None,
    summary: Mapping[str, Any],
    robot: Robot,
    *,
    table: FigureTable,
    command: str = "",
    replay: str | None = None,
) -> str:
    """The report of a run as the text of one offline page.

    Args:
        dataset: The trajectory; None when nothing was simulated.
        summary: The run's plain values, with verdict and reason.
        robot: The robot.
        table: The figures.
        command: The command line that made the run.
        replay: The replay's page, to be embedded; None leaves it out.

    Returns:
        The page.
    """
    folder = resources.files("m4_dynamics.view.page")

    def part(name: str) -> str:
        return folder.joinpath(name).read_text(encoding="utf-8")

    verdict = str(summary["verdict"])
    title = _title(summary, robot)
    if replay is not None:
        replay = replay.replace("</body>", f"<script>\n{part('report_bridge.js')}</script>\n</body>")
    return Template(part("report.html")).substitute(
        policy=PAGE_POLICY,
        title=html.escape(title),
        conditions="".join(f"<li>{html.escape(fact)}</li>" for fact in _conditions(summary)),
        verdict=html.escape(verdict),
        outcome="good" if verdict in _GOOD else "bad",
        reason=html.escape(_sentence(str(summary["reason"]))),
        remarks="".join(f"<p>{html.escape(_sentence(remark))}</p>" for remark in summary.get("remarks", ())),
        table=_table(table),
        provenance=_provenance(summary, robot, command),
        plots=_packed(json.dumps(_plots(dataset), ensure_ascii=False, allow_nan=False, separators=(",", ":"))),
        replay=_packed(replay) if replay is not None else "",
        style=part("report.css"),
        script=part("report.js"),
    )


def _signs(text: str) -> str:
    """Units and limits with the signs that a terminal may not have."""
    if text == "us":
        return "µs"
    return text.replace("mu_s", "μₛ").replace("<=", "≤").replace(">=", "≥")


def _title(summary: Mapping[str, Any], robot: Robot) -> str:
    if "mission" in summary:
        return f"{robot.name}: mission {summary['mission']}"
    return f"{robot.name} on a {summary['slope_deg']:.4g}° slope"


def _conditions(summary: Mapping[str, Any]) -> list[str]:
    facts = [f"slope {summary['slope_deg']:.4g}°", f"friction μₛ {summary['friction_static']:g}"]
    if summary.get("controller"):
        facts.append(f"controller {summary['controller']}")
    for key, words in (("speed_m_s", "speed {:g} m/s"), ("duration_s", "{:.4g} s simulated")):
        if summary.get(key) is not None:
            facts.append(words.format(summary[key]))
    if summary.get("pitch_error_deg") is not None:
        facts.append(f"started {summary['pitch_error_deg']:.3g}° off in pitch, {summary['yaw_error_deg']:.3g}° in yaw")
    return facts + list(summary.get("fidelity") or ())


def _sentence(text: str) -> str:
    text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."


def _table(table: FigureTable) -> str:
    words = {True: ("met", "✓ met"), False: ("missed", "✗ missed"), None: ("", "")}
    head = "".join(f'<th scope="col">{html.escape(column)}</th>' for column in (*table.columns, "result"))
    body = []
    for row, met in zip(table.rows, table.met, strict=True):
        first, *others = (html.escape(text) for text in row)
        cells = "".join(f"<td>{text}</td>" for text in others)
        name, word = words[met]
        body.append(f'<tr><th scope="row">{first}</th>{cells}<td class="{name}">{word}</td></tr>')
    return (
        f"<table><caption>{html.escape(table.caption)}</caption>"
        f"<thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table>"
    )


def _provenance(summary: Mapping[str, Any], robot: Robot, command: str) -> str:
    rows = [("command", command)] if command else []
    rows.append(("m4_dynamics", __version__))
    rows += [(name, _version(name)) for name in _PACKAGES]
    rows.append(("Python", f"{platform.python_version()} on {platform.system()} {platform.machine()}"))
    rows += [
        (f"{robot.files[kind].name if kind in robot.files else kind}, sha256", digest)
        for kind, digest in robot.file_hashes.items()
    ]
    return "".join(f"<dt>{html.escape(name)}</dt><dd><code>{html.escape(value)}</code></dd>" for name, value in rows)


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _plots(dataset: xarray.Dataset | None) -> dict[str, Any]:
    """Everything that the page plots, as plain values."""
    if dataset is None or dataset.sizes["time"] < 2:
        return {"time": [], "panels": [], "phases": []}
    return {
        "time": _figures(np.asarray(dataset["time"].values, dtype=float), 7),
        "phases": [
            {"label": one.label, "colour": one.colour, "start": round(one.start, 4), "end": round(one.end, 4)}
            for one in phases_of(dataset)
        ],
        "panels": [
            {
                "title": panel.title,
                "unit": panel.unit,
                "about": panel.about,
                "limits": panel.limits,
                "logarithmic": panel.logarithmic,
                "curves": [
                    {"label": curve.label, "dashed": curve.dashed, "values": _figures(curve.values, 4)}
                    for curve in panel.curves
                ],
            }
            for panel in report_panels(dataset)
        ],
    }


def _figures(values: NDArray[np.float64], digits: int) -> Sequence[float | None]:
    """Numbers to so many significant digits; those that are none become null."""
    return [float(f"{one:.{digits}g}") if np.isfinite(one) else None for one in values.tolist()]


def _packed(text: str) -> str:
    """Text, compressed, in letters; the same text gives the same letters."""
    return base64.b64encode(gzip.compress(text.encode("utf-8"), compresslevel=6, mtime=0)).decode("ascii")
