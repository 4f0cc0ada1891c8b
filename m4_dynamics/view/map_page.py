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
from m4_dynamics.view.map_layers import Layout, hover_text, map_layout
from m4_dynamics.view.offline_page import PAGE_POLICY

__all__ = ["write_map_page"]

_DISAGREE = {"symbol": "circle-open", "size": 9, "color": "#0072B2", "line": {"width": 2}}
_REPORTED = {"symbol": "diamond", "size": 6, "color": "#1F2933"}


def write_map_page(
    dataset: xarray.Dataset,
    path: Path | str,
    *,
    replay_arguments: str | None = None,
    reports: Sequence[CellReport] = (),
) -> Path:
    """Write a map's page.

    Args:
        dataset: A static or closed-loop map, or a region of attraction; of a static one the first posture and the
            fastest speed are shown.
        path: The page's file.
        replay_arguments: What `m4 view` and `m4 map replay` take, before slope, thrust and friction, to show a cell
            of this map; a click on a cell then tells both commands. None for maps whose cells have no replay.
        reports: Reports that there are of cells, with links that hold from the page's folder.

    Returns:
        The path.

    Raises:
        InvalidSettingError: The dataset is no map that has a page.
        ResultFileError: The file cannot be written.
    """
    layout = map_layout(dataset)
    sheets = layout.slider.factor * layout.cells[layout.slider.name].to_numpy()
    figure = _figure(layout, sheets, reports)
    figure.update_layout(title={"text": f"{layout.heading}<br><sub>{html.escape(_facts(dataset))}</sub>"})
    content = {
        "arguments": replay_arguments,
        "frictions": sheets.tolist(),
        "reports": [
            {
                "x": layout.x.factor * one.slope,
                "y": layout.y.factor * one.thrust,
                "friction": one.friction,
                "link": one.link,
                "label": f"start {one.start}" + (f", {one.verdict}" if one.verdict else ""),
            }
            for one in reports
        ],
    }
    folder = resources.files("m4_dynamics.view.page")
    page = Template(folder.joinpath("map.html").read_text(encoding="utf-8")).substitute(
        policy=PAGE_POLICY,
        title=html.escape(f"{dataset.attrs.get('robot', 'robot')}: {layout.heading}"),
        figure=figure.to_html(
            include_plotlyjs=True, full_html=False, div_id="map", config={"displaylogo": False, "responsive": True}
        ),
        marks=_marks(dataset, reports),
        reports=_report_list(reports),
        # Inside a script element only "</" could end the data early.
        data=json.dumps(content, ensure_ascii=False, allow_nan=False).replace("</", "<\\/"),
        script=folder.joinpath("map.js").read_text(encoding="utf-8"),
    )
    with replacing(Path(path)) as partial:
        partial.write_text(page, encoding="utf-8")
    return Path(path)


def _figure(layout: Layout, sheets: np.ndarray, reports: Sequence[CellReport]) -> Any:
    """The plot: of every sheet its cells and the marks on them, of which the slider shows one."""
    import plotly.graph_objects as go

    cells = layout.cells
    x, y = (axis.factor * cells[axis.name].to_numpy() for axis in (layout.x, layout.y))
    names, colours = cells.attrs["classes"], cells.attrs["colours"]
    first = len(sheets) // 2
    figure = go.Figure()
    for m, sheet in enumerate(sheets):
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
            i, j = np.nonzero(one["disagreement"].transpose(layout.y.name, layout.x.name).to_numpy() > 0)
            figure.add_trace(_marked(x[j], y[i], _DISAGREE, visible=m == first))
        if reports:
            here = [(layout.x.factor * r.slope, layout.y.factor * r.thrust) for r in reports if r.friction == sheet]
            places = np.array(here).reshape(-1, 2)
            figure.add_trace(_marked(places[:, 0], places[:, 1], _REPORTED, visible=m == first))
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
        height=760,
        showlegend=False,
    )
    return figure


def _marked(x: np.ndarray, y: np.ndarray, marker: dict[str, Any], *, visible: bool) -> Any:
    """Marks on cells; the pointer sees the cells below them."""
    import plotly.graph_objects as go

    return go.Scatter(x=x, y=y, mode="markers", marker=marker, hoverinfo="skip", visible=visible)


def _marks(dataset: xarray.Dataset, reports: Sequence[CellReport]) -> str:
    """What the marks on the cells mean."""
    marks = []
    if "disagreement" in dataset and bool((dataset["disagreement"] > 0).any()):
        marks.append('<span class="circle" aria-hidden="true">○</span> statics and rollouts disagree')
    if reports:
        marks.append('<span aria-hidden="true">◆</span> there is a report')
    return " &nbsp; ".join(marks)


def _report_list(reports: Sequence[CellReport]) -> str:
    """Links to the reports for those who don't point at cells."""
    if not reports:
        return ""
    items = "".join(
        f'<li><a href="{html.escape(one.link)}">{np.degrees(one.slope):g}°, {one.thrust:g} N, μₛ {one.friction:g}, '
        f"start {one.start}</a>{': ' + html.escape(one.verdict) if one.verdict else ''}</li>"
        for one in reports
    )
    number = f"{len(reports)} reports" if len(reports) > 1 else "One report"
    return f"<details><summary>{number} of single cells</summary><ul>{items}</ul></details>"


def _facts(dataset: xarray.Dataset) -> str:
    attributes = dataset.attrs
    what = [str(attributes.get("robot", "")), f"version {attributes.get('version', '')}"]
    if attributes.get("command"):
        what.append(str(attributes["command"]))
    return "   ·   ".join(what)


def _stepped(colours: list[str]) -> list[list[Any]]:
    """A colour scale without transitions."""
    count = len(colours)
    return [[(k + side) / count, colour] for k, colour in enumerate(colours) for side in (0, 1)]
