"""Many rollouts on many processors: Dask's workers compute, this process alone writes."""

from __future__ import annotations

import logging
import os
import pickle
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from m4_dynamics import __version__
from m4_dynamics.errors import InvalidSettingError, SchedulerError
from m4_dynamics.feasibility.job import Place, Record, SweepJob

__all__ = ["Runner", "open_sweep", "run_sweep", "workers_by_default"]

#: Runs places, and yields each with its record.
Runner = Callable[[Sequence[Place]], Iterable[Record]]

#: A worker that dies takes its task along; the task is given to another one this many times.
_DEATHS_ALLOWED = 3
_CONNECT_TIMEOUT = 10.0


def workers_by_default() -> int:
    """As many workers as this process may use processors."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def open_sweep(job: SweepJob, *, workers: int | None = None, scheduler: str | None = None) -> Iterator[Runner]:
    """Make workers ready for a job.

    Args:
        job: What all places share.
        workers: Worker processes on this machine; None takes one for each processor, 0 computes in this process.
        scheduler: Address of a Dask scheduler, "tcp://host:port", instead of workers of this machine.

    Yields:
        A function that runs places and yields each record as it comes, in whatever order; it may be called again.

    Raises:
        SchedulerError: The scheduler cannot be reached, has no workers or other software, or workers keep dying.
        InvalidSettingError: The number of workers or the address is not valid.
    """
    count = workers_by_default() if workers is None else workers
    if not 0 <= count <= 1024:
        raise InvalidSettingError("workers", workers, "a whole number from 0 to 1024")
    size = job.batch

    def batches(places: Sequence[Place]) -> list[list[Place]]:
        return [list(places[k : k + size]) for k in range(0, len(places), size)]

    if count == 0 and scheduler is None:
        yield lambda places: (record for batch in batches(places) for record in job.run(batch))
        return
    with _client(count, scheduler) as client:
        # A task that unpickles the job, and not data sent ahead: if every worker that holds it dies, it is made anew.
        shared = client.submit(pickle.loads, pickle.dumps(job), pure=False)
        yield lambda places: _on_cluster(client, shared, batches(places))


def run_sweep(
    run: Runner,
    places: Sequence[Place],
    write: Callable[[Place, Any], None],
    *,
    on_progress: Callable[[int], None] | None = None,
) -> None:
    """Run places and hand over each record as it comes.

    Args:
        run: From `open_sweep`.
        places: The places.
        write: Called in this process, once for each place.
        on_progress: Called with the number of places done.

    Raises:
        SchedulerError: Workers keep dying.
    """
    for done, (place, record) in enumerate(run(places), start=1):
        write(place, record)
        if on_progress is not None:
            on_progress(done)


def _run_batch(job: SweepJob, places: Sequence[Place]) -> list[Record]:
    """Run by a worker."""
    return job.run(places)


def _on_cluster(client: Any, shared: Any, batches: Sequence[list[Place]]) -> Iterator[Record]:
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    futures = [client.submit(_run_batch, shared, batch, pure=False) for batch in batches]
    try:
        # Without its loop, `as_completed` takes that of the caller's current client, which another one may be; waiting
        # for a result that a dying worker took along then fails, as an event cannot be waited for in two loops.
        for future in as_completed(futures, loop=client.loop):
            yield from future.result()
            future.release()
    except KilledWorker as error:
        raise SchedulerError(
            f"workers died {_DEATHS_ALLOWED + 1} times on the same rollout; what is done is kept: {error}"
        ) from error
    finally:
        client.cancel(futures)


@contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Any]:
    """Workers of this machine, or those of a running scheduler."""
    import dask
    from distributed import Client, LocalCluster

    settings = {
        "distributed.scheduler.allowed-failures": _DEATHS_ALLOWED,
        "distributed.comm.timeouts.connect": f"{_CONNECT_TIMEOUT:g}s",
        "distributed.logging.distributed": "error",
        "distributed.admin.log-length": 0,
    }
    with dask.config.set(settings):
        if scheduler is None:
            with (
                LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    memory_limit=0,
                    silence_logs=logging.CRITICAL,
                ) as cluster,
                Client(cluster) as client,
            ):
                yield client
            return
        try:
            # As the default client, one that never connected would be asked for a lock when a map is written.
            client = Client(scheduler, timeout=_CONNECT_TIMEOUT, set_as_default=False)
        except (OSError, TimeoutError) as error:
            raise SchedulerError(f"cannot reach the scheduler {scheduler}: {error}") from error
        except ValueError as error:
            raise InvalidSettingError("scheduler", scheduler, "an address such as tcp://host:8786") from error
        try:
            _require_same_software(client, scheduler)
            yield client
        finally:
            client.close()


def _require_same_software(client: Any, scheduler: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_CONNECT_TIMEOUT)
    except TimeoutError as error:
        raise SchedulerError(f"the scheduler {scheduler} has no workers; start some with `dask worker`") from error
    try:
        versions = client.run(_version)
    except ModuleNotFoundError as error:
        raise SchedulerError(f"a worker of {scheduler} does not have this package: {error}") from error
    other = {worker: version for worker, version in versions.items() if version != __version__}
    if other:
        worker, version = next(iter(other.items()))
        raise SchedulerError(f"worker {worker} has version {version} of this package, {__version__} is needed")


def _version() -> str:
    """Run by a worker: the version that it has."""
    return __version__
