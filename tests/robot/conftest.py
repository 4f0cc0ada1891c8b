"""Fixtures of the robot tests."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from m4_dynamics.robot.loading import bundled_description, load_robot
from m4_dynamics.robot.robot import Robot


@pytest.fixture(scope="session")
def m4() -> Robot:
    """The bundled robot."""
    return load_robot()


@pytest.fixture
def m4_copy(tmp_path: Path) -> Path:
    """A copy of the bundled robot's three files, to be broken; the path of its TOML description."""
    for suffix in (".toml", ".urdf", ".srdf"):
        shutil.copy(bundled_description().with_suffix(suffix), tmp_path)
    shutil.copytree(bundled_description().with_name("meshes"), tmp_path / "meshes")
    return tmp_path / "m4.toml"
