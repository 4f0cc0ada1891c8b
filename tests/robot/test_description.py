"""The TOML description: every mistake in it is named with its file, table, key and what would be valid."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from m4_dynamics.errors import RobotDescriptionError
from m4_dynamics.robot.description import read_description
from m4_dynamics.robot.robot import Ground

MINIMAL = '[robot]\nurdf = "robot.urdf"\n'


def read(folder: Path, text: str) -> object:
    path = folder / "robot.toml"
    path.write_text(text)
    return read_description(path)


def test_minimal_description_has_defaults(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(MINIMAL)
    description = read_description(path)
    assert description.name == "robot"
    assert description.urdf == tmp_path / "robot.urdf"
    assert description.srdf is None
    assert description.wheels == description.thrusters == description.servos == description.contact_points == ()
    assert description.motor is None
    assert description.balance is None
    assert description.ground == Ground()
    assert description.assumptions == ()


def test_one_number_serves_all_names_and_a_table_serves_each(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(
        MINIMAL
        + '[thrusters]\nframes = ["a", "b"]\nmaximum_thrust = 5\nmoment_ratio = { a = 0.018, b = -0.018 }\n'
        + "time_constant = 0.15\ndirection = [0, 1, 0]\n"
    )
    first, second = read_description(path).thrusters
    assert (first.maximum_thrust, second.maximum_thrust) == (5.0, 5.0)
    assert (first.moment_ratio, second.moment_ratio) == (0.018, -0.018)
    assert first.time_constant == 0.15
    assert first.direction == (0.0, 1.0, 0.0)


def test_assumed_values_are_looked_up(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(
        MINIMAL
        + "[motor]\ntorque_constant = 6.0\nback_emf_constant = 0.4\n"
        + '[assumed]\n"motor.torque_constant" = "not published"\n"motor" = "a whole table"\n'
    )
    first, second = read_description(path).assumptions
    assert (first.key, first.value, first.reason) == ("motor.torque_constant", 6.0, "not published")
    assert second.value == {"torque_constant": 6.0, "back_emf_constant": 0.4}


WHEELS = '[wheels]\njoints = ["a", "b"]\n'
MOTOR = "[motor]\ntorque_constant = 6\nback_emf_constant = 0.4\n"

MISTAKES = {
    "no robot table": ("", "the table [robot] is missing"),
    "not TOML": ("[robot\n", "not valid TOML"),
    "robot is no table": ("robot = 3\n", "[robot] must be a table, got the integer 3"),
    "no URDF": ("[robot]\n", "[robot] urdf is missing; expected a string"),
    "URDF is no string": ("[robot]\nurdf = 3\n", "[robot] urdf must be a non-empty string, got the integer 3"),
    "empty name": (MINIMAL + 'name = ""\n', "[robot] name must be a non-empty string, got the string ''"),
    "unknown table": (MINIMAL + "[wheel]\n", "unknown key 'wheel'; valid: robot, wheels"),
    "unknown key": (MINIMAL + "colour = 1\n", "[robot] unknown key 'colour'; valid: name, urdf, srdf"),
    "missing list": (MINIMAL + "[wheels]\nradius = 1\n", "[wheels] joints is missing; expected a list of names"),
    "no list": (MINIMAL + '[wheels]\njoints = "a"\n', "[wheels] joints must be a list of names, got the string 'a'"),
    "no names": (
        MINIMAL + "[wheels]\njoints = [1]\n",
        "[wheels] joints[0] must be a non-empty string",
    ),
    "repeated": (MINIMAL + '[wheels]\njoints = ["a", "a"]\nradius = 1\n', "[wheels] joints names 'a' more than once"),
    "missing number": (MINIMAL + WHEELS, "[wheels] radius is missing; expected a finite number above 0, or a table"),
    "zero": (MINIMAL + WHEELS + "radius = 0\n", "[wheels] radius must be a finite number above 0, got 0.0"),
    "negative": (MINIMAL + WHEELS + "radius = -0.1\n", "[wheels] radius must be a finite number above 0, got -0.1"),
    "not finite": (MINIMAL + WHEELS + "radius = nan\n", "[wheels] radius must be a finite number above 0, got nan"),
    "no number": (
        MINIMAL + WHEELS + 'radius = "big"\n',
        "[wheels] radius must be a finite number above 0",
    ),
    "boolean": (
        MINIMAL + WHEELS + "radius = true\n",
        "[wheels] radius must be a finite number above 0, got the bool",
    ),
    "one of each, wrong": (
        MINIMAL + WHEELS + "radius = { a = 1, b = 0 }\n",
        "[wheels] radius.b must be a",
    ),
    "one of each, missing": (MINIMAL + WHEELS + "radius = { a = 1 }\n", "[wheels] radius has no number for 'b'"),
    "one of each, unknown": (
        MINIMAL + WHEELS + "radius = { a = 1, b = 1, c = 1 }\n",
        "[wheels] radius names 'c', which is not in this table's list; valid: a, b",
    ),
    "no direction": (
        MINIMAL + '[thrusters]\nframes = ["a"]\nmaximum_thrust = 1\ndirection = [0, 1]\n',
        "[thrusters] direction must be a list of three numbers, got the list [0, 1]",
    ),
    "zero direction": (
        MINIMAL + '[thrusters]\nframes = ["a"]\nmaximum_thrust = 1\ndirection = [0, 0, 0]\n',
        "[thrusters] direction must not be zero",
    ),
    "negative lag": (
        MINIMAL + '[thrusters]\nframes = ["a"]\nmaximum_thrust = 1\ntime_constant = -1\n',
        "[thrusters] time_constant must be a finite number of at least 0, got -1.0",
    ),
    "servo without gain": (MINIMAL + '[servos]\njoints = ["a"]\ndamping = 1\n', "[servos] stiffness is missing"),
    "motor without gain": (MINIMAL + "[motor]\nback_emf_constant = 1\n", "[motor] torque_constant is missing"),
    "friction fraction": (
        MINIMAL + "[ground]\nfriction_dynamic_fraction = 1.1\n",
        "[ground] friction_dynamic_fraction must be a finite number of at least 0 and up to 1, got 1.1",
    ),
    "three drive wheels": (
        MINIMAL + MOTOR + '[balance]\nposture = "up"\ndrive_wheels = ["a", "b", "c"]\n',
        "[balance] drive_wheels must be a list of 2 names",
    ),
    "balance without motor": (
        MINIMAL + '[balance]\nposture = "up"\ndrive_wheels = ["a", "b"]\n',
        "[balance] needs a [motor] table",
    ),
    "assumed key that is not there": (
        MINIMAL + MOTOR + '[assumed]\n"motor.torque" = "why"\n',
        "[assumed] 'motor.torque' is not a key of this file",
    ),
    "assumed without a reason": (
        MINIMAL + MOTOR + '[assumed]\n"motor.torque_constant" = ""\n',
        "[assumed] 'motor.torque_constant' must be a non-empty string",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_named(tmp_path: Path, mistake: str) -> None:
    text, message = MISTAKES[mistake]
    with pytest.raises(RobotDescriptionError, match=re.escape(message)) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "robot.toml"))


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(RobotDescriptionError, match=r"nowhere.toml: no such file"):
        read_description(tmp_path / "nowhere.toml")


def test_file_that_is_not_text_is_named(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RobotDescriptionError, match="cannot be read"):
        read_description(path)
