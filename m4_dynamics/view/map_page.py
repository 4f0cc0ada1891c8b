"""A map as one HTML page that needs nothing else: hover for the figures of a cell, slide through the frictions."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import xarray

from m4_dynamics.output import replacing
from m4_dynamics.view.cell_reports import CellReport
from m4_dynamics.view.map_hover import hover_text
from m4_dynamics.view.map_layers import MapLayout, map_layout
from m4_dynamics.view.offline_page import PAGE_POLICY

__all__ = ["write_map_page"]

_BLUE, _INK = "#0072B2", "#1F2933"
_RING = f'<circle cx="7" cy="7" r="4.7" fill="none" stroke="{_BLUE}" stroke-width="2"/>'
_DIAMOND = f'<path d="M7 2.5L11.5 7L7 11.5L2.5 7Z" fill="{_INK}"/>'
_CONTOUR = f'<path d="M1 12C5 11 9 8 13 2" fill="none" stroke="{_INK}"/>'


def write_map_page(
    dataset: xarray.Dataset, path: Path | str, *, subject: str | None = None, reports: Sequence[CellReport] = ()
) -> Path:
    """Write a map's page.

    Args:
        dataset: A static or closed-loop map, or a region of attraction; of a static one the first posture and the
            fastest speed are shown.
        path: The page's file.
        subject: The map, and its robot, as words of a command line; a click on a cell of a closed-loop map then shows
            its reports, or the command `m4 map replay` that writes one, and the command `m4 view` for the cell.
        reports: Those that are in the page's folder, see `find_cell_reports`; their cells are marked.

    Returns:
        The path.

    Raises:
        InvalidSettingError: The dataset is no map that has a page.
        ResultFileError: The file cannot be written.
    """
    layout = map_layout(dataset)
    folder = resources.files("m4_dynamics.view.page")

    def part(name: str) -> str:
        return folder.joinpath(name).read_text(encoding="utf-8")

    page = Template(part("map.html")).substitute(
        policy=PAGE_POLICY,
        title=html.escape(f"{dataset.attrs.get('robot', '')}: {layout.heading}"),
        heading=html.escape(layout.heading),
        facts=html.escape(_facts(dataset)),
        style=part("map.css"),
        plot=_figure(layout, reports).to_html(
            include_plotlyjs=True, full_html=False, div_id="plot", config={"displaylogo": False, "responsive": True}
        ),
        key=_key(layout.cells, reports),
        cells="" if subject is None else _cells(subject, dataset, reports),
        # Inside a script element only "</" could end the data early.
        data="null" if subject is None else json.dumps(_data(subject, dataset, reports)).replace("</", "<\\/"),
        script="" if subject is None else part("map.js"),
    )
    with replacing(Path(path)) as partial:
        partial.write_text(page, encoding="utf-8")
    return Path(path)


def _figure(layout: MapLayout, reports: Sequence[CellReport]) -> Any:
    """The map as plotly draws it."""
    import plotly.graph_objects as go

    cells = layout.cells
    x, y = (axis.factor * cells[axis.name].to_numpy() for axis in (layout.x, layout.y))
    sheets = layout.slider.factor * cells[layout.slider.name].to_numpy()
    names, colours = cells.attrs["classes"], cells.attrs["colours"]
    first = len(sheets) // 2
    figure = go.Figure()
    for m in range(len(sheets)):
        one = cells.isel({layout.slider.name: m})
        figure.add_trace(
            go.Heatmap(
                x=x,
                y=y,
                z=one["class"].transpose(layout.y.name, layout.x.name).to_numpy(),
                zmin=-0.5,
                zmax=len(names) - 0.5,
                colorscale=_stepped(colours),
                colorbar={"tickvals": list(range(len(names))), "ticktext": names, "title": {"text": ""}},
                text=hover_text(one, layout),
                hoverinfo="text",
                visible=m == first,
            )
        )
        if "disagreement" in one:
            at = np.nonzero(one["disagreement"].transpose("thrust", "slope").to_numpy() > 0)
            ring = {"symbol": "circle-open", "size": 11, "color": _BLUE, "line": {"width": 2}}
            figure.add_trace(_marks(x[at[1]], y[at[0]], ring, visible=m == first))
        if reports:
            there = {(report.index.slope, report.index.thrust) for report in reports if report.index.friction == m}
            i, j = np.array(sorted(there), dtype=int).reshape(-1, 2).T
            diamond = {"symbol": "diamond", "size": 6, "color": _INK, "line": {"width": 1, "color": "#FFFFFF"}}
            figure.add_trace(_marks(x[i], y[j], diamond, visible=m == first))
    sheet_of = [m for m in range(len(sheets)) for _ in range(len(figure.data) // len(sheets))]
    if "friction_needed" in cells and min(len(x), len(y)) > 1:
        needed = cells["friction_needed"].transpose(layout.y.name, layout.x.name).to_numpy()
        figure.add_trace(
            go.Contour(
                x=x,
                y=y,
                z=np.where(np.isfinite(needed), np.minimum(needed, 3.0), np.nan),
                contours={"start": 0.1, "end": 1.5, "size": 0.1, "coloring": "none", "showlabels": True},
                line={"color": "#1F2933", "width": 1},
                showscale=False,
                hoverinfo="skip",
            )
        )
    always = [True] * (len(figure.data) - len(sheet_of))
    steps = [
        {
            "method": "restyle",
            "label": f"{value:g}",
            "args": [{"visible": [sheet == m for sheet in sheet_of] + always}],
        }
        for m, value in enumerate(sheets)
    ]
    figure.update_layout(
        xaxis={"title": {"text": layout.x.label}},
        yaxis={"title": {"text": layout.y.label}},
        sliders=[{"active": first, "currentvalue": {"prefix": layout.slider.label}, "steps": steps, "pad": {"t": 40}}],
        template="plotly_white",
        height=700,
        margin={"t": 40},
        showlegend=False,
    )
    return figure


def _marks(x: np.ndarray, y: np.ndarray, marker: dict[str, Any], *, visible: bool) -> Any:
    """Marks on cells; pointer and clicks go through to the cells."""
    import plotly.graph_objects as go

    return go.Scatter(x=x, y=y, mode="markers", marker=marker, hoverinfo="skip", visible=visible)


def _key(cells: xarray.Dataset, reports: Sequence[CellReport]) -> str:
    """What the marks on the map mean."""
    meanings = []
    if "disagreement" in cells:
        meanings.append((_RING, "statics and rollouts disagree"))
    if reports:
        meanings.append((_DIAMOND, "has a report: click the cell, or see the list below"))
    if "friction_needed" in cells:
        meanings.append((_CONTOUR, "friction coefficient that the equilibrium needs"))
    entries = [f'<li><svg viewBox="0 0 14 14" aria-hidden="true">{sign}</svg>{text}</li>' for sign, text in meanings]
    return f'<ul id="key" aria-label="Marks on the map">{"".join(entries)}</ul>' if entries else ""


def _cells(subject: str, dataset: xarray.Dataset, reports: Sequence[CellReport]) -> str:
    """Where a click's answer goes, and the list of all reports for those who do not click."""
    options = "--slope DEG --thrust N" + (" --friction MU" if dataset.sizes["friction"] > 1 else "")
    command = html.escape(f"m4 map replay {subject} {options}")
    answer = (
        '<section id="cell" aria-label="Cell" aria-live="polite">'
        "<p>Click a cell for its report, or for the command that writes one:</p>"
        f"<p><code>{command}</code></p></section>"
    )
    if not reports:
        return answer
    items = []
    for one in reports:
        place = f"{_place(dataset, one)}: {_words(one)}"
        items.append(f'<li><a href="{html.escape(one.href)}">{html.escape(place)}</a></li>')
    title = f"Reports ({len(items)})"
    return f'{answer}\n<details id="reports"><summary>{title}</summary><ul>{"".join(items)}</ul></details>'


def _data(subject: str, dataset: xarray.Dataset, reports: Sequence[CellReport]) -> dict[str, Any]:
    """What the page's script wants to know, as plain values."""
    # Of several starts the one that ended worst gave the cell its colour.
    worst = dataset["verdict"].argmax("start")
    nothing = (dataset["trim_pitch"].isnull() & (dataset["verdict"] >= 0)).all("start")
    starts = worst.astype(object).where(~nothing, None).transpose("friction", "thrust", "slope")
    return {
        "subject": subject,
        "slopes": np.degrees(dataset["slope"].to_numpy()).tolist(),
        "thrusts": dataset["thrust"].to_numpy().tolist(),
        "frictions": dataset["friction"].to_numpy().tolist(),
        "starts": starts.to_numpy().tolist(),
        "reports": [
            {
                "sheet": one.index.friction,
                "row": one.index.thrust,
                "column": one.index.slope,
                "words": _words(one),
                "href": one.href,
            }
            for one in reports
        ],
    }


def _words(report: CellReport) -> str:
    return f"start {report.index.start}, {report.verdict}"


def _place(dataset: xarray.Dataset, report: CellReport) -> str:
    slope = float(np.degrees(dataset["slope"][report.index.slope]))
    thrust, friction = float(dataset["thrust"][report.index.thrust]), float(dataset["friction"][report.index.friction])
    return f"{slope:.4g}°, {thrust:.4g} N, μₛ {friction:.4g}"


def _facts(dataset: xarray.Dataset) -> str:
    attributes = dataset.attrs
    what = [str(attributes.get("robot", "")), f"version {attributes.get('version', '')}"]
    if attributes.get("command"):
        what.append(str(attributes["command"]))
    return " · ".join(what)


def _stepped(colours: list[str]) -> list[list[Any]]:
    """A colour scale without transitions."""
    count = len(colours)
    return [[(k + side) / count, colour] for k, colour in enumerate(colours) for side in (0, 1)]
