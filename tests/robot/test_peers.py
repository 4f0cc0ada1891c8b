"""The rigid-body quantities that everything stands on, against two other engines on the same URDF."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
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


def relative_differences(received: Answer, expected: Answer) -> dict[str, float]:
    """Largest difference of each quantity, every entry relative to its own joint's inertia.

    Relative to the largest entry, which is the robot's mass, a finger's inertia could be wrong and go unseen. Scaled
    by the roots of the mass matrix's diagonal, all its entries lie in [-1, 1] and forces of all joints compare.
    """
    scale = np.sqrt(expected.mass_matrix.diagonal())
    mass = np.abs(received.mass_matrix - expected.mass_matrix) / np.outer(scale, scale)
    differences = {"mass matrix": float(mass.max())}
    for name in ("bias", "gravity"):
        force, reference = getattr(received, name), getattr(expected, name)
        differences[name] = float((np.abs(force - reference) / scale).max() / (np.abs(reference) / scale).max())
    for link, jacobian in expected.jacobians.items():
        # Rows of linear and angular velocity have different units.
        for rows, unit in ((slice(0, 3), "linear"), (slice(3, 6), "angular")):
            difference = np.abs(received.jacobians[link][rows] - jacobian[rows]).max()
            differences[f"{unit} Jacobian of {link}"] = float(difference / np.abs(jacobian[rows]).max())
    return differences


def assert_equal(received: Answer, expected: Answer) -> None:
    differences = relative_differences(received, expected)
    assert {name: value for name, value in differences.items() if not value < TOLERANCE} == {}


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


def move_centre_of_mass(model: pin.Model) -> None:
    """By a tenth of a micrometre."""
    model.inertias[1].lever = model.inertias[1].lever + np.array([1e-7, 0.0, 0.0])


def enlarge_one_wheels_inertia(model: pin.Model) -> None:
    """By a ten-millionth: 2e-10 kg m2, beside a total mass of 6 kg."""
    wheel = model.inertias[model.getJointId("front_left_wheel")]
    wheel.inertia = wheel.inertia * (1.0 + 1e-7)


@pytest.mark.parametrize("change", [move_centre_of_mass, enlarge_one_wheels_inertia])
@pytest.mark.parametrize("engine", ["pydrake", "mujoco"])
def test_comparison_sees_a_small_change(
    tmp_path: Path, require_peer: Callable[[str], Any], engine: str, change: Callable[[pin.Model], None]
) -> None:
    """The tolerance is not blind, with either engine, to large bodies or small ones."""
    plain, for_mujoco = without_shapes(bundled_description().with_name("m4.urdf"), tmp_path)
    reference = PinocchioPeer(plain)
    module = require_peer(engine)
    is_drake = engine == "pydrake"
    peer = DrakePeer(plain, reference) if is_drake else MujocoPeer(module, for_mujoco, reference)
    state = random_state(reference.model, np.random.default_rng(1))
    received = peer.answer(state, reference.links)
    assert_equal(received, reference.answer(state, reference.links))
    change(reference.model)
    assert relative_differences(received, reference.answer(state, reference.links))["mass matrix"] > TOLERANCE


def test_missing_peer_is_skipped_at_home_and_fails_in_ci(
    require_peer: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CI", raising=False)
    with pytest.raises(pytest.skip.Exception, match="no_such_engine is not installed"):
        require_peer("no_such_engine")
    monkeypatch.setenv("CI", "true")
    with pytest.raises(pytest.fail.Exception, match="no_such_engine is not installed"):
        require_peer("no_such_engine")
