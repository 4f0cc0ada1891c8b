"""Any URDF + TOML loads, names are looked up safely, and what is missing is named."""

from __future__ import annotations

import math
import pickle
from pathlib import Path

import numpy as np
import pytest

from m4_dynamics.errors import M4Error, RobotDescriptionError, UnknownNameError
from m4_dynamics.robot.diagnosis import diagnose_urdf
from m4_dynamics.robot.finding import InvalidUrdfError
from m4_dynamics.robot.loading import bundled_description, load_robot
from m4_dynamics.robot.robot import Robot

CART = """<robot name="cart">
  <link name="hull"><inertial><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="port"><inertial><mass value="0.5"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="starboard"><inertial><mass value="0.5"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="nozzle"/>
  <joint name="spin_port" type="continuous"><parent link="hull"/><child link="port"/>
    <origin xyz="0.2 0 0" rpy="0 0.4 0"/><axis xyz="0.6 0 0.8"/></joint>
  <joint name="spin_starboard" type="revolute"><parent link="hull"/><child link="starboard"/>
    <origin xyz="-0.2 0 0"/><axis xyz="0 0 -1"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
  <joint name="nozzle" type="fixed"><parent link="hull"/><child link="nozzle"/>
    <origin xyz="0 0 0.3" rpy="0 1.5707963267948966 0"/></joint>
</robot>
"""
CART_TOML = """
[robot]
urdf = "cart.urdf"
[wheels]
joints = ["spin_port", "spin_starboard"]
radius = { spin_port = 0.1, spin_starboard = 0.2 }
[thrusters]
frames = ["nozzle"]
direction = [0.0, 0.0, 2.0]
maximum_thrust = 5.0
"""


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    """A robot that shares no name with M4; the path of its TOML description."""
    (tmp_path / "cart.urdf").write_text(CART)
    (tmp_path / "cart.toml").write_text(CART_TOML)
    return tmp_path / "cart.toml"


def test_any_robot_loads(cart: Path) -> None:
    robot = load_robot(cart)
    assert robot.name == "cart"  # the file's stem, as its TOML gives no name
    port, starboard = robot.wheels
    assert (port.radius, starboard.radius) == (0.1, 0.2)
    assert port.continuous
    assert not starboard.continuous
    np.testing.assert_allclose(port.axis_in_joint, [0.6, 0.0, 0.8], atol=1e-15)
    np.testing.assert_allclose(starboard.axis_in_joint, [0.0, 0.0, -1.0], atol=1e-15)
    (nozzle,) = robot.thrusters
    np.testing.assert_allclose(nozzle.direction_in_joint, [1.0, 0.0, 0.0], atol=1e-15)  # a unit vector
    np.testing.assert_allclose(nozzle.position_in_joint, [0.0, 0.0, 0.3])
    assert robot.balance is None
    assert dict(robot.postures) == {}


def test_link_is_meant_where_a_joint_has_the_same_name(cart: Path) -> None:
    robot = load_robot(cart)
    assert robot.model.frames[robot.frame_id("nozzle")].type.name == "BODY"


def test_urdf_takes_the_toml_beside_it(cart: Path) -> None:
    assert len(load_robot(cart.with_suffix(".urdf")).wheels) == 2


def test_bare_urdf_loads_without_a_description(cart: Path) -> None:
    cart.unlink()
    robot = load_robot(str(cart.with_suffix(".urdf")))
    assert robot.wheels == ()
    assert robot.mass == pytest.approx(3.0)
    assert set(robot.files) == {"urdf"}


def test_motor_and_balance_that_are_not_described_are_asked_for(cart: Path) -> None:
    robot = load_robot(cart)
    with pytest.raises(RobotDescriptionError, match=r"\[motor\]"):
        _ = robot.motor
    with pytest.raises(RobotDescriptionError, match=r"\[balance\]"):
        robot.require_balance()


def test_files_are_hashed(m4: Robot) -> None:
    assert set(m4.files) == set(m4.file_hashes) == {"toml", "urdf", "srdf"}
    assert all(len(digest) == 64 for digest in m4.file_hashes.values())


def test_hash_follows_the_content(m4: Robot, m4_copy: Path) -> None:
    copy = load_robot(m4_copy)
    assert dict(copy.file_hashes) == dict(m4.file_hashes)
    m4_copy.write_text(m4_copy.read_text() + "\n# a comment\n")
    changed = load_robot(m4_copy)
    assert changed.file_hashes["toml"] != m4.file_hashes["toml"]
    assert changed.file_hashes["urdf"] == m4.file_hashes["urdf"]


@pytest.mark.parametrize(
    ("lookup", "kind", "valid"),
    [
        (lambda robot: robot.posture("mipp"), "posture", "mip_sitting"),
        (lambda robot: robot.wheel("wheel"), "wheel", "rear_left_wheel"),
        (lambda robot: robot.thruster("front"), "thruster", "front_left_thruster"),
        (lambda robot: robot.servo("front_left_wheel"), "servo", "front_left_hip_frontal"),
        (lambda robot: robot.contact_point("nose"), "contact point", "skid_rear_left"),
        (lambda robot: robot.frame_id("imux"), "frame", "imu"),
        (lambda robot: robot.joint_id("hip"), "joint", "front_left_hip_sagittal"),
    ],
)
def test_unknown_names_raise_and_list_the_valid_ones(m4: Robot, lookup: object, kind: str, valid: str) -> None:
    with pytest.raises(UnknownNameError, match=f"unknown {kind} ") as caught:
        lookup(m4)  # type: ignore[operator]
    assert caught.value.kind == kind
    assert valid in caught.value.valid
    assert valid in str(caught.value)


def test_known_names_are_found(m4: Robot) -> None:
    assert m4.model.frames[m4.frame_id("imu")].name == "imu"
    assert m4.model.names[m4.joint_id("rear_left_wheel")] == "rear_left_wheel"
    assert m4.wheel("rear_left_wheel").index_v == m4.model.joints[m4.joint_id("rear_left_wheel")].idx_v


def test_postures_hold_full_configurations(m4: Robot) -> None:
    for posture in m4.postures.values():
        assert posture.configuration.shape == (m4.model.nq,)
        np.testing.assert_array_equal(posture.configuration[:7], [0, 0, 0, 0, 0, 0, 1])
        for wheel in m4.wheels:
            np.testing.assert_array_equal(posture.configuration[wheel.index_q : wheel.index_q + 2], [1, 0])
    mip = m4.posture("mip").configuration
    assert mip[m4.servo("rear_left_hip_sagittal").index_q] == pytest.approx(math.pi / 2.0)


def test_postures_cannot_be_changed_by_accident(m4: Robot) -> None:
    with pytest.raises(ValueError, match="read-only"):
        m4.posture("mip").configuration[0] = 1.0


def test_robot_pickles_in_parts(m4: Robot) -> None:
    """Sweeps send robots to other processes as a path and load them there; the models themselves pickle too."""
    assert pickle.loads(pickle.dumps(m4.model)) == m4.model


def test_a_robot_travels_light_without_what_is_only_seen(m4: Robot) -> None:
    light = m4.without_visuals()
    assert light.visual_model.ngeoms == 0 < m4.visual_model.ngeoms
    packed = pickle.dumps(light)
    assert len(packed) < 0.05 * len(pickle.dumps(m4))
    there = pickle.loads(packed)
    assert there.model == m4.model
    assert there.collision_model.ngeoms == m4.collision_model.ngeoms
    assert there.file_hashes == m4.file_hashes


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nowhere.toml", "no such file"),
        ("nowhere.urdf", "no such file"),
        (".", "not a file"),
        ("cart.txt", "cannot tell what this is"),
    ],
)
def test_paths_that_are_no_robot(cart: Path, name: str, message: str) -> None:
    (cart.parent / "cart.txt").write_text("")
    with pytest.raises(RobotDescriptionError, match=message):
        load_robot(cart.parent / name)


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.parametrize(
    ("suffix", "old", "new", "message"),
    [
        (".toml", 'urdf = "m4.urdf"', 'urdf = "m5.urdf"', r"m5.urdf: no such file"),
        (".toml", 'srdf = "m4.srdf"', 'srdf = "m5.srdf"', r"m5.srdf: no such file"),
        (
            ".toml",
            'joints = ["front_left_wheel",',
            'joints = ["front_wheel",',
            r"unknown joint 'front_wheel'.*valid: ",
        ),
        (".toml", 'frames = ["front_left_thruster",', 'frames = ["nose",', "unknown frame 'nose'"),
        (".toml", '"skid_front_left",', '"skid",', "unknown frame 'skid'"),
        (".toml", '"front_left_hip_frontal",', '"hip",', "unknown joint 'hip'"),
        (".toml", '"front_left_hip_frontal",', '"front_left_wheel",', "is continuous; a servo needs"),
        (".toml", '"front_left_hip_frontal",', '"root_joint",', "6 degrees of freedom, not one"),
        (".toml", 'posture = "mip"', 'posture = "up"', "unknown posture 'up'.*valid: ugv, crouch"),
        (".toml", 'srdf = "m4.srdf"', "", r"posture 'mip', but \[robot\] has no srdf; postures are the <group_state>"),
        (".toml", 'drive_wheels = ["rear_left_wheel"', 'drive_wheels = ["rear_wheel"', "unknown wheel 'rear_wheel'"),
        (
            ".toml",
            'thrusters = ["front_left_thruster"',
            'thrusters = ["imu"',
            r"\[balance\].*valid: front_left",
        ),
        (".srdf", 'name="ugv"', 'name="mip"', "two group_states are called 'mip'"),
        (".srdf", 'name="ugv" group', "group", "a group_state has no name"),
        (".srdf", "1.5707963267948966", "ninety", "must have a finite number as its value, got 'ninety'"),
        (".srdf", "1.5707963267948966", "nan", "must have a finite number"),
        (".srdf", 'joint name="rear_left_hip_frontal"', 'joint name="tail"', "unknown joint 'tail'.*posture 'ugv'"),
        (".srdf", "</robot>", "", "not valid XML"),
    ],
)
def test_errors_name_file_and_what_would_be_valid(m4_copy: Path, suffix: str, old: str, new: str, message: str) -> None:
    path = m4_copy.with_suffix(suffix)
    change(path, old, new)
    with pytest.raises(RobotDescriptionError, match=message) as caught:
        load_robot(m4_copy)
    assert str(m4_copy.parent) in str(caught.value)


def test_joint_cannot_be_wheel_and_servo(cart: Path) -> None:
    cart.write_text(CART_TOML + '[servos]\njoints = ["spin_starboard"]\nstiffness = 1\ndamping = 1\n')
    with pytest.raises(RobotDescriptionError, match=r"'spin_starboard' is listed both under \[wheels\]"):
        load_robot(cart)


def test_revolute_wheel_without_limits_is_refused(cart: Path) -> None:
    """Pinocchio reads missing limits as 0..0 and says nothing."""
    change(cart.with_suffix(".urdf"), 'lower="-9" upper="9" ', "")
    with pytest.raises(RobotDescriptionError, match=r"'spin_starboard' has limits 0..0 and cannot turn; make it 'cont"):
        load_robot(cart)


def test_sliding_joint_is_no_wheel(cart: Path) -> None:
    change(cart.with_suffix(".urdf"), 'type="revolute"', 'type="prismatic"')
    with pytest.raises(RobotDescriptionError, match="'spin_starboard' slides and cannot be a wheel"):
        load_robot(cart)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ('<mass value="0.5"/>', '<mass value="-0.5"/>', "negative mass"),
        ('<mass value="0.5"/>', "", "<inertial> has no <mass>"),
        ('<mass value="0.5"/>', '<mass value="heavy"/>', "is not one finite number"),
        ('izz="0.01"', 'izz="-0.01"', "not positive definite"),
        ('izz="0.01"', 'izz="1e-2 kg"', "is not one finite number"),
    ],
)
def test_urdf_that_pinocchio_takes_silently_is_refused(cart: Path, old: str, new: str, what: str) -> None:
    """Pinocchio loads each of these, some with a mass less than the file's, and then moves them absurdly."""
    change(cart.with_suffix(".urdf"), old, new)
    with pytest.raises(InvalidUrdfError, match="masses or inertias are not usable") as caught:
        load_robot(cart)
    assert any(what in finding.what for finding in caught.value.findings)


def test_massless_moving_link_is_refused(cart: Path) -> None:
    text = cart.with_suffix(".urdf").read_text()
    start = text.index('<link name="port">')
    end = text.index("</link>", start) + len("</link>")
    cart.with_suffix(".urdf").write_text(text[:start] + '<link name="port"/>' + text[end:])
    with pytest.raises(InvalidUrdfError, match=r"joint 'spin_port' .* moves no mass"):
        load_robot(cart)


def test_point_mass_on_its_own_axis_is_refused(cart: Path) -> None:
    change(cart.with_suffix(".urdf"), 'ixx="0.01" iyy="0.01" izz="0.01"', 'ixx="0" iyy="0" izz="0"')
    with pytest.raises(InvalidUrdfError, match="joint 'spin_port': moves no inertia"):
        load_robot(cart)


def test_refused_urdf_says_why(cart: Path) -> None:
    change(cart.with_suffix(".urdf"), ' type="revolute"', ' type="hinge"')
    with pytest.raises(InvalidUrdfError, match=r"joint 'spin_starboard' .*: unknown joint type 'hinge'") as caught:
        load_robot(cart)
    assert isinstance(caught.value, M4Error)
    assert caught.value.urdf == cart.with_suffix(".urdf")


def test_robots_of_others_load(example_robots: Path) -> None:
    iris = load_robot(example_robots / "iris_description/robots/iris.urdf")
    assert iris.mass == pytest.approx(1.535)
    assert iris.visual_model.ngeoms > 0


def test_what_is_only_seen_may_be_missing(tmp_path: Path) -> None:
    """A URDF without its visual meshes has the same dynamics, and shows what collides."""
    source = bundled_description().with_suffix(".urdf")
    alone = tmp_path / "alone.urdf"
    alone.write_text(source.read_text())
    robot = load_robot(alone)
    assert robot.mass == pytest.approx(6.0)
    shown = {body.name for body in robot.visual_model.geometryObjects}
    assert shown == {body.name for body in robot.collision_model.geometryObjects}
    assert {finding.severity for finding in diagnose_urdf(alone) if "visual mesh" in finding.what} == {"warning"}
