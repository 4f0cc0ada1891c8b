"""Closed-loop maps: rollouts over slope, thrust and friction, beside what the statics say."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError, ResultFileError
from m4_dynamics.feasibility.cell import FIELDS, VERDICT_FIELDS, VERDICTS, CellIndex, RolloutSettings
from m4_dynamics.feasibility.disagreement import EFFECTS, explain
from m4_dynamics.feasibility.grid import AXIS_UNITS, MapGrid
from m4_dynamics.feasibility.postures import posture_case
from m4_dynamics.feasibility.provenance import robot_provenance
from m4_dynamics.feasibility.refinement import refine_boundary
from m4_dynamics.feasibility.rollout import RolloutJob
from m4_dynamics.feasibility.static import best_branch, static_map
from m4_dynamics.feasibility.store import SweepStore, create_store, open_store, remove_store
from m4_dynamics.feasibility.sweep import open_sweep, run_sweep
from m4_dynamics.reduced.reduction import reduce_robot
from m4_dynamics.robot.robot import Robot

if TYPE_CHECKING:
    import xarray

__all__ = ["closed_loop_dataset", "job_of_store", "make_job", "run_closed_loop"]

_Array = NDArray[np.float64]
_Bool = NDArray[np.bool_]


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
    return RolloutJob(robot, reduce_robot(robot), dataclasses.replace(grid, speed=settings.speed), settings)


def identity(job: RolloutJob) -> dict[str, Any]:
    """What all records of a job share, as plain values."""
    provenance = robot_provenance(job.robot)
    provenance.pop("command")
    return {"provenance": provenance, "grid": job.grid.as_dict(), "settings": job.settings.as_dict()}


def run_closed_loop(
    job: RolloutJob,
    path: Path,
    *,
    resume: bool = False,
    force: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> SweepStore:
    """Run all cells that the store does not have yet.

    Args:
        job: The job.
        path: Folder of the Zarr store.
        resume: Whether to go on with a store that is there.
        force: Whether to replace a store that is there.
        workers: See `open_sweep`.
        scheduler: See `open_sweep`.
        on_progress: Called with the number of cells done, those of the store included.

    Returns:
        The store, complete; in an adaptive map as far as the boundary needs it.

    Raises:
        ResultFileError: A store is there and neither `resume` nor `force` is given, it is of something else, or it
            cannot be written.
        SchedulerError, InvalidSettingError: See `open_sweep`.
    """
    what = identity(job)
    if path.exists() and resume:
        store = open_store(path, what)
    else:
        if path.exists() and not force:
            raise ResultFileError(f"{path} exists already; go on with --resume, or use --force to replace it")
        remove_store(path)
        store = create_store(path, job.grid.axes, job.settings.starts, what)
    missing = store.missing()
    before = int(np.prod(store.shape)) - len(missing)
    if on_progress is not None:
        on_progress(before)
    if not missing:
        return store
    with open_sweep(job, workers=workers, scheduler=scheduler) as run:

        def run_missing(cells: Sequence[CellIndex]) -> None:
            nonlocal before
            run_sweep(
                run,
                cells,
                store.write,
                on_progress=None if on_progress is None else lambda done: on_progress(before + done),
            )
            before += len(cells)

        if job.settings.adaptive:
            for friction in range(store.shape[0]):
                _refine(store, friction, run_missing)
        else:
            run_missing(missing)
    return store


def _refine(store: SweepStore, friction: int, run_missing: Callable[[Sequence[CellIndex]], None]) -> _Bool:
    """Where the robot climbs at one friction, shape (slope, thrust); only cells near the boundary are run."""
    starts, verdict = store.shape[-1], list(FIELDS).index("verdict")

    def evaluate(places: Sequence[tuple[int, int]]) -> list[bool]:
        verdicts = store.read()[friction, ..., verdict]
        cells = [CellIndex(friction, *place, start) for place in places for start in range(starts)]
        missing = [index for index in cells if np.isnan(verdicts[index[1:]])]
        if missing:
            run_missing(missing)
            verdicts = store.read()[friction, ..., verdict]
        return [bool((verdicts[place] == 0.0).all()) for place in places]

    return refine_boundary((store.shape[1], store.shape[2]), evaluate).answer


def _nothing_missing(cells: Sequence[CellIndex]) -> None:
    raise ResultFileError(f"the store lacks {len(cells)} rollouts; finish it with --resume")


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
    grid: dict[str, Any] = {
        name: np.nan if values == [None] else values
        for name, values in store.identity["grid"].items()
        if name in AXIS_UNITS
    }
    job = make_job(robot, MapGrid(**grid), RolloutSettings(**store.identity["settings"]))
    open_store(store.path, identity(job))
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
    axes = job.grid.axes
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
    if job.settings.adaptive:
        climbs = np.stack([_refine(store, m, _nothing_missing) for m in range(store.shape[0])])
    else:
        climbs = (variables["verdict"][1] == 0).all(axis=-1)
    variables["climbs"] = (cell, climbs, {"units": "1", "long_name": "every start climbed"})
    coordinates: dict[str, Any] = {
        name: ((name,), axes[name], {"units": AXIS_UNITS[name][0], "long_name": AXIS_UNITS[name][1]}) for name in cell
    }
    coordinates["start"] = (("start",), np.arange(job.settings.starts), {"long_name": "number of the start"})
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
        settings=json.dumps(job.settings.as_dict()),
        plant=job.settings.plant,
        thrust_max=job.reduction.thrust_max,
    )
    return dataset
