"""Postures side by side: every robot stands on the ground, nobody in another's way."""

from __future__ import annotations

import base64
import dataclasses
import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import umsgpack

from m4_dynamics.errors import RobotDescriptionError, UnknownNameError
from m4_dynamics.robot.dimensions import extent
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.gallery import ZERO_POSTURE, posture_html, standing_in_posture, write_posture_html


def embedded(page: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The page's data and its unpacked commands."""
    data = json.loads(re.search(r'<script id="replay" type="application/json">(.*?)</script>', page, re.S).group(1))
    parts = [base64.b64decode(part) for part in data["parts"]]
    return data, [umsgpack.unpackb(b"".join(parts[part] for part in command)) for command in data["commands"]]


@pytest.fixture(scope="module")
def page(robot: Robot) -> str:
    return posture_html(robot, list(robot.postures))


def test_every_posture_stands_on_the_ground(robot: Robot) -> None:
    for name in [*robot.postures, ZERO_POSTURE]:
        low, _ = extent(robot, standing_in_posture(robot, name), [0.0, 0.0, 1.0])
        assert low == pytest.approx(0.0, abs=1e-12), name


def test_the_balancing_posture_stands_in_balance(robot: Robot) -> None:
    q = standing_in_posture(robot, robot.balance.posture)
    data = robot.model.createData()
    com = pin.centerOfMass(robot.model, data, q)
    axle = np.mean([data.oMi[robot.joint_id(joint)].translation for joint in robot.balance.drive_wheels], axis=0)
    # The drive wheels' own mass is on the axle, so that the whole is in balance where the body is.
    assert com[0] == pytest.approx(axle[0], abs=1e-9)
    assert com[2] > axle[2] + 0.2


def test_all_postures_are_named_and_stand_apart(page: str, robot: Robot) -> None:
    data, commands = embedded(page)
    labels = {label["text"] for label in data["labels"]}
    assert labels == {name.replace("_", " ") for name in robot.postures}
    roots = [
        np.array(one["matrix"]).reshape(4, 4).T[:2, 3]
        for one in commands
        if one["type"] == "set_transform" and one["path"].endswith("/root_joint")
    ]
    assert len(roots) == len(robot.postures)
    for first, second in itertools.combinations(roots, 2):
        assert np.linalg.norm(first - second) > 0.8


def test_postures_are_small_together_and_ask_nothing_of_the_network(page: str, robot: Robot) -> None:
    parts = embedded(page)[0]["parts"]
    assert len(set(parts)) == len(parts)
    # Six robots share the meshes of one: the others take their commands only.
    alone = posture_html(robot, ["mip"])
    long = [sum(len(part) for part in embedded(one)[0]["parts"] if len(part) > 2000) for one in (page, alone)]
    assert abs(long[0] - long[1]) < 0.2 * long[1]  # more ground lies under six
    assert len(page) < 2e6
    assert "default-src 'none'" in page


def test_only_what_pushes_has_an_arrow(robot: Robot) -> None:
    _, commands = embedded(posture_html(robot, ["mip"]))
    sizes = [
        np.linalg.norm(np.array(one["matrix"])[:3])
        for one in commands
        if one["type"] == "set_transform" and re.fullmatch(r"/posture_0_thrust/\d", one["path"])
    ]
    assert sorted(size > 0.5 for size in sizes) == [False, False, True, True]


def test_a_robot_with_neither_postures_nor_visual_bodies_is_shown_too(robot: Robot) -> None:
    bare = dataclasses.replace(robot, visual_model=pin.GeometryModel(), postures={}, balance=None)
    data, commands = embedded(posture_html(bare, [ZERO_POSTURE]))
    assert [label["text"] for label in data["labels"]] == [ZERO_POSTURE]
    bodies = [one for one in commands if one["type"] == "set_object" and one["path"].startswith("/posture_0/")]
    assert len(bodies) >= robot.collision_model.ngeoms


def test_what_cannot_be_shown_is_named(robot: Robot, tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown posture 'heap'.*valid: ugv"):
        write_posture_html(robot, ["mip", "heap"], tmp_path / "page.html")
    empty = pin.GeometryModel()
    with pytest.raises(RobotDescriptionError, match="neither collision nor visual geometry"):
        posture_html(dataclasses.replace(robot, visual_model=empty, collision_model=empty), ["ugv"])
    assert list(tmp_path.iterdir()) == []
