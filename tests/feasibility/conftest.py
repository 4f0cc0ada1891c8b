"""Robots shared by the tests of maps."""

from __future__ import annotations

from pathlib import Path

import pytest

from m4_dynamics.reduced.reduction import Reduction, reduce_robot
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot


@pytest.fixture(scope="session")
def m4() -> Robot:
    return load_robot()


@pytest.fixture(scope="session")
def m4_reduction(m4: Robot) -> Reduction:
    return reduce_robot(m4)


@pytest.fixture(scope="session")
def scooter() -> Robot:
    """A robot without thrusters."""
    return load_robot(Path(__file__).parents[1] / "data" / "scooter" / "scooter.toml")
