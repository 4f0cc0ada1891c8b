"""A collection of broken URDFs: what is wrong is found, at the right link or joint."""

from __future__ import annotations

from pathlib import Path

import pinocchio as pin
import pytest

from m4_dynamics.errors import M4Error
from m4_dynamics.robot.diagnosis import diagnose_urdf
from m4_dynamics.robot.finding import has_errors
from m4_dynamics.robot.loading import load_robot

INERTIA = '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
BODY = f'<inertial><mass value="1"/>{INERTIA}</inertial>'
JOINT = (
    '<joint name="hinge" type="revolute">\n<parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
)
SOUND = f'<robot name="two">\n<link name="a">{BODY}</link>\n<link name="b">{BODY}</link>\n{JOINT}\n</robot>\n'


def with_link(content: str) -> str:
    """The sound robot with one more link, fixed to the first."""
    joint = '<joint name="glue" type="fixed"><parent link="a"/><child link="c"/></joint>'
    return SOUND.replace("</robot>", f'<link name="c">{content}</link>{joint}</robot>')


#: Name -> (text, severity, part of where, part of what).
BROKEN = {
    "not XML": (SOUND.replace("</robot>", ""), "error", "robot.urdf", "not valid XML"),
    "empty": ("", "error", "robot.urdf", "not valid XML"),
    "not a robot": ("<sdf/>", "error", "robot.urdf", "root element is <sdf>"),
    "no name": (SOUND.replace(' name="two"', ""), "error", "robot.urdf", "<robot> has no attribute 'name'"),
    "no link": ('<robot name="none"/>', "error", "robot.urdf", "has no link"),
    "xacro": (
        SOUND.replace("<robot ", '<robot xmlns:xacro="x" ').replace("</robot>", "<xacro:leg/></robot>"),
        "error",
        "robot.urdf",
        "xacro",
    ),
    "link without a name": (SOUND.replace("</robot>", "<link/></robot>"), "error", "link without", "attribute 'name'"),
    "joint without a type": (SOUND.replace(' type="revolute"', ""), "error", "joint 'hinge'", "attribute 'type'"),
    "joint without a child": (SOUND.replace('<child link="b"/>', ""), "error", "joint 'hinge'", "no <child>"),
    "child without a link": (SOUND.replace('<child link="b"/>', "<child/>"), "error", "'hinge'", "no attribute 'link'"),
    "unknown type": (
        SOUND.replace("revolute", "hinge"),
        "error",
        "joint 'hinge' (line 4)",
        "unknown joint type",
    ),
    "no limit": (
        SOUND.replace('<limit lower="-1" upper="1" effort="1" velocity="1"/>', ""),
        "error",
        "joint 'hinge'",
        "revolute joint needs a <limit>",
    ),
    "no effort": (SOUND.replace(' effort="1"', ""), "error", "joint 'hinge'", "<limit> has no attribute 'effort'"),
    "no upper limit": (SOUND.replace(' upper="1"', ""), "warning", "joint 'hinge'", "no attribute 'upper', which then"),
    "equal limits": (
        SOUND.replace('lower="-1" upper="1"', 'lower="1" upper="1"'),
        "warning",
        "joint 'hinge'",
        "it cannot move",
    ),
    "limits the wrong way round": (
        SOUND.replace('lower="-1" upper="1"', 'lower="1" upper="-1"'),
        "error",
        "joint 'hinge'",
        "lower limit 1 is above its upper limit -1",
    ),
    "short axis": (SOUND.replace('xyz="0 0 1"', 'xyz="0 1"'), "error", "joint 'hinge'", "is not 3 finite numbers"),
    "zero axis": (SOUND.replace('xyz="0 0 1"', 'xyz="0 0 0"'), "error", "joint 'hinge'", "its axis is zero"),
    "words for numbers": (
        SOUND.replace('lower="-1"', 'lower="low"'),
        "error",
        "joint 'hinge'",
        'lower="low" is',
    ),
    "NaN": (SOUND.replace('lower="-1"', 'lower="nan"'), "error", "joint 'hinge'", 'lower="nan" is not one finite'),
    "mimics nothing": (
        SOUND.replace("</joint>", '<mimic joint="other"/></joint>'),
        "warning",
        "joint 'hinge'",
        "mimics joint 'other'",
    ),
    "unknown parent": (SOUND.replace('link="a"/>', 'link="z"/>'), "error", "joint 'hinge'", "parent link 'z' does not"),
    "unknown child": (SOUND.replace('link="b"/>', 'link="z"/>'), "error", "joint 'hinge'", "child link 'z' does not"),
    "two links of one name": (
        SOUND.replace("</robot>", '<link name="b"/></robot>'),
        "error",
        "link 'b'",
        "2 links have this name (lines 3, 6)",
    ),
    "two joints of one name": (
        with_link("").replace('"glue"', '"hinge"'),
        "error",
        "joint 'hinge'",
        "2 joints have this name",
    ),
    "loop": (
        SOUND.replace("</robot>", '<joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint></robot>'),
        "error",
        "robot.urdf",
        "the joints make a loop: b -> a -> b",
    ),
    "link that is its own parent": (
        SOUND.replace("</robot>", '<joint name="k" type="fixed"><parent link="a"/><child link="a"/></joint></robot>'),
        "error",
        "robot.urdf",
        "loop: a -> a",
    ),
    "two parents": (
        with_link("").replace(
            "</robot>", '<joint name="k" type="fixed"><parent link="b"/><child link="c"/></joint></robot>'
        ),
        "error",
        "link 'c'",
        "child of 2 joints (of a, b)",
    ),
    "two roots": (
        SOUND.replace("</robot>", '<link name="c"/></robot>'),
        "error",
        "robot.urdf",
        "2 links have no",
    ),
    "no mass": (SOUND.replace('<mass value="1"/>', "", 1), "error", "link 'a'", "<inertial> has no <mass>"),
    "no inertia": (SOUND.replace(INERTIA, "", 1), "error", "link 'a'", "<inertial> has no <inertia>"),
    "half an inertia": (SOUND.replace(' izz="0.1"', "", 1), "error", "link 'a'", "<inertia> has no attribute 'izz'"),
    "mass in words": (SOUND.replace('value="1"', 'value="heavy"', 1), "error", "link 'a'", 'value="heavy" is not one'),
    "negative mass": (SOUND.replace('value="1"', 'value="-1"', 1), "error", "link 'a'", "negative mass -1 kg"),
    "negative inertia": (SOUND.replace('izz="0.1"', 'izz="-0.1"', 1), "error", "root_joint", "not positive definite"),
    "products too large": (SOUND.replace('ixy="0"', 'ixy="0.2"', 1), "warning", "link 'a'", "not positive definite"),
    "triangle inequality": (
        SOUND.replace('izz="0.1"', 'izz="0.3"', 1),
        "warning",
        "link 'a' (line 2)",
        "triangle inequal",
    ),
    "mass without inertia": (
        with_link('<inertial><mass value="1"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'),
        "note",
        "link 'c'",
        "zero principal moment",
    ),
    "massless moving link": (SOUND.replace(f'"b">{BODY}', '"b">'), "error", "joint 'hinge'", "moves no mass: link 'b'"),
    "massless robot": ('<robot name="none"><link name="a"/></robot>', "error", "robot", "weigh nothing"),
    "missing mesh": (
        with_link('<collision><geometry><mesh filename="package://meshes/c.stl"/></geometry></collision>'),
        "error",
        "link 'c'",
        "collision mesh 'package://meshes/c.stl' is not to be found",
    ),
    "missing mesh that is only seen": (
        with_link('<visual><geometry><mesh filename="package://meshes/c.stl"/></geometry></visual>'),
        "warning",
        "link 'c'",
        "visual mesh 'package://meshes/c.stl' is not to be found",
    ),
    "mesh without a file": (
        with_link("<visual><geometry><mesh/></geometry></visual>"),
        "error",
        "link 'c'",
        "<mesh> has no attribute 'filename'",
    ),
    "empty geometry": (
        with_link("<collision><geometry/></collision>"),
        "error",
        "link 'c'",
        "<geometry> holds 0 shapes",
    ),
    "negative box": (
        with_link('<collision><geometry><box size="1 -1 1"/></geometry></collision>'),
        "error",
        "link 'c'",
        'size="1 -1 1" is not positive',
    ),
    "no geometry": (with_link("<visual/>"), "error", "link 'c'", "<visual> has no <geometry>"),
    "unknown shape": (
        with_link("<visual><geometry><blob/></geometry></visual>"),
        "error",
        "link 'c'",
        "<geometry> holds 0 shapes",
    ),
}


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    path = tmp_path / "robot.urdf"
    path.write_text(SOUND)
    return path


def test_sound_robot_has_no_findings(urdf: Path) -> None:
    assert diagnose_urdf(urdf) == ()
    assert load_robot(urdf).model.nv == 7


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_wrong_is_found_where_it_is(urdf: Path, name: str) -> None:
    text, severity, where, what = BROKEN[name]
    urdf.write_text(text)
    findings = diagnose_urdf(urdf)
    matching = [finding for finding in findings if where in finding.where and what in finding.what]
    assert matching, [str(finding) for finding in findings]
    assert matching[0].severity == severity
    assert matching[0].hint


def error_of_loading(urdf: Path) -> M4Error | None:
    try:
        load_robot(urdf)
    except M4Error as error:
        return error
    return None


@pytest.mark.parametrize("name", BROKEN)
def test_robot_that_does_not_load_has_an_error_among_its_findings(urdf: Path, name: str) -> None:
    """Nor does loading end in anything but a robot or this package's own error."""
    urdf.write_text(BROKEN[name][0])
    error = error_of_loading(urdf)
    if error is not None:
        assert has_errors(diagnose_urdf(urdf))
        assert str(urdf) in str(error)


def test_errors_come_first(urdf: Path) -> None:
    urdf.write_text(SOUND.replace('izz="0.1"', 'izz="0.3"', 1).replace('xyz="0 0 1"', 'xyz="0 0 0"'))
    severities = [finding.severity for finding in diagnose_urdf(urdf)]
    assert severities == ["error", "warning"]


def test_several_things_are_found_at_once(urdf: Path) -> None:
    urdf.write_text(
        SOUND.replace("revolute", "hinge").replace('value="1"', 'value="-1"').replace('link="a"', 'link="z"')
    )
    places = {finding.where.split(" (")[0] for finding in diagnose_urdf(urdf)}
    assert places == {"link 'a'", "link 'b'", "joint 'hinge'"}


def test_mesh_that_is_there_is_found(urdf: Path) -> None:
    """Beside the URDF, and in a package folder above it."""
    (urdf.parent / "c.stl").write_text("solid c\nendsolid c\n")
    for name in ("c.stl", f"package://{urdf.parent.name}/c.stl", f"file://{urdf.parent}/c.stl", f"{urdf.parent}/c.stl"):
        urdf.write_text(with_link(f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'))
        assert diagnose_urdf(urdf) == (), name


def test_missing_file_is_a_finding(tmp_path: Path) -> None:
    (finding,) = diagnose_urdf(tmp_path / "nowhere.urdf")
    assert finding.severity == "error"
    assert "cannot be read" in finding.what


def test_diagnosis_agrees_with_pinocchio_about_other_peoples_robots(example_robots: Path) -> None:
    """It calls nothing an error that loads and moves, and misses nothing that Pinocchio refuses."""
    urdfs = sorted(example_robots.rglob("*.urdf"))
    assert len(urdfs) > 50
    refused, erroneous = set(), set()
    for path in urdfs:
        try:
            model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
            pin.computeMinverse(model, model.createData(), pin.neutral(model))
            mass = pin.crba(model, model.createData(), pin.neutral(model))
            if mass.diagonal().min() <= 0.0:
                refused.add(path.name)
        except ValueError:
            refused.add(path.name)
        if has_errors(diagnose_urdf(path)):
            erroneous.add(path.name)
    assert erroneous == refused
