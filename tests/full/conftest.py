"""What the tests of the full model share."""

from __future__ import annotations

import numpy as np
import pytest

from m4_dynamics.full.model import FullModel
from m4_dynamics.full.terrain import Terrain
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot


@pytest.fixture
def rng() -> np.random.Generator:
    """Seeded random numbers."""
    return np.random.default_rng(20240611)


@pytest.fixture(scope="session")
def m4() -> Robot:
    """The bundled robot."""
    return load_robot()


@pytest.fixture(scope="session")
def m4_on_ground(m4: Robot) -> FullModel:
    """M4 on level ground."""
    return FullModel.build(m4)


@pytest.fixture(scope="session")
def m4_in_air(m4: Robot) -> FullModel:
    """M4 with the ground a kilometre below."""
    return FullModel.build(m4, Terrain(np.array([[-1.0, -1000.0], [1.0, -1000.0]])))
