"""The static map is as quick as it has to be."""

from __future__ import annotations

from time import process_time

import numpy as np

from m4_dynamics.bench.suite import bench_static_map
from m4_dynamics.robot.loading import load_robot


def test_a_million_cells_take_less_than_a_second_of_processor_time() -> None:
    """Time of the processor and not of the clock: a busy machine does not count."""
    robot = load_robot()
    spent = []

    def count(done: float) -> None:
        spent.append(process_time())

    times = bench_static_map(robot, rounds=3, on_progress=count)
    assert times.later.shape == (3,)
    assert times.first > 0.0
    assert np.diff(spent).min() < 1.0
