"""A made-up climb with the layout of a real trajectory, and a real browser."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pinocchio as pin
import pytest
import xarray

from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot

SLOPE = np.deg2rad(45.0)
FRICTION = 0.8
CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM_FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="session")
def make_climb(robot: Robot) -> Callable[..., xarray.Dataset]:
    """Builds a climb of any length that looks like a real one, though no law of motion is behind it."""

    def make(duration: float = 4.0, rate: float = 200.0) -> xarray.Dataset:
        return synthetic_climb(robot, duration, rate)

    return make


@pytest.fixture(scope="session")
def climb(make_climb: Callable[..., xarray.Dataset]) -> xarray.Dataset:
    return make_climb()


def synthetic_climb(robot: Robot, duration: float, rate: float) -> xarray.Dataset:
    """A smooth climb of a 45 deg slope in the balancing posture.

    Args:
        robot: A robot that balances.
        duration: Length [s].
        rate: Sampling rate [Hz].

    Returns:
        A trajectory.
    """
    balance = robot.require_balance()
    time = np.arange(0.0, duration + 0.5 / rate, 1.0 / rate)
    wheels = [robot.wheel(joint) for joint in balance.drive_wheels]
    radius = wheels[0].radius
    ramp = np.clip(np.minimum(time - 0.5, duration - 0.7 - time) / 0.8, 0.0, 1.0)
    speed = 0.3 * ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    travel = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))])
    ring = np.exp(-3.0 * time) * np.cos(6.0 * time)
    pitch_reference = np.deg2rad(-20.0) - 0.15 * np.gradient(speed, time)
    pitch = pitch_reference + np.deg2rad(5.0) * ring
    wheel_angle_reference = travel / radius
    wheel_angle = wheel_angle_reference - 0.12 * ring
    heading = np.deg2rad(0.5) * np.exp(-2.0 * time)

    along, normal = np.array([np.cos(SLOPE), 0, np.sin(SLOPE)]), np.array([-np.sin(SLOPE), 0, np.cos(SLOPE)])
    posture = robot.posture(balance.posture).configuration
    upright = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # base x up, base z ahead
    data = robot.model.createData()
    thrusters = [robot.thruster(frame) for frame in balance.thrusters]
    names = [thruster.frame for thruster in robot.thrusters]
    configuration = np.empty((time.size, robot.model.nq))
    axle, com = np.empty((time.size, 3)), np.empty((time.size, 3))
    contact = np.full((time.size, len(robot.wheels), 3), np.nan)
    force = np.zeros((time.size, len(robot.wheels), 3))
    thrust = np.zeros((time.size, len(names)))
    total_thrust = 14.0 + 4.0 * ring + 2.0 * np.gradient(speed, time)
    weight = robot.mass * 9.81
    friction_force = weight * np.sin(SLOPE) - total_thrust * np.cos(pitch + SLOPE)
    normal_force = weight * np.cos(SLOPE) + total_thrust * np.sin(pitch + SLOPE)
    for index in range(time.size):
        q = posture.copy()
        rotation = pin.utils.rotate("z", heading[index]) @ pin.utils.rotate("y", pitch[index]) @ upright
        q[:3], q[3:7] = 0.0, pin.Quaternion(rotation).coeffs()
        for wheel in wheels:
            spin = -(wheel_angle[index] - pitch[index])
            q[wheel.index_q : wheel.index_q + 2] = np.cos(spin), np.sin(spin)
        pin.forwardKinematics(robot.model, data, q)
        centres = [np.array(data.oMi[wheel.joint_id].translation) for wheel in wheels]
        axle[index] = along * radius * wheel_angle[index] + normal * radius
        q[:3] = axle[index] - np.mean(centres, axis=0)
        configuration[index] = q
        com[index] = np.array(pin.centerOfMass(robot.model, data, q))
        for wheel, centre in zip(wheels, centres, strict=True):
            slot = robot.wheels.index(wheel)
            contact[index, slot] = centre + q[:3] - radius * normal
            force[index, slot] = 0.5 * (friction_force[index] * along + normal_force[index] * normal)
        for thruster in thrusters:
            thrust[index, names.index(thruster.frame)] = total_thrust[index] / len(thrusters)

    model_error = 0.6 * np.stack([np.sin(9.0 * time), np.cos(7.0 * time)], axis=1) * (0.3 + ring[:, None] ** 2)
    simulated = np.stack([friction_force, normal_force], axis=1)
    wheel_duty = np.zeros((time.size, len(robot.wheels)))
    duty = 0.6 + 0.05 * ring
    for sign, wheel in zip((-1.0, 1.0), wheels, strict=True):
        wheel_duty[:, robot.wheels.index(wheel)] = duty + sign * 2.0 * heading
    slip = np.abs(force[..., 0]) * 2e-6 * (1.0 + 50.0 * np.exp(-6.0 * time))[:, None]
    state = np.stack([wheel_angle, pitch, np.gradient(wheel_angle, time), np.gradient(pitch, time)], axis=1)
    reference = np.stack(
        [wheel_angle_reference, pitch_reference, speed / radius, np.gradient(pitch_reference, time)], axis=1
    )
    error = reference - state
    tracking = error**2 @ np.array([10.0, 1e4, 5.0, 25.0])
    variables: dict[str, tuple[tuple[str, ...], Any, str]] = {
        "configuration": (("time", "coordinate"), configuration, "m, 1, rad"),
        "velocity": (("time", "degree_of_freedom"), np.zeros((time.size, robot.model.nv)), "m/s, rad/s"),
        "state": (("time", "state_entry"), state, "rad, rad/s"),
        "state_estimated": (("time", "state_entry"), state, "rad, rad/s"),
        "state_reference": (("time", "state_entry"), reference, "rad, rad/s"),
        "inputs": (("time", "input_entry"), np.stack([duty, total_thrust], axis=1), "1, N"),
        "inputs_reference": (("time", "input_entry"), np.stack([0.6 + 0 * time, 14.0 + 0 * time], axis=1), "1, N"),
        "heading": (("time",), heading, "rad"),
        "wheel_duty": (("time", "wheel"), wheel_duty, "1"),
        "thrust": (("time", "thruster"), thrust, "N"),
        "contact_force_in_world": (("time", "wheel", "axis"), force, "N"),
        "contact_position_in_world": (("time", "wheel", "axis"), contact, "m"),
        "slip_speed": (("time", "wheel"), slip, "m/s"),
        "ground_force_model": (("time", "force_entry"), simulated + model_error, "N"),
        "ground_force_simulated": (("time", "force_entry"), simulated, "N"),
        "cost": (("time",), 8.0 * tracking + 0.02, "1"),
        "tracking_cost": (("time",), tracking + 1e-4, "1"),
        "slack": (("time",), 0 * time, "N"),
        "status": (("time",), np.zeros(time.size, dtype=int), "1"),
        "axle_position_in_world": (("time", "axis"), axle, "m"),
        "com_in_world": (("time", "axis"), com, "m"),
        "terrain_x": (("terrain_point",), np.array([-2.0, 4.0]) * along[0], "m"),
        "terrain_z": (("terrain_point",), np.array([-2.0, 4.0]) * along[2], "m"),
    }
    return xarray.Dataset(
        {
            name: (dims, values, {"units": units, "long_name": name})
            for name, (dims, values, units) in variables.items()
        },
        coords={
            "time": ("time", time, {"units": "s"}),
            "wheel": [wheel.joint for wheel in robot.wheels],
            "thruster": names,
        },
        attrs={
            "robot": robot.name,
            "slope_deg": 45.0,
            "friction_static": FRICTION,
            "controller": "default",
            "verdict": "climbed",
            "thrust_limit_N": sum(thruster.maximum_thrust for thruster in thrusters),
        },
    )


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Headless Chromium; without one the test is skipped, but in continuous integration (CI=true) it fails."""
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError:
        _no_browser("Playwright is not installed")
    program = next((path for path in map(shutil.which, CHROMIUM_NAMES) if path), None)
    if program is None:
        _no_browser(f"none of {', '.join(CHROMIUM_NAMES)} is installed")
    with sync_playwright() as playwright:
        try:
            running = playwright.chromium.launch(executable_path=program, args=CHROMIUM_FLAGS)
        except Error as error:  # for instance a stub that only offers to install the browser
            _no_browser(f"{program} does not start: {error.message.splitlines()[0]}")
        yield running
        running.close()


@pytest.fixture(scope="session")
def keep_picture() -> Callable[[Any, str], None]:
    """Keeps a screenshot of a page in a folder for whoever wants to look at it after the tests; it is not tracked."""
    folder = Path(os.environ.get("M4_ARTIFACTS", Path(__file__).parents[2] / "artifacts")) / "browser"

    def keep(page: Any, name: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=folder / f"{name}.png")

    return keep


def _no_browser(reason: str) -> NoReturn:
    message = f"no browser for this test: {reason}"
    if os.environ.get("CI") == "true":
        pytest.fail(message)
    pytest.skip(message)
