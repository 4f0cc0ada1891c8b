"""Run a sweep into its store: what is there is kept, what is missing is computed, all of it or the boundary alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.errors import ResultFileError
from m4_dynamics.feasibility.job import OnProgress, Place, SweepJob
from m4_dynamics.feasibility.refinement import refine_boundary
from m4_dynamics.feasibility.store import SweepStore, create_store, open_store
from m4_dynamics.feasibility.sweep import open_sweep, run_sweep

__all__ = ["run_job", "settled_answer"]

_Array = NDArray[np.float64]
_Bool = NDArray[np.bool_]


def run_job(
    job: SweepJob,
    path: Path,
    *,
    resume: bool = False,
    force: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    on_progress: OnProgress | None = None,
) -> SweepStore:
    """Run all that the store does not have yet.

    Args:
        job: The job.
        path: Folder of the Zarr store.
        resume: Whether to go on with a store that is there.
        force: Whether to replace a store that is there.
        workers: See `open_sweep`.
        scheduler: See `open_sweep`.
        on_progress: Called with the number of rollouts done, those of the store included, and of those expected in
            all: of an adaptive map that becomes clear on the way.

    Returns:
        The store, complete; of an adaptive map as far as the boundary needs it.

    Raises:
        ResultFileError: A store is there and neither `resume` nor `force` is given, it is of something else, or it
            cannot be written.
        SchedulerError, InvalidSettingError: See `open_sweep`.
    """
    going_on = path.exists() and resume
    if going_on:
        there = open_store(path, job)
        if not there.missing():
            if on_progress is not None:
                on_progress(there.size, there.size)
            return there
    elif path.exists() and not force:
        raise ResultFileError(f"{path} exists already; go on with --resume, or use --force to replace it")
    # The workers first: without them a store that is there is not replaced.
    with open_sweep(job, workers=workers, scheduler=scheduler) as run:
        store = there if going_on else create_store(path, job, replace=force)
        records, missing = store.read(), store.missing()
        done, expected = store.size - len(missing), store.size

        def report() -> None:
            if on_progress is not None:
                on_progress(done, max(expected, done))

        def write(place: Place, record: _Array) -> None:
            nonlocal done
            store.write(place, record)
            records[place] = record
            done += 1
            report()

        def run_missing(places: Sequence[Place]) -> None:
            run_sweep(run, places, write)

        report()
        if not job.adaptive:
            run_missing(missing)
            return store
        layers, starts, before = store.shape[0], store.shape[-1], 0
        for layer in range(layers):

            def plan(places: int, first: int = layer, counted: int = before) -> None:
                nonlocal expected
                expected = counted + places * starts * (layers - first)
                report()

            before += starts * int(_refine(job, records, layer, run_missing, on_plan=plan)[1].sum())
    return store


def settled_answer(job: SweepJob, store: SweepStore) -> _Bool:
    """Where every start succeeded; in an adaptive map concluded from the surroundings where nothing was run.

    Args:
        job: The job.
        store: Its store.

    Returns:
        Shape (layers, rows, columns); False where rollouts are missing.

    Raises:
        ResultFileError: An adaptive map lacks rollouts that its boundary needs.
    """
    records = store.read()
    if not job.adaptive:
        return np.asarray(job.succeeded(records).all(axis=-1))
    return np.stack([_refine(job, records, layer, _nothing_missing)[0] for layer in range(store.shape[0])])


def _refine(
    job: SweepJob,
    records: _Array,
    layer: int,
    run_missing: Callable[[Sequence[Place]], None],
    *,
    on_plan: Callable[[int], None] | None = None,
) -> tuple[_Bool, _Bool]:
    """Answer and cells evaluated in one layer; only cells near the boundary are run, and their records set."""
    starts = records.shape[-2]

    def evaluate(cells: Sequence[tuple[int, int]]) -> list[bool]:
        places = [(layer, *cell, start) for cell in cells for start in range(starts)]
        missing = [place for place in places if np.isnan(records[place][0])]
        if missing:
            run_missing(missing)
        return [bool(job.succeeded(records[layer, row, column]).all()) for row, column in cells]

    refined = refine_boundary((records.shape[1], records.shape[2]), evaluate, on_plan=on_plan)
    return refined.answer, refined.evaluated


def _nothing_missing(places: Sequence[Place]) -> None:
    raise ResultFileError(f"the store lacks {len(places)} rollouts; finish it with --resume")
