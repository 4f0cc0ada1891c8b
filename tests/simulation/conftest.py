"""Robots and runs shared by the closed-loop tests."""

from __future__ import annotations

import math
from functools import cache

import pytest

from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import ClimbResult, ClimbSettings, run_climb


@cache
def _bundled() -> Robot:
    return load_robot()


@cache
def _climb(slope_deg: float, pitch_error_deg: float, controller: str, changes: tuple[tuple[str, object], ...]):
    settings = ClimbSettings(
        slope=math.radians(slope_deg),
        pitch_error=math.radians(pitch_error_deg),
        controller=controller,  # type: ignore[arg-type]
        **dict(changes),  # type: ignore[arg-type]
    )
    return run_climb(_bundled(), settings)


@pytest.fixture(scope="session")
def m4() -> Robot:
    return _bundled()


@pytest.fixture(scope="session")
def climb():
    """Run a climb of the bundled robot once for all tests that ask for it."""

    def run(slope_deg: float, pitch_error_deg: float = 0.0, controller: str = "default", **changes) -> ClimbResult:
        return _climb(slope_deg, pitch_error_deg, controller, tuple(sorted(changes.items())))

    return run
