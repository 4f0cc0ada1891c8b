"""The wheel's way over corners, against geometry and against a wheel that rolls on the full model's contacts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.full.axle_path import AxlePath
from m4_dynamics.full.terrain import Terrain, flat_terrain, incline_terrain, plateau_terrain, ramp_terrain

R = 0.125


def distance_to_terrain(terrain: Terrain, point: np.ndarray) -> float:
    segments = terrain.segments
    best = math.inf
    for k, (ax, az, tx, tz, _, _, length) in enumerate(segments[:, :7]):
        along = (point[0] - ax) * tx + (point[1] - az) * tz
        low, high = (-math.inf if k == 0 else 0.0), (math.inf if k == len(segments) - 1 else length)
        along = min(max(along, low), high)
        best = min(best, math.hypot(point[0] - ax - along * tx, point[1] - az - along * tz))
    return best


TERRAINS = [
    flat_terrain(),
    incline_terrain(0.6),
    ramp_terrain(math.radians(45.0)),
    plateau_terrain(math.radians(45.0), length=2.0),
    Terrain(np.array([[-2.0, 0.3], [-1.0, 0.0], [0.0, 0.0], [1.0, 0.8], [2.0, 0.4], [3.0, 1.9]])),
]


@pytest.mark.parametrize("terrain", TERRAINS)
@given(length=st.floats(-4.0, 8.0))
def test_the_wheel_touches_the_ground_everywhere(terrain, length):
    path = AxlePath.over(terrain, R)
    assert distance_to_terrain(terrain, path.point_at(length)) == pytest.approx(R, abs=1e-9)


@pytest.mark.parametrize("terrain", TERRAINS)
@given(length=st.floats(-4.0, 8.0))
def test_length_and_point_are_inverse(terrain, length):
    path = AxlePath.over(terrain, R)
    assert path.length_at(path.point_at(length)) == pytest.approx(length, abs=1e-7)


@pytest.mark.parametrize("terrain", TERRAINS)
def test_arc_length_and_slope_are_those_of_the_curve(terrain):
    path = AxlePath.over(terrain, R)
    lengths = np.arange(-3.0, 6.0, 1e-4)
    points = np.array([path.point_at(float(length)) for length in lengths])
    steps = np.diff(points, axis=0)
    # A chord over a concave corner is shorter than the way round it; everywhere else the curve has unit speed.
    speed = np.linalg.norm(steps, axis=1) / 1e-4
    assert (speed < 1.0 + 1e-9).all()
    corner = np.abs(speed - 1.0) > 1e-6
    assert corner.sum() <= len(terrain.segments)
    direction = np.arctan2(steps[:, 1], steps[:, 0])
    middle = path.slope_at(lengths[:-1] + 5e-5)
    np.testing.assert_allclose(direction[~corner], middle[~corner], atol=1e-3)


def test_zero_is_the_foot_of_the_ramp():
    path = AxlePath.over(ramp_terrain(math.radians(45.0)), R)
    np.testing.assert_allclose(path.point_at(0.0), [-R * math.tan(math.radians(22.5)), R], atol=1e-12)
    assert path.slope_at(-1e-9) == 0.0
    assert path.slope_at(1e-9) == pytest.approx(math.radians(45.0))


def test_corners_too_near_each_other_are_refused():
    valley = Terrain(np.array([[-1.0, 1.0], [0.0, 0.0], [0.05, 0.0], [1.0, 1.0]]))
    with pytest.raises(InvalidSettingError, match="room for the wheel"):
        AxlePath.over(valley, R)
