"""Closed-loop maps: rollouts over slope, thrust and friction, beside what the statics say."""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from m4_dynamics.errors import InvalidSettingError, ResultFileError
from m4_dynamics.feasibility.cell import FIELDS, VERDICT_FIELDS, VERDICTS, RolloutSettings
from m4_dynamics.feasibility.disagreement import EFFECTS, explain
from m4_dynamics.feasibility.grid import AXIS_UNITS, MapGrid
from m4_dynamics.feasibility.postures import posture_case
from m4_dynamics.feasibility.provenance import robot_provenance
from m4_dynamics.feasibility.rollout import RolloutJob
from m4_dynamics.feasibility.run import settled_answer
from m4_dynamics.feasibility.static import best_branch, static_map
from m4_dynamics.feasibility.store import SweepStore, open_store
from m4_dynamics.reduced.reduction import reduce_robot
from m4_dynamics.robot.robot import Robot

if TYPE_CHECKING:
    import xarray

__all__ = ["closed_loop_dataset", "job_of_store", "make_job"]


def make_job(robot: Robot, grid: MapGrid, settings: RolloutSettings) -> RolloutJob:
    """Put together what workers need.

    Args:
        robot: A robot that balances.
        grid: The axes; of speed a single value, that of the settings.
        settings: What the cells share.

    Returns:
        The job.

    Raises:
        InvalidSettingError: The grid has an axis that rollouts do not have.
        RobotDescriptionError: The robot does not balance.
    """
    if grid.posture_joints:
        raise InvalidSettingError("posture_angle", "an axis", "a static map for postures")
    return RolloutJob(
        robot.without_visuals(), reduce_robot(robot), dataclasses.replace(grid, speed=settings.speed), settings
    )


def job_of_store(store: SweepStore, robot: Robot) -> RolloutJob:
    """The job that a store's records are of.

    Args:
        store: The store.
        robot: The robot that it names.

    Returns:
        The job.

    Raises:
        ResultFileError: The robot is another one.
    """
    if store.kind != "closed-loop":
        raise ResultFileError(f"{store.path} is the store of another kind of map: {store.kind}, not closed-loop")
    grid: dict[str, Any] = {
        name: np.nan if values == [None] else values
        for name, values in store.identity["grid"].items()
        if name in AXIS_UNITS
    }
    job = make_job(robot, MapGrid(**grid), RolloutSettings(**store.identity["settings"]))
    open_store(store.path, job)
    return job


def closed_loop_dataset(store: SweepStore, job: RolloutJob, *, command: str = "") -> xarray.Dataset:
    """Label a store's records, and set the statics beside them.

    Args:
        store: The store; cells that are missing are NaN, their verdict is -1.
        job: The job.
        command: The command line, for the record.

    Returns:
        The map, dimensions (friction, slope, thrust, start). Besides the figures of `FIELDS`: `static_feasible`,
        `static_limit`, `friction_needed` of the equilibrium; `climbs`: all starts climbed, in an adaptive map
        concluded from the cells around where nothing was run; `disagreement`: the effect
        that sets statics and rollouts apart, see `disagreement.EFFECTS`.
    """
    import xarray

    records = store.read()
    dimensions = ("friction", "slope", "thrust", "start")
    variables: dict[str, Any] = {}
    for k, (name, field) in enumerate(FIELDS.items()):
        values: Any = records[..., k]
        attributes: dict[str, Any] = {"units": field.unit, "long_name": field.meaning}
        if name in VERDICT_FIELDS:
            values = np.where(np.isnan(values), -1, values).astype(np.int8)
            attributes["flag_values"] = list(range(len(VERDICTS)))
            attributes["flag_meanings"] = " ".join(VERDICTS)
        variables[name] = (dimensions, values, attributes)
    static = best_branch(static_map([posture_case(job.robot, job.reduction)], job.grid))
    static = static.isel(posture_angle=0, speed=0, drop=True)
    cell = dimensions[:3]
    for name, source, meaning in (
        ("static_feasible", "feasible", "an equilibrium within all limits exists"),
        ("static_limit", "active_limit", static["active_limit"].attrs["long_name"]),
        ("friction_needed", "friction_needed", "friction coefficient that the equilibrium needs"),
    ):
        values = static[source].broadcast_like(static["feasible"]).transpose(*cell).to_numpy()
        variables[name] = (cell, values, {**static[source].attrs, "long_name": meaning})
    climbs = settled_answer(job, store)
    variables["climbs"] = (cell, climbs, {"units": "1", "long_name": "every start climbed"})
    coordinates: dict[str, Any] = {
        name: ((name,), axis.values, {"units": axis.unit, "long_name": axis.meaning})
        for name, axis in job.store_axes.items()
    }
    dataset = xarray.Dataset(variables, coordinates)
    dataset["disagreement"] = (
        cell,
        explain(dataset, job.reduction, job.settings),
        {
            "units": "1",
            "long_name": "effect that sets statics and rollouts apart",
            "flag_values": list(range(len(EFFECTS))),
            "flag_meanings": " ".join(EFFECTS),
        },
    )
    dataset.attrs.update(
        robot_provenance(job.robot, command=command),
        kind="closed-loop",
        fingerprint=store.fingerprint,
        settings=json.dumps(job.settings.as_dict()),
        plant=job.settings.plant,
        thrust_max=job.reduction.thrust_max,
    )
    return dataset
