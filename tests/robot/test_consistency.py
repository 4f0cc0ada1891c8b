"""Contradictions between URDF, postures and description that load without complaint."""

from __future__ import annotations

from pathlib import Path

import pytest

from m4_dynamics.robot.consistency import consistency_findings
from m4_dynamics.robot.loading import load_robot

#: Name -> (file, old text, new text, severity, part of where, part of what).
CONTRADICTIONS = {
    "posture outside the limits": (
        ".srdf",
        'front_left_hip_frontal" value="1.5707963267948966"',
        'front_left_hip_frontal" value="2.0"',
        "warning",
        "posture 'uas'",
        "'front_left_hip_frontal' stands at 2, outside its limits -0.2..1.75",
    ),
    "colliding legs": (
        ".srdf",
        "-1.007054978400728",
        "-1.5707963267948966",
        "warning",
        "posture 'mip'",
        "bodies collide: ",
    ),
    "wrong wheel radius": (
        ".toml",
        "radius = 0.125",
        "radius = 0.15",
        "warning",
        "wheel 'rear_left_wheel'",
        "stated as 0.15 m, but its collision shape reaches 0.125 m",
    ),
    "joint that nothing holds": (
        ".toml",
        '    "rear_left_hip_frontal",\n',
        "",
        "warning",
        "joint 'rear_left_hip_frontal'",
        "swings freely",
    ),
    "servo stronger than its joint": (
        ".toml",
        "effort_limit = 10.5",
        "effort_limit = 20.0",
        "warning",
        "servo 'front_left_hip_frontal'",
        "20 N m is above the 10.5 N m",
    ),
    "stiction that never ends": (
        ".toml",
        "stiction_speed = 1.0e-4",
        "stiction_speed = 0.05",
        "warning",
        "[ground]",
        "stiction_speed 0.05 is not below",
    ),
    "unequal drive wheels": (
        ".toml",
        "radius = 0.125",
        "radius.front_left_wheel = 0.125\nradius.front_right_wheel = 0.125\n"
        "radius.rear_left_wheel = 0.125\nradius.rear_right_wheel = 0.12",
        "error",
        "[balance]",
        "differ in radius: 0.125 and 0.12 m",
    ),
    "drive wheels off one axle": (
        ".toml",
        '"rear_left_wheel", "rear_right_wheel"]\nthrusters',
        '"rear_left_wheel", "front_right_wheel"]\nthrusters',
        "error",
        "[balance]",
        "off the line between the drive wheels",
    ),
    "drive wheels exchanged": (
        ".toml",
        'drive_wheels = ["rear_left_wheel", "rear_right_wheel"]',
        'drive_wheels = ["rear_right_wheel", "rear_left_wheel"]',
        "warning",
        "[balance]",
        "'rear_right_wheel' is named first, but is on the robot's right",
    ),
    "thrusters that cancel": (
        ".toml",
        'thrusters = ["front_left_thruster", "front_right_thruster"]',
        'thrusters = ["rear_left_thruster", "rear_right_thruster"]',
        "error",
        "[balance]",
        "the thrusters cancel each other",
    ),
    "thrust along the axle": (
        ".toml",
        'thrusters = ["front_left_thruster", "front_right_thruster"]',
        'thrusters = ["rear_left_thruster"]',
        "warning",
        "[balance]",
        "90.0 deg out of the plane",
    ),
    "thrusters that push apart": (
        ".toml",
        'thrusters = ["front_left_thruster", "front_right_thruster"]',
        'thrusters = ["front_left_thruster", "rear_left_thruster"]',
        "warning",
        "[balance]",
        "the thrusters push apart: 29% of thrust is lost",
    ),
}


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_contradiction_is_found(m4_copy: Path, name: str) -> None:
    suffix, old, new, severity, where, what = CONTRADICTIONS[name]
    path = m4_copy.with_suffix(suffix)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    findings = consistency_findings(load_robot(m4_copy))
    matching = [finding for finding in findings if where in finding.where and what in finding.what]
    assert matching, [str(finding) for finding in findings]
    assert matching[0].severity == severity


def test_bare_urdf_is_not_blamed_for_what_nobody_described(m4_copy: Path) -> None:
    m4_copy.unlink()
    assert consistency_findings(load_robot(m4_copy.with_suffix(".urdf"))) == ()


def test_disabled_pair_may_overlap(m4_copy: Path) -> None:
    """The SRDF's word on collision pairs is kept."""
    robot = load_robot(m4_copy)
    srdf = m4_copy.with_suffix(".srdf")
    disabled = (
        '<disable_collisions link1="front_left_wheel_link" link2="front_right_wheel_link" reason="test"/></robot>'
    )
    srdf.write_text(srdf.read_text().replace("</robot>", disabled))
    assert len(load_robot(m4_copy).collision_model.collisionPairs) == len(robot.collision_model.collisionPairs) - 1
