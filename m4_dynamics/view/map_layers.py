"""What the page of a map shows: cells with a class each, over two axes, one sheet for each value of a third."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.feasibility.attraction_rollout import OUTCOMES
from m4_dynamics.feasibility.cell import VERDICTS
from m4_dynamics.feasibility.limits import LIMIT_LABELS, Limit
from m4_dynamics.feasibility.static import best_branch
from m4_dynamics.view.map_style import LIMIT_COLOURS, OUTCOME_COLOURS, VERDICT_COLOURS

__all__ = ["MapAxis", "MapLayout", "map_layout"]

#: Every cell carries its figures as text: of larger maps the page shows every second cell, every third, ...
_CELLS_MAX = 24_000
_FEASIBLE = "#FFFFFF"


class MapAxis(NamedTuple):
    """An axis of the page: the map's dimension, its label, its factor from SI units, and its name in a sentence."""

    name: str
    label: str
    factor: float
    words: str
    unit: str


class MapLayout(NamedTuple):
    """What a page shows: cells with a class each, over x and y, one sheet for each value of the slider."""

    cells: xarray.Dataset
    heading: str
    x: MapAxis
    y: MapAxis
    slider: MapAxis


_DEGREES = 180.0 / np.pi
_SLOPE = MapAxis("slope", "slope [deg]", _DEGREES, "slope", "deg")
_THRUST = MapAxis("thrust", "total thrust [N]", 1.0, "thrust", "N")
_FRICTION = MapAxis("friction", "friction μₛ ", 1.0, "friction", "")
_PITCH = MapAxis("pitch_error", "initial pitch less the equilibrium's [deg]", _DEGREES, "pitch", "deg")
_RATE = MapAxis("pitch_rate", "initial pitch rate [deg/s]", _DEGREES, "pitch rate", "deg/s")
_SPEED = MapAxis("wheel_speed", "initial speed of the wheels [m/s] ", 1.0, "wheels", "m/s")


def map_layout(dataset: xarray.Dataset) -> MapLayout:
    """Lay a map out for its page.

    Args:
        dataset: A static or closed-loop map, or a region of attraction; of a static one the first posture and the
            fastest speed are shown, and of a large one every second cell, every third, ...

    Returns:
        The layout.

    Raises:
        InvalidSettingError: The dataset is no map that has a page.
    """
    kind = dataset.attrs.get("kind")
    if kind == "static":
        heading = "Where the robot can climb, and what stops it elsewhere"
        return MapLayout(_static_layers(_thinned(dataset)), heading, _SLOPE, _THRUST, _FRICTION)
    if kind == "closed-loop":
        return MapLayout(
            _closed_loop_layers(dataset), "Where the robot climbs in closed loop", _SLOPE, _THRUST, _FRICTION
        )
    if kind == "attraction":
        heading = f"From where the robot comes back to its equilibrium on {np.degrees(dataset.attrs['slope']):.4g}°"
        return MapLayout(_attraction_layers(dataset), heading, _PITCH, _RATE, _SPEED)
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
