"""The bundled M4: its masses, its signs, and the pendulum that its balancing posture makes."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from m4_dynamics.robot.consistency import consistency_findings, self_collisions
from m4_dynamics.robot.diagnosis import diagnose_urdf
from m4_dynamics.robot.inertia import inertia_findings
from m4_dynamics.robot.loading import bundled_description
from m4_dynamics.robot.robot import Robot


def test_urdf_is_what_its_generator_writes(tmp_path: Path) -> None:
    script = bundled_description().with_name("generate_m4.py")
    if not script.is_file():
        pytest.skip("the generator is not part of an installed package")
    written = tmp_path / "written.urdf"
    subprocess.run([sys.executable, str(script), "--output", str(written)], check=True, capture_output=True)
    assert bundled_description().with_name("m4.urdf").read_text(encoding="utf-8") == written.read_text(encoding="utf-8")


def test_meshes_are_what_their_generator_writes(tmp_path: Path) -> None:
    folder = bundled_description().parent
    script = folder / "generate_meshes.py"
    if not script.is_file():
        pytest.skip("the generator is not part of an installed package")
    subprocess.run([sys.executable, str(script), "--output", str(tmp_path)], check=True, capture_output=True)
    committed = {path.name: path.read_bytes() for path in (folder / "meshes").iterdir()}
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == committed
    assert sum(map(len, committed.values())) < 300e3


def test_every_mesh_is_used(m4: Robot) -> None:
    used = {Path(body.meshPath) for body in m4.visual_model.geometryObjects}
    assert used == set((bundled_description().parent.resolve() / "meshes").iterdir())


def box_of(model: pin.GeometryModel, joint: int) -> np.ndarray:
    """The box around all that moves with a joint, in the joint's axes: its low and its high corner, shape (2, 3)."""
    corners = []
    for body in model.geometryObjects:
        if body.parentJoint == joint:
            body.geometry.computeLocalAABB()
            local = body.geometry.aabb_local
            ends = np.array([local.min_, local.max_])
            for corner in itertools.product((0, 1), repeat=3):
                corners.append(body.placement.act(ends[corner, range(3)]))
    return np.array([np.min(corners, axis=0), np.max(corners, axis=0)])


def test_meshes_fill_the_collision_shapes(m4: Robot) -> None:
    """What is seen is what collides: no link's meshes stand out by more than a knuckle or leave its shapes empty."""
    for joint in range(1, m4.model.njoints):
        name = m4.model.names[joint]
        seen, solid = box_of(m4.visual_model, joint), box_of(m4.collision_model, joint)
        # The legs' boxes end 15 mm short of the hip axis, where the plates have their round knuckles, 20 mm in radius.
        allowed = 0.036 if name.endswith("sagittal") else 0.010 if name.endswith("frontal") else 0.002
        np.testing.assert_allclose(seen, solid, atol=allowed, err_msg=name)


def test_colours_tell_front_from_rear_and_pushing_from_idle_propellers(m4: Robot) -> None:
    assert m4.balance is not None
    colours: dict[str, dict[str, set[tuple[float, ...]]]] = {}
    for body in m4.visual_model.geometryObjects:
        joint = str(m4.model.names[body.parentJoint])
        part = Path(body.meshPath).stem
        colours.setdefault(part, {}).setdefault(joint.split("_")[0], set()).add(tuple(body.meshColor))
    for part in ("shroud", "sagittal_leg", "frontal_bracket", "propeller"):
        assert len(colours[part]["front"]) == len(colours[part]["rear"]) == 1
        assert colours[part]["front"] != colours[part]["rear"], part
    assert all(frame.startswith("front") for frame in m4.balance.thrusters)


def test_thirteen_bodies_weigh_six_kilograms(m4: Robot) -> None:
    masses = [inertia.mass for inertia in m4.model.inertias][1:]
    assert len(masses) == 13
    assert min(masses) > 0.0
    assert m4.mass == pytest.approx(6.0, abs=1e-12)


def test_inertias_are_those_of_real_bodies(m4: Robot) -> None:
    for inertia in list(m4.model.inertias)[1:]:
        assert inertia_findings(inertia.mass, inertia.inertia, "body") == []
        assert np.linalg.eigvalsh(inertia.inertia)[0] > 0.0


def test_nothing_is_wrong_with_it(m4: Robot) -> None:
    assert diagnose_urdf(m4.files["urdf"]) == ()
    assert consistency_findings(m4) == ()


def test_no_posture_makes_bodies_collide(m4: Robot) -> None:
    assert len(m4.collision_model.collisionPairs) > 100
    for posture in m4.postures.values():
        assert self_collisions(m4, posture.configuration) == [], posture.name


def test_front_shrouds_would_collide_with_the_legs_straight_ahead(m4: Robot) -> None:
    """Why the pendulum's front legs stand at 57.7 deg, and a sign that collisions are seen at all."""
    configuration = np.array(m4.posture("mip").configuration)
    for side in ("left", "right"):
        configuration[m4.servo(f"front_{side}_hip_sagittal").index_q] = -math.pi / 2.0
    names = {name for pair in self_collisions(m4, configuration) for name in pair}
    assert names >= {"front_left_wheel_link_0", "front_right_wheel_link_0"}


def test_robot_is_symmetric_about_its_sagittal_plane(m4: Robot) -> None:
    for posture in m4.postures.values():
        data = m4.model.createData()
        com = pin.centerOfMass(m4.model, data, posture.configuration)
        if posture.name != "quadruped":  # its legs are not
            assert com[1] == pytest.approx(0.0, abs=1e-12), posture.name


def test_positive_frontal_angle_raises_every_leg_outboard(m4: Robot) -> None:
    data = m4.model.createData()
    pin.forwardKinematics(m4.model, data, m4.posture("ugv").configuration)
    down = {wheel.joint: data.oMi[wheel.joint_id].translation.copy() for wheel in m4.wheels}
    pin.forwardKinematics(m4.model, data, m4.posture("crouch").configuration)
    for wheel in m4.wheels:
        side = 1.0 if "left" in wheel.joint else -1.0
        raised = data.oMi[wheel.joint_id].translation
        assert raised[2] > down[wheel.joint][2] + 0.05
        assert side * raised[1] > side * down[wheel.joint][1] + 0.05


def test_positive_sagittal_angle_swings_every_leg_backwards(m4: Robot) -> None:
    configuration = np.array(m4.posture("ugv").configuration)
    for servo in m4.servos:
        if "sagittal" in servo.joint:
            configuration[servo.index_q] = 0.1
    data = m4.model.createData()
    pin.forwardKinematics(m4.model, data, configuration)
    for wheel in m4.wheels:
        hip = 0.2225 if "front" in wheel.joint else -0.2225
        assert data.oMi[wheel.joint_id].translation[0] < hip - 0.01


def thrust_directions(robot: Robot, posture: str) -> dict[str, np.ndarray]:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.posture(posture).configuration)
    return {
        thruster.frame: data.oMi[thruster.joint_id].rotation @ thruster.direction_in_joint
        for thruster in robot.thrusters
    }


def test_thrusters_push_outboard_with_the_legs_down(m4: Robot) -> None:
    for frame, direction in thrust_directions(m4, "ugv").items():
        outboard = [0.0, 1.0 if "left" in frame else -1.0, 0.0]
        np.testing.assert_allclose(direction, outboard, atol=1e-15)


def test_all_thrusters_push_along_the_back_as_a_quadcopter(m4: Robot) -> None:
    for direction in thrust_directions(m4, "uas").values():
        np.testing.assert_allclose(direction, [0.0, 0.0, 1.0], atol=1e-15)


@pytest.mark.parametrize("posture", ["mip", "mip_sitting"])
def test_only_the_front_thrusters_push_along_the_back_as_a_pendulum(m4: Robot, posture: str) -> None:
    assert m4.balance is not None
    for frame, direction in thrust_directions(m4, posture).items():
        along_the_back = abs(direction[2] - 1.0) < 1e-12
        assert along_the_back == (frame in m4.balance.thrusters), frame


def test_thrust_and_propeller_axis_depend_on_the_frontal_joint_only(m4: Robot) -> None:
    """Thrust frames are fixed to the legs: neither the sagittal joint nor the spinning wheel turns them."""
    rng = np.random.default_rng(3)
    data = m4.model.createData()
    for _ in range(10):
        configuration = np.array(m4.posture("crouch").configuration)
        for servo in m4.servos:
            if "sagittal" in servo.joint:
                configuration[servo.index_q] = rng.uniform(-1.5, 1.5)
        for wheel in m4.wheels:
            angle = rng.uniform(-math.pi, math.pi)
            configuration[wheel.index_q : wheel.index_q + 2] = math.cos(angle), math.sin(angle)
        pin.forwardKinematics(m4.model, data, configuration)
        for thruster, wheel in zip(m4.thrusters, m4.wheels, strict=True):
            direction = data.oMi[thruster.joint_id].rotation @ thruster.direction_in_joint
            side = 1.0 if "left" in thruster.frame else -1.0
            expected = [0.0, side * math.cos(math.radians(40.0)), math.sin(math.radians(40.0))]
            np.testing.assert_allclose(direction, expected, atol=1e-12)
            axis = data.oMi[wheel.joint_id].rotation @ wheel.axis_in_joint
            np.testing.assert_allclose(np.abs(axis @ direction), 1.0, atol=1e-12)
            centre = data.oMi[thruster.joint_id].act(thruster.position_in_joint)
            np.testing.assert_allclose(centre, data.oMi[wheel.joint_id].translation, atol=1e-12)


def test_pendulum_has_the_expected_figures(m4: Robot) -> None:
    """Mass, CoM, thrust point and inertia in the balancing posture, from the rear axle, summed up by hand."""
    data = m4.model.createData()
    pin.forwardKinematics(m4.model, data, m4.posture("mip").configuration)
    assert m4.balance is not None
    drive = [m4.wheel(joint).joint_id for joint in m4.balance.drive_wheels]
    axle = np.mean([data.oMi[joint].translation for joint in drive], axis=0)
    bodies = [
        data.oMi[joint].act(m4.model.inertias[joint]) for joint in range(1, m4.model.njoints) if joint not in drive
    ]
    mass = sum(body.mass for body in bodies)
    com = sum(body.mass * body.lever for body in bodies) / mass
    inertia = sum(
        body.inertia[1, 1] + body.mass * ((body.lever[0] - com[0]) ** 2 + (body.lever[2] - com[2]) ** 2)
        for body in bodies
    )
    thrust = np.mean(
        [
            data.oMi[thruster.joint_id].act(thruster.position_in_joint)
            for thruster in map(m4.thruster, m4.balance.thrusters)
        ],
        axis=0,
    )
    assert mass == pytest.approx(5.095, abs=1e-9)
    # Standing, the base's x axis points up and its z axis forward.
    np.testing.assert_allclose((com - axle)[[2, 0]], [0.021, 0.447], atol=5e-4)
    np.testing.assert_allclose((thrust - axle)[[2, 0]], [0.114, 0.744], atol=5e-4)
    assert inertia == pytest.approx(0.305, rel=0.01)
    assert pytest.approx(sum(m4.model.inertias[joint].inertia[1, 1] for joint in drive)) == 2.0 * 0.002


def test_two_thrusters_give_the_papers_greatest_thrust(m4: Robot) -> None:
    assert m4.balance is not None
    total = sum(m4.thruster(frame).maximum_thrust for frame in m4.balance.thrusters)
    assert total == pytest.approx(43.2)
    assert m4.thrusters[0].maximum_thrust == pytest.approx(2.2 * 9.81, rel=2e-3)


@pytest.mark.parametrize("posture", ["ugv", "mip"])
def test_servos_leave_no_oscillation_of_the_robot_on_its_hips(m4: Robot, posture: str) -> None:
    """Modes of M q'' + D q' + K q = 0 with the wheels braked: well damped, settled within 0.1 s."""
    model = m4.model
    mass = pin.crba(model, model.createData(), m4.posture(posture).configuration)
    mass = np.triu(mass) + np.triu(mass, 1).T
    stiffness, damping = np.zeros_like(mass), np.zeros_like(mass)
    for servo in m4.servos:
        stiffness[servo.index_v, servo.index_v] = servo.stiffness
        damping[servo.index_v, servo.index_v] = servo.damping
    free = [index for index in range(model.nv) if index not in {wheel.index_v for wheel in m4.wheels}]
    mass, stiffness, damping = (matrix[np.ix_(free, free)] for matrix in (mass, stiffness, damping))
    size = len(free)
    system = np.block(
        [
            [np.zeros((size, size)), np.eye(size)],
            [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)],
        ]
    )
    modes = np.linalg.eigvals(system)
    moving = modes[np.abs(modes) > 1.0]  # the rest is the floating base's rigid motion
    assert len(moving) == 2 * len(m4.servos)
    assert (-moving.real / np.abs(moving)).min() > 0.7
    assert (-moving.real).min() > 30.0  # three time constants in 0.1 s


def test_assumed_values_are_marked_with_a_reason(m4: Robot) -> None:
    assumed = {assumption.key: assumption for assumption in m4.assumptions}
    assert assumed["motor.torque_constant"].value == m4.motor.torque_constant == 6.0
    assert assumed["motor.back_emf_constant"].value == m4.motor.back_emf_constant == 0.4
    for key in ("thrusters.moment_ratio", "servos.stiffness", "ground.friction_static"):
        assert key in assumed
    assert all(len(assumption.reason) > 15 for assumption in m4.assumptions)
