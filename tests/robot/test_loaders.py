"""M4's URDF loads in four readers and passes a fifth without a word of complaint."""

from __future__ import annotations

import logging
import os
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from m4_dynamics.robot.loading import bundled_description, load_robot

URDF = bundled_description().with_name("m4.urdf")


@pytest.fixture
def no_complaint(capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture) -> Iterator[None]:
    """Fail if anything is printed, logged as a warning, or warned of, in Python or below it."""
    caplog.set_level(logging.WARNING)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err == ""
    assert caplog.records == []


@pytest.mark.usefixtures("no_complaint")
def test_pinocchio() -> None:
    robot = load_robot()
    assert robot.model.nv == 18
    assert robot.model.nq == 23
    assert robot.visual_model.ngeoms > robot.collision_model.ngeoms > 0


def test_drake(require_peer: Callable[[str], Any], request: pytest.FixtureRequest) -> None:
    require_peer("pydrake")
    from pydrake.geometry import Role, SceneGraph
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    request.getfixturevalue("no_complaint")  # from here on: importing a peer is not what is tested
    plant = MultibodyPlant(0.0)
    scene = SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene)
    Parser(plant).AddModels(str(URDF))
    plant.Finalize()
    assert plant.num_velocities() == 18
    inspector = scene.model_inspector()
    assert inspector.NumGeometriesWithRole(Role.kPerception) == 35
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(6.0, abs=1e-9)


def test_mujoco(require_peer: Callable[[str], Any], request: pytest.FixtureRequest) -> None:
    mujoco = require_peer("mujoco")
    request.getfixturevalue("no_complaint")
    model = mujoco.MjModel.from_xml_path(str(URDF))
    assert model.nv == 12  # MuJoCo welds the root of a URDF to the world
    assert model.ngeom > 0


def test_mujoco_finds_the_meshes_if_it_is_to_show_them(require_peer: Callable[[str], Any], tmp_path: Path) -> None:
    mujoco = require_peer("mujoco")
    text = URDF.read_text(encoding="utf-8").replace("<compiler ", '<compiler discardvisual="false" ')
    shown = tmp_path / "m4.urdf"
    shown.write_text(text, encoding="utf-8")
    (tmp_path / "meshes").symlink_to(URDF.parent / "meshes")
    assert mujoco.MjModel.from_xml_path(str(shown)).nmesh == len(list((URDF.parent / "meshes").iterdir()))


def test_yourdfpy(request: pytest.FixtureRequest) -> None:
    import yourdfpy

    request.getfixturevalue("no_complaint")
    urdf = yourdfpy.URDF.load(str(URDF))
    assert urdf.validate()
    assert urdf.num_actuated_joints == 12
    assert len(urdf.scene.geometry) == 35


def test_check_urdf() -> None:
    places = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    program = shutil.which("check_urdf", path=places)
    if program is None:
        reason = "check_urdf is not installed"
        pytest.fail(reason) if os.environ.get("CI") == "true" else pytest.skip(reason)
    result = subprocess.run([program, str(URDF)], capture_output=True, text=True, check=False)
    assert result.returncode == 0
    assert result.stderr == ""
    assert "Successfully Parsed XML" in result.stdout
    assert "root Link: base has" in result.stdout
