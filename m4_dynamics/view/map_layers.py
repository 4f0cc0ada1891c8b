"""What the page of a map shows: classes of cells over two axes, one sheet for each value of a slider."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.feasibility.attraction_rollout import OUTCOMES
from m4_dynamics.feasibility.cell import VERDICTS
from m4_dynamics.feasibility.disagreement import EFFECT_LABELS, Effect
from m4_dynamics.feasibility.limits import LIMIT_LABELS, Limit
from m4_dynamics.feasibility.static import best_branch
from m4_dynamics.view.map_style import LIMIT_COLOURS, OUTCOME_COLOURS, VERDICT_COLOURS

__all__ = ["Axis", "Layout", "hover_text", "map_layout"]

#: Every cell carries its figures as text: of larger maps the page shows every second cell, every third, ...
_CELLS_MAX = 24_000
_FEASIBLE = "#FFFFFF"


class Axis(NamedTuple):
    """An axis of the page: the map's dimension, its label, its factor from SI units, and its name in a sentence."""

    name: str
    label: str
    factor: float
    words: str
    unit: str


class Layout(NamedTuple):
    """What a page shows: cells with a class each, over x and y, one sheet for each value of the slider."""

    cells: xarray.Dataset
    heading: str
    x: Axis
    y: Axis
    slider: Axis


_DEGREES = 180.0 / np.pi
_SLOPE = Axis("slope", "slope [deg]", _DEGREES, "slope", "deg")
_THRUST = Axis("thrust", "total thrust [N]", 1.0, "thrust", "N")
_FRICTION = Axis("friction", "friction μₛ ", 1.0, "friction", "")
_PITCH = Axis("pitch_error", "initial pitch less the equilibrium's [deg]", _DEGREES, "pitch", "deg")
_RATE = Axis("pitch_rate", "initial pitch rate [deg/s]", _DEGREES, "pitch rate", "deg/s")
_SPEED = Axis("wheel_speed", "initial speed of the wheels [m/s] ", 1.0, "wheels", "m/s")


def map_layout(dataset: xarray.Dataset) -> Layout:
    """What a map's page shows.

    Args:
        dataset: A static or closed-loop map, or a region of attraction.

    Returns:
        The cells and their axes.

    Raises:
        InvalidSettingError: The dataset is no map that has a page.
    """
    kind = dataset.attrs.get("kind")
    if kind == "static":
        heading = "Where the robot can climb, and what stops it elsewhere"
        return Layout(_static_layers(_thinned(dataset)), heading, _SLOPE, _THRUST, _FRICTION)
    if kind == "closed-loop":
        return Layout(_closed_loop_layers(dataset), "Where the robot climbs in closed loop", _SLOPE, _THRUST, _FRICTION)
    if kind == "attraction":
        heading = f"From where the robot comes back to its equilibrium on {np.degrees(dataset.attrs['slope']):.4g}°"
        return Layout(_attraction_layers(dataset), heading, _PITCH, _RATE, _SPEED)
    raise InvalidSettingError("kind of map", kind, "static, closed-loop or attraction")


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


def hover_text(one: xarray.Dataset, layout: Layout) -> np.ndarray:
    """What is told of the cell under the pointer.

    Args:
        one: One sheet.
        layout: The layout that it belongs to.

    Returns:
        Text of every cell, shape (y, x).
    """
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
