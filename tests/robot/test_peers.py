"""The rigid-body quantities that everything stands on, against two other engines on the same URDF."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from peer_models import Answer, DrakePeer, MujocoPeer, PinocchioPeer, random_state, without_shapes

from m4_dynamics.robot.loading import bundled_description

ROBOTS = {
    "m4": None,
    "tiago_pro": "tiago_pro_description/robots/tiago_pro.urdf",
    "centauro": "centauro_description/urdf/centauro.urdf",
    "hextilt_with_arm": "hextilt_description/urdf/hextilt_flying_arm_5.urdf",
}
STATES = 5
TOLERANCE = 1e-8


@pytest.fixture(params=ROBOTS)
def urdfs(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, Path]:
    """Copies of a robot's URDF without shapes, for Drake and for MuJoCo."""
    path = ROBOTS[request.param]
    if path is None:
        urdf = bundled_description().with_name("m4.urdf")
    else:
        urdf = request.getfixturevalue("example_robots") / path
    return without_shapes(urdf, tmp_path)


def relative_difference(received: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(received - expected).max() / np.abs(expected).max())


def assert_equal(received: Answer, expected: Answer) -> None:
    assert relative_difference(received.mass_matrix, expected.mass_matrix) < TOLERANCE
    assert relative_difference(received.bias, expected.bias) < TOLERANCE
    assert relative_difference(received.gravity, expected.gravity) < TOLERANCE
    for link, jacobian in expected.jacobians.items():
        assert relative_difference(received.jacobians[link], jacobian) < TOLERANCE, link


def compare(reference: PinocchioPeer, peer: DrakePeer | MujocoPeer) -> None:
    assert len(reference.links) > 5
    rng = np.random.default_rng(20240513)
    for _ in range(STATES):
        state = random_state(reference.model, rng)
        assert_equal(reference.answer(state, reference.links), peer.answer(state, reference.links))


def test_against_drake(urdfs: tuple[Path, Path], require_peer: Callable[[str], Any]) -> None:
    plain, _ = urdfs
    reference = PinocchioPeer(plain)
    require_peer("pydrake")
    compare(reference, DrakePeer(plain, reference))


def test_against_mujoco(urdfs: tuple[Path, Path], require_peer: Callable[[str], Any]) -> None:
    plain, for_mujoco = urdfs
    reference = PinocchioPeer(plain)
    compare(reference, MujocoPeer(require_peer("mujoco"), for_mujoco, reference))


def test_comparison_sees_a_small_change(tmp_path: Path, require_peer: Callable[[str], Any]) -> None:
    """A centre of mass moved by a micrometre is seen: the tolerance is not blind."""
    plain, for_mujoco = without_shapes(bundled_description().with_name("m4.urdf"), tmp_path)
    reference = PinocchioPeer(plain)
    peer = MujocoPeer(require_peer("mujoco"), for_mujoco, reference)
    reference.model.inertias[1].lever = reference.model.inertias[1].lever + np.array([1e-6, 0.0, 0.0])
    state = random_state(reference.model, np.random.default_rng(1))
    received = peer.answer(state, reference.links)
    expected = reference.answer(state, reference.links)
    assert relative_difference(received.mass_matrix, expected.mass_matrix) > TOLERANCE
    assert relative_difference(received.bias, expected.bias) > TOLERANCE
