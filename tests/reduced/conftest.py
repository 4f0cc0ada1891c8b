"""Shared figures of the reduced-model tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.reduction import Reduction, reduce_robot
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot


@pytest.fixture(scope="session")
def hand_pendulum() -> MipParameters:
    """M4 in MIP posture, by hand from its mass table."""
    return MipParameters(
        mass_body=5.095,
        mass_wheel=0.905,
        inertia_body=0.305,
        inertia_wheel=0.004,
        com_in_body=(0.021, 0.447),
        thrust_point_in_body=(0.114, 0.744),
        wheel_radius=0.125,
        torque_constant=6.0,
        back_emf_constant=0.4,
    )


@pytest.fixture
def rng() -> np.random.Generator:
    """Seeded random numbers."""
    return np.random.default_rng(20240607)


@pytest.fixture(scope="session")
def m4() -> Robot:
    """The bundled robot."""
    return load_robot()


@pytest.fixture(scope="session")
def m4_reduction(m4: Robot) -> Reduction:
    """The bundled robot's pendulum."""
    return reduce_robot(m4)


@pytest.fixture(scope="session")
def scooter_description() -> Path:
    """A thrusterless two-wheeler whose wheel axes point opposite ways."""
    return Path(__file__).parents[1] / "data" / "scooter" / "scooter.toml"
