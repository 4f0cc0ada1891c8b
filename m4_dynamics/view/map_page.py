"""A map as one HTML page that needs nothing else: hover for the figures of a cell, slide through the frictions."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.feasibility.attraction_rollout import OUTCOMES
from m4_dynamics.feasibility.cell import VERDICTS
from m4_dynamics.feasibility.disagreement import EFFECT_LABELS, Effect
from m4_dynamics.feasibility.limits import LIMIT_LABELS, Limit
from m4_dynamics.feasibility.static import best_branch
from m4_dynamics.output import replacing
from m4_dynamics.view.map_style import LIMIT_COLOURS, OUTCOME_COLOURS, VERDICT_COLOURS

__all__ = ["write_map_page"]

#: Every cell carries its figures as text: of larger maps the page shows every second cell, every third, ...
_CELLS_MAX = 24_000
_FEASIBLE = "#FFFFFF"


class _Axis(NamedTuple):
    """An axis of the page: the map's dimension, its label, its factor from SI units, and its name in a sentence."""

    name: str
    label: str
    factor: float
    words: str
    unit: str


class _Layout(NamedTuple):
    """What a page shows: cells with a class each, over x and y, one sheet for each value of the slider."""

    cells: xarray.Dataset
    heading: str
    x: _Axis
    y: _Axis
    slider: _Axis


_DEGREES = 180.0 / np.pi
_SLOPE = _Axis("slope", "slope [deg]", _DEGREES, "slope", "deg")
_THRUST = _Axis("thrust", "total thrust [N]", 1.0, "thrust", "N")
_FRICTION = _Axis("friction", "friction μₛ ", 1.0, "friction", "")
_PITCH = _Axis("pitch_error", "initial pitch less the equilibrium's [deg]", _DEGREES, "pitch", "deg")
_RATE = _Axis("pitch_rate", "initial pitch rate [deg/s]", _DEGREES, "pitch rate", "deg/s")
_SPEED = _Axis("wheel_speed", "initial speed of the wheels [m/s] ", 1.0, "wheels", "m/s")


def write_map_page(dataset: xarray.Dataset, path: Path | str, *, replay_command: str | None = None) -> Path:
    """Write a map's page.

    Args:
        dataset: A static or closed-loop map, or a region of attraction; of a static one the first posture and the
            fastest speed are shown.
        path: The page's file.
        replay_command: What replays a cell once its slope, thrust and friction are added; a click on a cell then
            shows the whole command.

    Returns:
        The path.

    Raises:
        InvalidSettingError: The dataset is no map that has a page.
        ResultFileError: The file cannot be written.
    """
    import plotly.graph_objects as go

    layout = _layout(dataset)
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
                text=_hover_text(one, layout),
                hoverinfo="text",
                visible=m == first,
            )
        )
        if "disagreement" in one:
            figure.add_trace(_disagreements(one, x, y, visible=m == first))
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
        title={"text": f"{layout.heading}<br><sub>{html.escape(_facts(dataset))}</sub>"},
        xaxis={"title": {"text": layout.x.label}},
        yaxis={"title": {"text": layout.y.label}},
        sliders=[{"active": first, "currentvalue": {"prefix": layout.slider.label}, "steps": steps, "pad": {"t": 40}}],
        template="plotly_white",
        height=760,
        showlegend=False,
    )
    page = figure.to_html(
        include_plotlyjs=True,
        full_html=True,
        config={"displaylogo": False, "responsive": True},
        post_script=None if replay_command is None else _click_script(replay_command, sheets),
    )
    with replacing(Path(path)) as partial:
        partial.write_text(page, encoding="utf-8")
    return Path(path)


def _layout(dataset: xarray.Dataset) -> _Layout:
    kind = dataset.attrs.get("kind")
    if kind == "static":
        heading = "Where the robot can climb, and what stops it elsewhere"
        return _Layout(_static_layers(_thinned(dataset)), heading, _SLOPE, _THRUST, _FRICTION)
    if kind == "closed-loop":
        return _Layout(
            _closed_loop_layers(dataset), "Where the robot climbs in closed loop", _SLOPE, _THRUST, _FRICTION
        )
    if kind == "attraction":
        heading = f"From where the robot comes back to its equilibrium on {np.degrees(dataset.attrs['slope']):.4g}°"
        return _Layout(_attraction_layers(dataset), heading, _PITCH, _RATE, _SPEED)
    raise InvalidSettingError("kind of map", kind, "static, closed-loop or attraction")


#: On a click: the command that replays the cell, to be copied; `{plot_id}` is filled in by plotly.
_CLICK = """
const plot = document.getElementById('{plot_id}');
const line = document.createElement('p');
line.style.cssText = 'font-family: sans-serif; margin: 0 80px 24px';
line.textContent = 'Click a cell for the command that replays it.';
plot.parentNode.appendChild(line);
const frictions = FRICTIONS;
plot.on('plotly_click', (event) => {
  const at = event.points[0];
  const friction = frictions[plot.layout.sliders[0].active];
  const code = document.createElement('code');
  const place = [['slope', at.x], ['thrust', at.y], ['friction', friction]];
  code.textContent = COMMAND + place.map(([name, value]) => ` --${name} ${+value.toPrecision(8)}`).join('');
  line.replaceChildren('Replay: ', code);
});
"""


def _click_script(command: str, frictions: np.ndarray) -> str:
    # Inside a script element "</" would end it.
    quoted = json.dumps(command).replace("</", "<\\/")
    return _CLICK.replace("FRICTIONS", json.dumps(frictions.tolist())).replace("COMMAND", quoted)


def _disagreements(one: xarray.Dataset, x: np.ndarray, y: np.ndarray, *, visible: bool) -> Any:
    """Marks on the cells in which statics and rollouts disagree."""
    import plotly.graph_objects as go

    i, j = np.nonzero(one["disagreement"].transpose("thrust", "slope").to_numpy() > 0)
    return go.Scatter(
        x=x[j],
        y=y[i],
        mode="markers",
        marker={"symbol": "circle-open", "size": 9, "color": "#0072B2", "line": {"width": 2}},
        hoverinfo="skip",
        visible=visible,
    )


def _facts(dataset: xarray.Dataset) -> str:
    attributes = dataset.attrs
    what = [str(attributes.get("robot", "")), f"version {attributes.get('version', '')}"]
    if attributes.get("command"):
        what.append(str(attributes["command"]))
    return "   ·   ".join(what)


def _thinned(dataset: xarray.Dataset) -> xarray.Dataset:
    """Every k-th slope and thrust, so that the page opens quickly."""
    one = dataset.isel(posture_angle=[0], speed=[-1])
    cells = one.sizes["slope"] * one.sizes["thrust"] * one.sizes["friction"]
    step = max(1, int(np.ceil(np.sqrt(cells / _CELLS_MAX))))
    return one.isel(slope=slice(None, None, step), thrust=slice(None, None, step))


def _static_layers(dataset: xarray.Dataset) -> xarray.Dataset:
    best = best_branch(dataset).isel(posture_angle=0, speed=0, drop=True)
    classes = (best["active_limit"] + 1).where(~best["feasible"], 0)
    layers = best.assign({"class": classes})
    # The branch that is best depends on the friction; the contours are drawn for the grippiest ground's choice.
    if "friction" in layers["friction_needed"].dims:
        layers["friction_needed"] = layers["friction_needed"].isel(friction=-1, drop=True)
    layers.attrs.update(
        classes=["feasible", *(LIMIT_LABELS[limit] for limit in Limit)],
        colours=[_FEASIBLE, *(LIMIT_COLOURS[limit] for limit in Limit)],
    )
    return layers


def _closed_loop_layers(dataset: xarray.Dataset) -> xarray.Dataset:
    layers = dataset.assign({"class": dataset["verdict"].max("start")})
    layers["friction_needed"] = dataset["friction_needed"].isel(friction=-1, drop=True)
    layers.attrs.update(
        classes=["no equilibrium" if v == "infeasible" else str(v) for v in VERDICTS],
        colours=[VERDICT_COLOURS[verdict] for verdict in VERDICTS],
    )
    return layers


def _attraction_layers(dataset: xarray.Dataset) -> xarray.Dataset:
    layers = dataset.assign({"class": dataset["outcome"].max("start")})
    layers.attrs.update(classes=[str(one) for one in OUTCOMES], colours=[OUTCOME_COLOURS[one] for one in OUTCOMES])
    return layers


def _stepped(colours: list[str]) -> list[list[Any]]:
    """A colour scale without transitions."""
    count = len(colours)
    return [[(k + side) / count, colour] for k, colour in enumerate(colours) for side in (0, 1)]


#: Figure -> (label, factor, format); those that a map does not have are left out.
_TEXT = {
    "pitch": ("pitch [deg]", 180.0 / np.pi, ".1f"),
    "duty": ("duty", 1.0, ".2f"),
    "friction_force": ("friction force [N]", 1.0, ".1f"),
    "normal_force": ("normal force [N]", 1.0, ".1f"),
    "friction_needed": ("friction needed", 1.0, ".3f"),
    "power": ("power [W]", 1.0, ".0f"),
    "margin_torque": ("torque to spare [N m]", 1.0, ".2f"),
    "margin_motor_speed": ("wheel speed to spare [rad/s]", 1.0, ".1f"),
    "margin_clearance": ("clearance to spare [m]", 1.0, ".3f"),
    "settling_time": ("back after [s]", 1.0, ".2f"),
    "pitch_excursion": ("farthest pitch [deg]", 180.0 / np.pi, ".1f"),
    "axle_excursion": ("farthest axle [m]", 1.0, ".2f"),
    "slip_time": ("slip [s]", 1.0, ".2f"),
    "climbed": ("climbed [m]", 1.0, ".2f"),
    "wheel_rms": ("wheel error, RMS [m]", 1.0, ".3f"),
    "duty_saturated": ("at full duty [s]", 1.0, ".2f"),
    "solver_failures": ("solver failures", 1.0, ".0f"),
    "friction_used": ("friction used", 1.0, ".2f"),
}


def _hover_text(one: xarray.Dataset, layout: _Layout) -> np.ndarray:
    """Text of every cell, shape (y, x)."""
    over, across = layout.y.name, layout.x.name
    x, y = (axis.factor * one[axis.name].to_numpy() for axis in (layout.x, layout.y))
    names = one.attrs["classes"]
    classes = one["class"].transpose(over, across).to_numpy()
    figures = []
    for name, (label, factor, form) in _TEXT.items():
        if name not in one:
            continue
        values = one[name]
        if "start" in values.dims:
            values = values.isel(start=0)
        figures.append((label, form, factor * values.transpose(over, across).to_numpy()))
    effects = one["disagreement"].transpose(over, across).to_numpy() if "disagreement" in one else None
    text = np.empty(classes.shape, dtype=object)
    for (j, i), code in np.ndenumerate(classes):
        lines = [f"<b>{names[int(code)] if code >= 0 else 'not done yet'}</b>"]
        lines.append(f"{layout.x.words} {x[i]:.2f} {layout.x.unit}, {layout.y.words} {y[j]:.2f} {layout.y.unit}")
        lines += [f"{label}: {values[j, i]:{form}}" for label, form, values in figures if np.isfinite(values[j, i])]
        if effects is not None and effects[j, i]:
            lines.append(f"statics disagree: {EFFECT_LABELS[Effect(int(effects[j, i]))]}")
        text[j, i] = "<br>".join(lines)
    return text
