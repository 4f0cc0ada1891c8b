"""Shared figures of the reduced-model tests."""

from __future__ import annotations

import numpy as np
import pytest

from m4_dynamics.reduced.pendulum import MipParameters


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
