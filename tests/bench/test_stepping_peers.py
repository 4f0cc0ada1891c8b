"""The peers that `m4 bench` times simulate the same robot: it stands still, and the ground carries its weight."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from m4_dynamics.bench.drake_stepping import build_drake_stepper
from m4_dynamics.bench.mujoco_stepping import build_mujoco_stepper
from m4_dynamics.bench.peers import PeerMissingError, import_peer
from m4_dynamics.errors import InvalidSettingError, M4Error, RobotDescriptionError, UnknownNameError
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.standing import joint_angles, standing_configuration
from m4_dynamics.full.stepping import ImplicitStepper
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot

RequirePeer = Callable[[str], ModuleType]
BUILDERS: dict[str, tuple[str, Callable[..., Any], dict[str, str]]] = {
    "mujoco-python": ("mujoco", build_mujoco_stepper, {"loop": "python"}),
    "mujoco-c": ("mujoco", build_mujoco_stepper, {"loop": "c"}),
    "drake-sap": ("pydrake", build_drake_stepper, {"solver": "sap"}),
    "drake-tamsi": ("pydrake", build_drake_stepper, {"solver": "tamsi"}),
}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.mark.parametrize("peer", BUILDERS)
def test_the_robot_stands_still_and_its_weight_is_carried(robot: Robot, require_peer: RequirePeer, peer: str) -> None:
    module, build, options = BUILDERS[peer]
    require_peer(module)
    step = build(robot, **options)
    start = step.base_height
    assert start == pytest.approx(standing_configuration(robot)[2], abs=1e-12)
    heights = []
    for _ in range(10):
        step(100)
        heights.append(step.base_height)
    assert step.time == pytest.approx(1.0, abs=1e-9)
    assert np.abs(np.array(heights) - start).max() < 0.01
    # At rest by now: what is left of the settling is far below the first sinking-in.
    assert abs(heights[-1] - heights[-2]) < 1e-5
    weight = robot.mass * robot.gravity
    np.testing.assert_allclose(step.ground_force_in_world(), [0.0, 0.0, weight], atol=0.01 * weight)


def test_drake_sinks_in_as_deep_as_the_full_model(robot: Robot, require_peer: RequirePeer) -> None:
    require_peer("pydrake")
    full = ImplicitStepper(FullModel.build(robot))
    full.reset(standing_configuration(robot))
    drake = build_drake_stepper(robot)
    start = drake.base_height
    full.step(1000)
    drake(1000)
    assert start - full.configuration[2] > 1e-4
    # The ground's transition width, which Drake's law does not have, is the difference.
    assert drake.base_height == pytest.approx(full.configuration[2], abs=2e-5)


def test_a_call_advances_by_whole_steps(robot: Robot, require_peer: RequirePeer) -> None:
    require_peer("pydrake")
    require_peer("mujoco")
    for step in (build_drake_stepper(robot), build_mujoco_stepper(robot), build_mujoco_stepper(robot, loop="c")):
        for count in (1, 7, 1, 3):
            step(count)
        assert step.time == pytest.approx(0.012, abs=1e-12)


def test_wrong_options_are_refused(robot: Robot, require_peer: RequirePeer) -> None:
    require_peer("pydrake")
    require_peer("mujoco")
    with pytest.raises(InvalidSettingError, match="'python' or 'c'"):
        build_mujoco_stepper(robot, loop="rust")  # type: ignore[arg-type]
    with pytest.raises(InvalidSettingError, match="one of sap"):
        build_drake_stepper(robot, solver="magic")  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="crouch"):
        build_mujoco_stepper(robot, posture="sideways")


@pytest.mark.parametrize(
    ("module", "build"), [("mujoco", build_mujoco_stepper), ("pydrake.multibody.plant", build_drake_stepper)]
)
def test_a_missing_peer_is_named_with_its_extra(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, module: str, build: Callable[..., Any]
) -> None:
    monkeypatch.setitem(sys.modules, module, None)  # makes its import fail
    with pytest.raises(PeerMissingError, match=rf"'{module}'.*m4_dynamics\[peers\]") as caught:
        build(robot)
    assert isinstance(caught.value, M4Error)
    assert caught.value.module == module


def test_import_peer_returns_the_module() -> None:
    assert import_peer("json.decoder").__name__ == "json.decoder"


@pytest.mark.parametrize("posture", [None, "ugv", "crouch", "mip"])
def test_the_lowest_wheel_or_point_touches_the_ground(robot: Robot, posture: str | None) -> None:
    q = standing_configuration(robot, posture)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    # Points all around each rim, an independent way to find the lowest one.
    turns = np.linspace(0.0, 2.0 * np.pi, 3601)
    lowest = np.inf
    for wheel in robot.wheels:
        across = np.linalg.svd(wheel.axis_in_joint[None, :])[2][1:]
        rim = wheel.radius * (np.cos(turns)[:, None] * across[0] + np.sin(turns)[:, None] * across[1])
        placement = data.oMi[wheel.joint_id]
        lowest = min(lowest, (placement.translation + rim @ placement.rotation.T)[:, 2].min())
    for point in robot.contact_points:
        lowest = min(lowest, data.oMi[point.joint_id].act(point.position_in_joint)[2])
    assert lowest == pytest.approx(0.0, abs=1e-6)


def test_joint_angles_read_back_the_posture(robot: Robot) -> None:
    q = standing_configuration(robot, "mip")
    wheel = robot.wheels[0]
    q[wheel.index_q : wheel.index_q + 2] = (np.cos(-0.7), np.sin(-0.7))
    angles = dict(joint_angles(robot, q))
    assert set(angles) == set(list(robot.model.names)[2:])
    assert angles[wheel.joint] == pytest.approx(-0.7)
    for servo in robot.servos:
        assert angles[servo.joint] == q[servo.index_q]


def test_a_robot_without_wheels_cannot_stand(tmp_path: Any) -> None:
    path = tmp_path / "block.urdf"
    path.write_text(
        '<robot name="block"><link name="block"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
    )
    with pytest.raises(RobotDescriptionError, match="no wheels"):
        standing_configuration(load_robot(path))
