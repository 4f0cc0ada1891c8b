"""The parts of the scene: arrows, ground, motions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.view.arrows import HIDDEN_SCALE, arrow_motions, round_scale
from m4_dynamics.view.ground import clip_profile, ground_commands, tile_profile
from m4_dynamics.view.motion import Motion, motion_matrix, quaternions_onto

component = st.floats(-50.0, 50.0)


@given(st.lists(st.tuples(component, component, component), min_size=1, max_size=8))
def test_rotations_turn_z_onto_the_direction(directions: list[tuple[float, float, float]]) -> None:
    vectors = np.array(directions)
    quaternions = quaternions_onto(vectors)
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0)
    for index, vector in enumerate(vectors):
        turned = motion_matrix(Motion("/node", quaternion=quaternions), index)[:3, 2]
        if np.linalg.norm(vector) > 1e-6:
            np.testing.assert_allclose(turned, vector / np.linalg.norm(vector), atol=1e-6)


def test_straight_down_is_a_direction_too() -> None:
    down = np.array([[0.0, 0.0, -3.0]])
    turned = motion_matrix(Motion("/node", quaternion=quaternions_onto(down)), 0)[:3, :3]
    np.testing.assert_allclose(turned[:, 2], [0, 0, -1], atol=1e-12)
    assert np.linalg.det(turned) == pytest.approx(1.0)


def test_an_arrow_hides_without_force_or_point() -> None:
    origin = np.array([[1.0, 2, 3], [1, 2, 3], [np.nan] * 3, [4, 5, 6]])
    force = np.array([[0.0, 0, 10], [0, 0, 0], [0, 0, 10], [0, 0, 10]])
    node, shaft, head = arrow_motions("/arrow", origin, force, metres_per_newton=0.02)
    assert node.scale is not None
    assert node.position is not None
    np.testing.assert_array_equal(node.scale[[1, 2]], HIDDEN_SCALE)
    np.testing.assert_array_equal(node.scale[[0, 3]], 1.0)
    # Where it has no point it waits at the last one.
    np.testing.assert_array_equal(node.position, origin[[0, 1, 1, 3]])
    for motion in (shaft.scale, head.position):
        assert motion is not None
        assert np.isfinite(motion).all()
        assert (motion[:, 2] > 0.0).all()


def test_a_short_arrow_keeps_its_looks_and_its_length() -> None:
    force = np.array([[0.0, 0, 2.0], [0, 0, 40.0]])
    node, shaft, _ = arrow_motions("/arrow", np.zeros((2, 3)), force, metres_per_newton=0.02)
    assert node.scale is not None
    assert shaft.scale is not None
    length = node.scale[:, 2] * (shaft.scale[:, 2] + 0.07)
    np.testing.assert_allclose(length, [0.04, 0.8])
    assert node.scale[0, 0] < 1.0


@pytest.mark.parametrize(("largest", "scale"), [(30.0, 0.02), (65.0, 0.01), (6.0, 0.1), (300.0, 0.002), (0.0, 0.01)])
def test_scale_of_arrows_is_round(largest: float, scale: float) -> None:
    forces = [np.array([[0.0, 0.0, -largest], [np.nan, 0.0, 0.0]]), np.zeros((0, 3))]
    assert round_scale(forces) == pytest.approx(scale)


def test_profile_is_clipped_where_asked_and_never_beyond_its_ends() -> None:
    x, z = [0.0, 1.0, 3.0], [0.0, 0.0, 2.0]
    np.testing.assert_allclose(clip_profile(x, z, low=0.5, high=2.0), [[0.5, 0.0], [1.0, 0.0], [2.0, 1.0]])
    np.testing.assert_allclose(clip_profile(x, z, low=-9.0, high=9.0), [[0.0, 0.0], [1.0, 0.0], [3.0, 2.0]])


@pytest.mark.parametrize(("x", "z"), [([0.0], [0.0]), ([0.0, 1.0], [0.0]), ([1.0, 0.0], [0.0, 0.0])])
def test_a_profile_that_is_none_is_refused(x: list[float], z: list[float]) -> None:
    with pytest.raises(InvalidSettingError, match="terrain profile"):
        clip_profile(x, z, low=0.0, high=1.0)


def test_tiles_have_equal_length_along_the_slope_and_follow_its_corners() -> None:
    profile = np.array([[0.0, 0.0], [1.1, 0.0], [2.1, 1.0]])
    points, tiles = tile_profile(profile, 0.25)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    for tile in range(tiles.max()):
        assert steps[tiles == tile].sum() == pytest.approx(0.25, abs=1e-6)
    assert np.linalg.norm(points - [1.1, 0.0], axis=1).min() < 1e-9
    np.testing.assert_allclose(points[-1], [2.1, 1.0])


def test_ground_covers_the_profile() -> None:
    profile = np.array([[-1.0, 0.0], [0.0, 0.0], [2.0, 2.0]])
    surface = ground_commands(profile, half_width=0.5)[0]
    data = surface["object"]["geometries"][0]["data"]["attributes"]["position"]["array"].data
    vertices = np.frombuffer(data, dtype="<f4").reshape(-1, 3)
    np.testing.assert_allclose(vertices.min(axis=0), [-1.0, -0.5, 0.0], atol=1e-6)
    np.testing.assert_allclose(vertices.max(axis=0), [2.0, 0.5, 2.0], atol=1e-6)
    np.testing.assert_allclose(vertices[:, 2], np.interp(vertices[:, 0], *profile.T), atol=1e-6)
