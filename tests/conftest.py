"""Fixtures that every test may use."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# The same examples in every run: a suite that fails now and then is no help. Slow machines are no failure either.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def require_peer() -> Callable[[str], Any]:
    """Import a package that only comparisons need.

    Where it is missing the test is skipped, so that a light installation can be tested; under CI=true that is a
    failure, or a comparison could go missing without anybody noticing.
    """

    def import_or_skip(name: str) -> Any:
        try:
            return importlib.import_module(name)
        except ImportError as error:
            reason = f"{name} is not installed ({error}); the extra 'peers' brings it"
            if os.environ.get("CI") == "true":
                pytest.fail(reason)
            pytest.skip(reason)

    return import_or_skip


@pytest.fixture(scope="session")
def example_robots() -> Path:
    """The folder of example-robot-data's robots, skipped or failed like a peer where it is missing."""
    from importlib import metadata

    try:
        distribution = metadata.distribution("example-robot-data")
    except metadata.PackageNotFoundError:
        reason = "example-robot-data is not installed; the extra 'peers' brings it"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    return Path(str(distribution.locate_file("cmeel.prefix/share/example-robot-data/robots")))


SHORT_MISSION = """
name = "short"
[start]
posture = "mip_sitting"
distance_to_foot_m = 0.9
[terrain]
profile = "ramp"
slope_deg = 20.0
length_m = 3.0
[[phase]]
name = "settle"
kind = "morph"
posture = "mip_sitting"
duration_s = 1.0
[[phase]]
name = "raise"
kind = "raise"
duration_s = 3.0
[[phase]]
name = "approach"
kind = "balance"
controller = "pid"
to_m = -0.5
settle_s = 0.5
hold_s = 0.3
[[phase]]
name = "climb"
kind = "balance"
to_m = 0.7
settle_s = 0.5
hold_s = 0.3
[[phase]]
name = "back"
kind = "balance"
to_m = -0.7
speed_m_s = 0.5
settle_s = 0.3
hold_s = 0.5
[[phase]]
name = "sit"
kind = "sit"
duration_s = 3.0
"""


@pytest.fixture(scope="session")
def mission_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the trajectory of a short mission of all kinds of phases, run once a session."""
    from m4_dynamics.mission.loading import parse_mission
    from m4_dynamics.mission.runner import run_mission
    from m4_dynamics.robot.loading import load_robot
    from m4_dynamics.simulation.trajectory import save_trajectory

    folder = tmp_path_factory.mktemp("mission")
    result = run_mission(load_robot(), parse_mission(SHORT_MISSION, folder / "short.toml"))
    assert result.summary.verdict == "completed", result.summary.reason
    save_trajectory(result.dataset, folder / "trajectory.nc")
    return folder


@pytest.fixture(scope="session")
def mission_run(mission_folder: Path) -> Any:
    """The trajectory of the short mission, read back from its file."""
    from m4_dynamics.simulation.trajectory import load_trajectory

    return load_trajectory(mission_folder)
