"""Many climbs, one after the other in each of a few processes."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import ClimbSettings, run_climb
from m4_dynamics.simulation.verdict import ClimbSummary

__all__ = ["run_climbs"]


def run_climbs(
    settings: Sequence[ClimbSettings], *, description: Path | None = None, workers: int | None = None
) -> list[ClimbSummary]:
    """Climb with each of several settings and keep the figures alone.

    The result does not depend on the number of processes. A script that calls this must do so under
    `if __name__ == "__main__"`, as processes are started afresh.

    Args:
        settings: What to climb.
        description: The robot's description; the bundled M4 when None.
        workers: Number of processes; as many as there are processors when None; 1 climbs in this process.

    Returns:
        A summary for each, in their order.

    Raises:
        InvalidSettingError: The number of processes is below 1.
        M4Error: The robot or the settings cannot be used.
    """
    count = (os.cpu_count() or 1) if workers is None else workers
    if count < 1:
        raise InvalidSettingError("workers", workers, "a whole number >= 1")
    jobs = [(description, one) for one in settings]
    if min(count, len(jobs)) <= 1:
        return [_climb(job) for job in jobs]
    # Forking a process that runs threads is not safe, and those of the linear algebra are running already.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=min(count, len(jobs)), mp_context=context) as pool:
        return list(pool.map(_climb, jobs))


@cache
def _robot(description: Path | None) -> Robot:
    return load_robot(description)


def _climb(job: tuple[Path | None, ClimbSettings]) -> ClimbSummary:
    description, settings = job
    return run_climb(_robot(description), settings).summary
