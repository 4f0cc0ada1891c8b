"""Shared figures of the reduced-model tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.reduction import Reduction, reduce_robot
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot


@pytest.fixture(scope="session")
def hand_pendulum() -> MipParameters:
    """M4 in MIP posture, by hand from its mass table."""
    return MipParameters(
        mass_body=5.095,
        mass_wheel=0.905,
        inertia_body=0.305,
        inertia_wheel=0.004,
        com_in_body=(0.021, 0.447),
        thrust_point_in_body=(0.114, 0.744),
        wheel_radius=0.125,
        torque_constant=6.0,
        back_emf_constant=0.4,
    )


@pytest.fixture
def rng() -> np.random.Generator:
    """Seeded random numbers."""
    return np.random.default_rng(20240607)


@pytest.fixture(scope="session")
def m4() -> Robot:
    """The bundled robot."""
    return load_robot()


@pytest.fixture(scope="session")
def m4_reduction(m4: Robot) -> Reduction:
    """The bundled robot's pendulum."""
    return reduce_robot(m4)


SCOOTER_URDF = """<robot name="scooter">
  <link name="frame">
    <inertial><origin xyz="0.01 0 0.3"/><mass value="4"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.12" iyz="0" izz="0.05"/></inertial>
    <collision><origin xyz="0 0 0.3"/><geometry><box size="0.2 0.3 0.6"/></geometry></collision>
  </link>
  <link name="wheel_a"><inertial><mass value="0.5"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.001"/></inertial></link>
  <link name="wheel_b"><inertial><mass value="0.5"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.001"/></inertial></link>
  <joint name="axle_a" type="continuous"><origin xyz="0 0.2 -0.05"/><axis xyz="0 1 0"/>
    <parent link="frame"/><child link="wheel_a"/></joint>
  <joint name="axle_b" type="continuous"><origin xyz="0 -0.2 -0.05"/><axis xyz="0 -1 0"/>
    <parent link="frame"/><child link="wheel_b"/></joint>
</robot>
"""

SCOOTER_SRDF = """<robot name="scooter"><group_state name="drive" group="all"/></robot>
"""

SCOOTER_TOML = """[robot]
name = "scooter"
urdf = "scooter.urdf"
srdf = "scooter.srdf"
[wheels]
joints = ["axle_a", "axle_b"]
radius = 0.1
[motor]
torque_constant = 3.0
back_emf_constant = 0.2
[balance]
posture = "drive"
drive_wheels = ["axle_a", "axle_b"]
"""


@pytest.fixture(scope="session")
def scooter_description(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A thrusterless two-wheeler whose wheel axes point opposite ways."""
    folder = tmp_path_factory.mktemp("scooter")
    for suffix, text in ((".urdf", SCOOTER_URDF), (".srdf", SCOOTER_SRDF), (".toml", SCOOTER_TOML)):
        (folder / f"scooter{suffix}").write_text(text)
    return folder / "scooter.toml"
