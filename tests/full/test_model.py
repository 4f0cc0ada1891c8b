"""Packing a robot and a terrain into a `FullModel`."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from random_states import random_configuration
from small_robots import block, rolling_disc

from m4_dynamics.errors import RobotDescriptionError
from m4_dynamics.full.dynamics import input_map, mass_matrix
from m4_dynamics.full.model import FullModel
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot


def test_robots_without_a_motor_have_free_wheels(tmp_path: Path) -> None:
    for robot in (rolling_disc(tmp_path, friction_static=0.5), block(tmp_path)):
        model = FullModel.build(robot)
        assert not model.wheel_motor.any()
        assert model.layout.size == len(robot.wheels)


def test_a_bare_urdf_has_dynamics(m4: Robot, tmp_path: Path) -> None:
    urdf = tmp_path / "bare.urdf"
    urdf.write_bytes(m4.files["urdf"].read_bytes())
    bare = FullModel.build(load_robot(urdf))
    q = pin.neutral(m4.model)
    np.testing.assert_array_equal(mass_matrix(bare, q), mass_matrix(FullModel.build(m4), q))
    assert input_map(bare, q).shape == (m4.model.nv, 0)


def test_a_root_that_is_no_free_flyer_is_refused(m4: Robot) -> None:
    fixed = dataclasses.replace(m4, model=pin.buildModelFromUrdf(str(m4.files["urdf"])))
    with pytest.raises(RobotDescriptionError, match=r"m4.*free-flyer"):
        FullModel.build(fixed)


def test_support_says_which_velocities_move_a_joint(m4_on_ground: FullModel, rng: np.random.Generator) -> None:
    model = m4_on_ground.robot.model
    q = random_configuration(model, rng)
    for joint in range(1, model.njoints):
        moving = np.abs(pin.computeJointJacobian(model, model.createData(), q, joint)).max(axis=0) > 0.0
        np.testing.assert_array_equal(m4_on_ground.support[joint].astype(bool), moving)


def test_poses_are_a_live_view_of_the_placements(m4_on_ground: FullModel, rng: np.random.Generator) -> None:
    model, data = m4_on_ground.robot.model, m4_on_ground.data
    for _ in range(3):
        pin.computeJointJacobians(model, data, random_configuration(model, rng))
        for joint in range(model.njoints):
            placement = data.oMi[joint]
            np.testing.assert_array_equal(m4_on_ground.poses[joint, :9].reshape(3, 3).T, placement.rotation)
            np.testing.assert_array_equal(m4_on_ground.poses[joint, 9:], placement.translation)


def test_drive_motor_is_shared_by_two_wheels(m4_on_ground: FullModel) -> None:
    motor = m4_on_ground.robot.motor
    for index, wheel in enumerate(m4_on_ground.robot.wheels):
        assert 2.0 * m4_on_ground.wheel_motor[index, 0] == motor.torque_constant, wheel.joint
        assert 2.0 * m4_on_ground.wheel_motor[index, 1] == motor.back_emf_constant, wheel.joint
