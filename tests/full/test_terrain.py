"""The terrain's profile: heights, slopes, segments, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from m4_dynamics.errors import InvalidSettingError, M4Error, NonFiniteError
from m4_dynamics.full.terrain import (
    SEGMENT_COLUMNS,
    Terrain,
    flat_terrain,
    incline_terrain,
    plateau_terrain,
    ramp_terrain,
)

slopes = st.floats(-1.4, 1.4)


def test_level_ground() -> None:
    assert flat_terrain().height_at(123.0) == 0.0
    assert flat_terrain().slope_at(-5.0) == 0.0


@given(slope=slopes, x=st.floats(-100.0, 100.0))
def test_an_incline_is_endless_and_goes_through_the_origin(slope: float, x: float) -> None:
    terrain = incline_terrain(slope)
    assert terrain.height_at(x) == pytest.approx(x * math.tan(slope), rel=1e-9, abs=1e-9)
    assert terrain.slope_at(x) == pytest.approx(slope, abs=1e-12)


@given(slope=st.floats(0.01, 1.4), x=st.floats(-50.0, 50.0))
def test_a_plateau_is_level_rising_level(slope: float, x: float) -> None:
    length = 4.0
    foot, top = 0.0, length * math.cos(slope)
    terrain = plateau_terrain(slope, length=length)
    expected = math.tan(slope) * min(max(x, foot), top)
    assert terrain.height_at(x) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    if min(abs(x - foot), abs(x - top)) > 1e-9:
        assert terrain.slope_at(x) == pytest.approx(slope if foot < x < top else 0.0, abs=1e-12)


@given(slope=slopes)
def test_segments_carry_orthonormal_axes(slope: float) -> None:
    terrain = ramp_terrain(slope)
    assert terrain.segments.shape == (2, len(SEGMENT_COLUMNS))
    columns = dict(zip(SEGMENT_COLUMNS, terrain.segments.T, strict=True))
    tangent = np.stack((columns["tangent_x"], columns["tangent_z"]))
    normal = np.stack((columns["normal_x"], columns["normal_z"]))
    np.testing.assert_allclose(np.sum(tangent * normal, axis=0), 0.0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=0), 1.0, atol=1e-15)
    assert (normal[1] > 0.0).all()
    start = np.stack((columns["start_x"], columns["start_z"]))
    np.testing.assert_allclose((start + columns["length"] * tangent).T, terrain.profile_in_world[1:], atol=1e-12)
    np.testing.assert_allclose(start.T, terrain.profile_in_world[:-1], atol=1e-15)


def test_a_terrain_cannot_be_changed() -> None:
    profile = np.array([[0.0, 0.0], [1.0, 0.0]])
    terrain = Terrain(profile)
    with pytest.raises(ValueError, match="read-only"):
        terrain.segments[0, 0] = 1.0
    profile[0, 1] = 5.0
    assert terrain.height_at(0.0) == 0.0


@pytest.mark.parametrize(
    ("profile", "scale", "error", "message"),
    [
        (np.zeros((1, 2)), None, InvalidSettingError, r"shape.*\(n, 2\)"),
        (np.zeros((3, 3)), None, InvalidSettingError, r"shape.*\(n, 2\)"),
        (np.array([[0.0, 0.0], [0.0, 1.0]]), None, InvalidSettingError, "strictly increasing"),
        (np.array([[1.0, 0.0], [0.0, 0.0]]), None, InvalidSettingError, "strictly increasing"),
        (np.array([[0.0, 0.0], [np.nan, 0.0]]), None, NonFiniteError, "terrain profile"),
        (np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([1.0, 1.0]), InvalidSettingError, "friction scale.*1 values"),
        (np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([-0.5]), InvalidSettingError, "friction scale"),
        (np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([np.inf]), NonFiniteError, "friction scale"),
    ],
)
def test_invalid_profiles_are_refused(
    profile: np.ndarray, scale: np.ndarray | None, error: type[M4Error], message: str
) -> None:
    with pytest.raises(error, match=message):
        Terrain(profile, scale)


@pytest.mark.parametrize("slope", [math.radians(90.0), -2.0, math.nan, math.inf])
def test_faces_that_are_no_function_of_x_are_refused(slope: float) -> None:
    for build in (incline_terrain, ramp_terrain, plateau_terrain):
        with pytest.raises(InvalidSettingError, match="slope"):
            build(slope)


def test_negative_lengths_are_refused() -> None:
    with pytest.raises(InvalidSettingError, match="strictly increasing"):
        incline_terrain(0.3, above=-2.0)
    with pytest.raises(InvalidSettingError, match="strictly increasing"):
        plateau_terrain(0.3, length=-1.0)
