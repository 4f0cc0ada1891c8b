"""A map as one HTML page that needs nothing else: hover for the figures of a cell, slide through the frictions."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.feasibility.cell import VERDICTS
from m4_dynamics.feasibility.disagreement import EFFECT_LABELS, Effect
from m4_dynamics.feasibility.limits import LIMIT_LABELS, Limit
from m4_dynamics.feasibility.static import best_branch
from m4_dynamics.output import replacing
from m4_dynamics.view.map_style import LIMIT_COLOURS, VERDICT_COLOURS

__all__ = ["write_map_page"]

#: Every cell carries its figures as text: of larger maps the page shows every second cell, every third, ...
_CELLS_MAX = 24_000
_FEASIBLE = "#FFFFFF"


def write_map_page(dataset: xarray.Dataset, path: Path | str) -> Path:
    """Write a map's page.

    Args:
        dataset: A static or closed-loop map; of a static one the first posture and the fastest speed are shown.
        path: The page's file.

    Returns:
        The path.

    Raises:
        InvalidSettingError: The dataset is no map that has a page.
        ResultFileError: The file cannot be written.
    """
    import plotly.graph_objects as go

    kind = dataset.attrs.get("kind")
    if kind == "static":
        cells = _static_layers(_thinned(dataset))
        heading = "Where the robot can climb, and what stops it elsewhere"
    elif kind == "closed-loop":
        cells = _closed_loop_layers(dataset)
        heading = "Where the robot climbs in closed loop"
    else:
        raise InvalidSettingError("kind of map", kind, "static or closed-loop")
    slope = np.degrees(cells["slope"].to_numpy())
    thrust, frictions = cells["thrust"].to_numpy(), cells["friction"].to_numpy()
    names, colours = cells.attrs["classes"], cells.attrs["colours"]
    first = len(frictions) // 2
    figure = go.Figure()
    for m in range(len(frictions)):
        one = cells.isel(friction=m)
        figure.add_trace(
            go.Heatmap(
                x=slope,
                y=thrust,
                z=one["class"].transpose("thrust", "slope").to_numpy(),
                zmin=-0.5,
                zmax=len(names) - 0.5,
                colorscale=_stepped(colours),
                colorbar={"tickvals": list(range(len(names))), "ticktext": names, "title": {"text": ""}},
                text=_hover_text(one),
                hoverinfo="text",
                visible=m == first,
            )
        )
    contours = "friction_needed" in cells
    if contours and min(len(slope), len(thrust)) > 1:
        needed = cells["friction_needed"].transpose("thrust", "slope").to_numpy()
        figure.add_trace(
            go.Contour(
                x=slope,
                y=thrust,
                z=np.where(np.isfinite(needed), np.minimum(needed, 3.0), np.nan),
                contours={"start": 0.1, "end": 1.5, "size": 0.1, "coloring": "none", "showlabels": True},
                line={"color": "#1F2933", "width": 1},
                showscale=False,
                hoverinfo="skip",
            )
        )
    always = [True] * (len(figure.data) - len(frictions))
    steps = [
        {
            "method": "restyle",
            "label": f"{friction:g}",
            "args": [{"visible": [k == m for k in range(len(frictions))] + always}],
        }
        for m, friction in enumerate(frictions)
    ]
    figure.update_layout(
        title={"text": f"{heading}<br><sub>{html.escape(_facts(dataset))}</sub>"},
        xaxis={"title": {"text": "slope [deg]"}},
        yaxis={"title": {"text": "total thrust [N]"}},
        sliders=[{"active": first, "currentvalue": {"prefix": "friction μₛ "}, "steps": steps, "pad": {"t": 40}}],
        template="plotly_white",
        height=760,
    )
    page = figure.to_html(include_plotlyjs=True, full_html=True, config={"displaylogo": False, "responsive": True})
    with replacing(Path(path)) as partial:
        partial.write_text(page, encoding="utf-8")
    return Path(path)


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


def _stepped(colours: list[str]) -> list[list[Any]]:
    """A colour scale without transitions."""
    count = len(colours)
    return [[(k + side) / count, colour] for k, colour in enumerate(colours) for side in (0, 1)]


#: Figure -> (label, factor, format); those that a map does not have are left out.
_STATIC_TEXT = {
    "pitch": ("pitch [deg]", 180.0 / np.pi, ".1f"),
    "duty": ("duty", 1.0, ".2f"),
    "friction_force": ("friction force [N]", 1.0, ".1f"),
    "normal_force": ("normal force [N]", 1.0, ".1f"),
    "friction_needed": ("friction needed", 1.0, ".3f"),
    "power": ("power [W]", 1.0, ".0f"),
    "margin_torque": ("torque to spare [N m]", 1.0, ".2f"),
    "margin_motor_speed": ("wheel speed to spare [rad/s]", 1.0, ".1f"),
    "margin_clearance": ("clearance to spare [m]", 1.0, ".3f"),
    "slip_time": ("slip [s]", 1.0, ".2f"),
    "climbed": ("climbed [m]", 1.0, ".2f"),
    "wheel_rms": ("wheel error, RMS [m]", 1.0, ".3f"),
    "duty_saturated": ("at full duty [s]", 1.0, ".2f"),
    "solver_failures": ("solver failures", 1.0, ".0f"),
    "friction_used": ("friction used", 1.0, ".2f"),
}


def _hover_text(one: xarray.Dataset) -> np.ndarray:
    """Text of every cell, shape (thrust, slope)."""
    slope, thrust = np.degrees(one["slope"].to_numpy()), one["thrust"].to_numpy()
    names = one.attrs["classes"]
    classes = one["class"].transpose("thrust", "slope").to_numpy()
    figures = []
    for name, (label, factor, form) in _STATIC_TEXT.items():
        if name not in one:
            continue
        values = one[name]
        if "start" in values.dims:
            values = values.isel(start=0)
        figures.append((label, form, factor * values.transpose("thrust", "slope").to_numpy()))
    effects = one["disagreement"].transpose("thrust", "slope").to_numpy() if "disagreement" in one else None
    text = np.empty(classes.shape, dtype=object)
    for (j, i), code in np.ndenumerate(classes):
        lines = [f"<b>{names[int(code)] if code >= 0 else 'not done yet'}</b>"]
        lines.append(f"slope {slope[i]:.2f} deg, thrust {thrust[j]:.2f} N")
        lines += [f"{label}: {values[j, i]:{form}}" for label, form, values in figures if np.isfinite(values[j, i])]
        if effects is not None and effects[j, i]:
            lines.append(f"statics disagree: {EFFECT_LABELS[Effect(int(effects[j, i]))]}")
        text[j, i] = "<br>".join(lines)
    return text
