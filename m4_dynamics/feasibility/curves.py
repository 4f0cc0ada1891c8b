"""Curves that summarise a static map: the steepest slopes, the least friction and what it costs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.feasibility.static import best_branch

if TYPE_CHECKING:
    import xarray

__all__ = ["map_curves"]


def map_curves(dataset: xarray.Dataset) -> xarray.Dataset:
    """Derive the curves of a static map, to the resolution of its axes.

    Args:
        dataset: A static map.

    Returns:
        `steepest_slope` over thrust, for each friction. `steepest_slope_best_thrust` and `best_thrust` over friction:
        the steepest slope that some thrust makes feasible, and that thrust. `least_friction`,
        `thrust_of_least_friction` and `power_of_least_friction` over slope: with all limits but friction kept; of
        thrusts within 0.01 of the least friction the smallest. `least_power` and `thrust_of_least_power` over slope,
        for each friction, all limits kept. NaN: nothing is feasible.

    Raises:
        InvalidSettingError: The dataset is not a static map.
    """
    import xarray

    if dataset.attrs.get("kind") != "static":
        raise InvalidSettingError("kind of map", dataset.attrs.get("kind"), "a static map, which has curves")
    best = best_branch(dataset)
    feasible, slope = best["feasible"], dataset["slope"]
    steepest_free = slope.where(feasible.any("thrust")).max("slope")
    there = best[["feasible", "friction_needed"]].sel(slope=steepest_free.fillna(float(slope[0])))
    allowed_power = best["power"].where(feasible)

    # Friction of any size: all margins but that of friction are kept.
    kept = ~dataset["self_collision"]
    for name in dataset.data_vars:
        if str(name).startswith("margin_") and name != "margin_friction":
            kept = kept & (dataset[name] >= -1e-9)
    needed = dataset["friction_needed"].where(kept)
    branch = needed.fillna(np.inf).argmin("branch")
    needed, power = needed.isel(branch=branch), dataset["power"].isel(branch=branch)
    least_friction = needed.min("thrust")
    # Where the friction force passes through zero, which thrust is nearest to that is the grid's chance.
    nearly = needed <= least_friction + _LEAST_FRICTION_TOLERANCE
    curves = xarray.Dataset(
        {
            "steepest_slope": slope.where(feasible).max("slope"),
            "steepest_slope_best_thrust": steepest_free,
            "best_thrust": _argument(there["friction_needed"].where(there["feasible"]), "thrust"),
            "least_friction": least_friction,
            "thrust_of_least_friction": _argument(dataset["thrust"].where(nearly), "thrust"),
            "power_of_least_friction": power.where(nearly).isel(thrust=_first(nearly)),
            "least_power": allowed_power.min("thrust"),
            "thrust_of_least_power": _argument(allowed_power, "thrust"),
        }
    ).drop_vars(["branch"], errors="ignore")
    for name, (unit, meaning) in _MEANINGS.items():
        curves[name].attrs.update(units=unit, long_name=meaning)
    curves.attrs.update(dataset.attrs, kind="static curves")
    return curves


#: Of the thrusts that need no more than this above the least friction, the smallest is taken.
_LEAST_FRICTION_TOLERANCE = 0.01

_MEANINGS = {
    "steepest_slope": ("rad", "steepest slope with this thrust"),
    "steepest_slope_best_thrust": ("rad", "steepest slope with the best thrust"),
    "best_thrust": ("N", "thrust that needs the least friction on the steepest slope"),
    "least_friction": ("1", "least friction coefficient with the best thrust"),
    "thrust_of_least_friction": ("N", "thrust that needs the least friction"),
    "power_of_least_friction": ("W", "power at the thrust that needs the least friction"),
    "least_power": ("W", "least power within all limits"),
    "thrust_of_least_power": ("N", "thrust of the least power"),
}


def _first(condition: xarray.DataArray) -> xarray.DataArray:
    """Index of the first thrust at which a condition holds; 0 where it holds nowhere."""
    return condition.argmax("thrust")


def _argument(values: xarray.DataArray, dimension: str) -> xarray.DataArray:
    """Coordinate of the smallest value along a dimension; NaN where there is none."""
    some = values.notnull().any(dimension)
    index = values.fillna(np.inf).argmin(dimension)
    return values[dimension][index].drop_vars(dimension).where(some)
