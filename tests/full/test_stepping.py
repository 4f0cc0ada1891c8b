"""The steppers' actuation, statistics, determinism, and what they refuse."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from random_states import random_configuration, random_velocity
from scenes import on_incline, placed
from small_robots import BLOCK_HALF_SIZE, DISC_RADIUS, block, rolling_disc

from m4_dynamics.errors import InvalidSettingError, NonFiniteError
from m4_dynamics.full import kernels
from m4_dynamics.full.dynamics import bias_forces, forward_dynamics, frame_jacobian, mass_matrix
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.stepping import ExplicitStepper, ImplicitStepper, SimulationDivergedError
from m4_dynamics.robot.robot import Robot

Array = NDArray[np.float64]
STEPPERS = [ImplicitStepper, ExplicitStepper]
Stepper = ImplicitStepper | ExplicitStepper


@pytest.mark.parametrize("stepper_type", STEPPERS)
def test_external_wrench_acts_on_the_base_in_world_axes(
    tmp_path: Path, stepper_type: type[Stepper], rng: np.random.Generator
) -> None:
    model = FullModel.build(block(tmp_path))
    stepper = stepper_type(model, 1e-3)
    q = random_configuration(model.robot.model, rng, height=5.0)
    v = random_velocity(model.robot.model, rng)
    stepper.reset(q, v)
    wrench = rng.uniform(-5.0, 5.0, 6)
    stepper.actuation.external_wrench[:] = wrench
    stepper.step()
    expected = frame_jacobian(model, q, "box").T @ wrench
    measured = mass_matrix(model, q) @ (stepper.velocity - v) / 1e-3 + bias_forces(model, q, v)
    np.testing.assert_allclose(measured, expected, atol=1e-9)


@pytest.mark.parametrize("stepper_type", STEPPERS)
def test_a_small_step_follows_the_dynamics(
    m4_in_air: FullModel, stepper_type: type[Stepper], rng: np.random.Generator
) -> None:
    """Thrust, motors, brakes and servos: (v+ - v) / dt tends to f(x, u) with u as the actuators' laws give it."""
    model, robot = m4_in_air, m4_in_air.robot
    q, v = random_configuration(robot.model, rng), random_velocity(robot.model, rng)
    stepper = stepper_type(model, 1e-8)
    stepper.reset(q, v)
    actuation = stepper.actuation
    actuation.servo_targets[:] = [q[s.index_q] for s in robot.servos] + rng.uniform(-0.01, 0.01, 8)
    actuation.wheel_duty[:], actuation.wheel_brake[:] = rng.uniform(-1.0, 1.0, 4), rng.uniform(0.0, 0.1, 4)
    actuation.thrust[:] = rng.uniform(0.0, 20.0, 4)
    u = np.zeros(model.layout.size)
    for i, servo in enumerate(robot.servos):
        torque = servo.stiffness * (actuation.servo_targets[i] - q[servo.index_q]) - servo.damping * v[servo.index_v]
        u[i] = np.clip(torque, -servo.effort_limit, servo.effort_limit)
    motor = robot.motor
    for i, wheel in enumerate(robot.wheels):
        own = 0.5 * (motor.torque_constant * actuation.wheel_duty[i] - motor.back_emf_constant * v[wheel.index_v])
        u[8 + i] = own - actuation.wheel_brake[i] * v[wheel.index_v]
    u[model.layout.thrusters] = actuation.thrust
    stepper.step()
    expected = forward_dynamics(model, q, v, u)
    np.testing.assert_allclose((stepper.velocity - v) / 1e-8, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())
    np.testing.assert_allclose(stepper.servo_torque, u[:8], rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(stepper.configuration, pin.integrate(robot.model, q, 1e-8 * v), atol=1e-12)


def test_a_step_takes_servos_and_motors_at_its_end(m4_in_air: FullModel, rng: np.random.Generator) -> None:
    """M (v+ - v) / dt + h = torques at (q + dt v+, v+), in every joint, at the size of step that is used."""
    model, robot, dt = m4_in_air, m4_in_air.robot, 1e-3
    q, v = random_configuration(robot.model, rng), random_velocity(robot.model, rng, scale=0.5)
    stepper = ImplicitStepper(model, dt)
    stepper.reset(q, v)
    actuation = stepper.actuation
    actuation.servo_targets += rng.uniform(-5e-3, 5e-3, 8)
    actuation.wheel_duty[:], actuation.wheel_brake[:] = rng.uniform(-1.0, 1.0, 4), rng.uniform(0.0, 0.1, 4)
    stepper.step()
    after = stepper.velocity
    torque = mass_matrix(model, q) @ (after - v) / dt + bias_forces(model, q, v)
    assert stepper.counters.servo_saturations == 0
    for i, servo in enumerate(robot.servos):
        error = actuation.servo_targets[i] - (q[servo.index_q] + dt * after[servo.index_v])
        expected = servo.stiffness * error - servo.damping * after[servo.index_v]
        assert torque[servo.index_v] == pytest.approx(expected, abs=1e-8), servo.joint
        assert stepper.servo_torque[i] == pytest.approx(expected, abs=1e-10)
    for i, wheel in enumerate(robot.wheels):
        motor = 0.5 * (robot.motor.torque_constant * actuation.wheel_duty[i])
        drag = 0.5 * robot.motor.back_emf_constant + actuation.wheel_brake[i]
        assert torque[wheel.index_v] == pytest.approx(motor - drag * after[wheel.index_v], abs=1e-8), wheel.joint
    np.testing.assert_allclose(torque[:6], 0.0, atol=1e-8)
    np.testing.assert_allclose(stepper.configuration, pin.integrate(robot.model, q, dt * after), atol=1e-14)


def test_a_free_wheel_runs_up_to_the_no_load_speed(m4_in_air: FullModel) -> None:
    """duty k1 / k2, reached exponentially with the wheel's own inertia over k2 / 2."""
    model, motor = m4_in_air, m4_in_air.robot.motor
    stepper = ImplicitStepper(model, 1e-3)
    stepper.reset(model.robot.posture("uas").configuration)
    stepper.actuation.wheel_duty[:] = (0.5, -0.5, 0.5, -0.5)
    stepper.step(400)
    wheels = [wheel.index_v for wheel in model.robot.wheels]
    no_load = 0.5 * motor.torque_constant / motor.back_emf_constant
    np.testing.assert_allclose(stepper.velocity[wheels], no_load * np.array([1, -1, 1, -1]), rtol=1e-3)


def test_servos_push_with_no_more_than_their_limit(m4_in_air: FullModel) -> None:
    stepper = ImplicitStepper(m4_in_air, 1e-3)
    stepper.reset(m4_in_air.robot.posture("ugv").configuration)
    stepper.actuation.servo_targets[1] = 1.0
    for _ in range(20):
        stepper.step()
        assert stepper.servo_torque[1] == m4_in_air.robot.servos[1].effort_limit
    assert stepper.counters.servo_saturations >= 20
    assert (np.abs(np.delete(stepper.servo_torque, 1)) <= 10.5).all()
    # It gets there, and holds, without chattering about the limit.
    stepper.step(1500)
    index = m4_in_air.robot.servos[1].index_q
    assert stepper.configuration[index] == pytest.approx(1.0, abs=0.02)
    saturations = stepper.counters.servo_saturations
    stepper.step(500)
    assert stepper.counters.servo_saturations == saturations


def test_statistics_of_a_sliding_disc(tmp_path: Path) -> None:
    """Skidding to a halt of its slip: distance, time and peak slip from the disc's closed form."""
    friction, start = 0.4, 2.0
    robot = rolling_disc(tmp_path, friction_static=friction, dynamic_fraction=1.0)
    stepper = ImplicitStepper(FullModel.build(robot), 1e-3)
    q, v = pin.neutral(robot.model), np.zeros(robot.model.nv)
    q[2], v[0] = DISC_RADIUS - 1e-4, start
    stepper.reset(q, v)
    stepper.step(400)
    # A uniform disc set down without spin slips for v / (3 mu g), over v^2 / (6 mu g), and rolls on at 2/3 v.
    time, distance = start / (3.0 * friction * 9.81), start**2 / (6.0 * friction * 9.81)
    for row in stepper.statistics:
        assert row[kernels.SLIP_SPEED_MAX] == pytest.approx(start, rel=0.01)
        assert row[kernels.SLIP_TIME] == pytest.approx(time, abs=3e-3)
        assert row[kernels.SLIP_DISTANCE] == pytest.approx(distance, rel=0.02)
        assert row[kernels.FRICTION_USE_MAX] == pytest.approx(1.0, abs=1e-6)
        assert row[kernels.AIR_TIME] == 0.0
        assert row[kernels.IMPULSE_X] == pytest.approx(-robot.mass * start / 3.0 / 2.0, rel=1e-3)
        assert row[kernels.IMPULSE_Z] == pytest.approx(robot.mass * 9.81 * 0.4 / 2.0, rel=0.01)
    assert stepper.velocity[0] == pytest.approx(2.0 / 3.0 * start, rel=1e-3)
    stepper.clear_peaks()
    stepper.step(10)
    for row in stepper.statistics:
        assert row[kernels.SLIP_SPEED_MAX] < robot.ground.stiction_speed
        assert row[kernels.FRICTION_USE_MAX] < 0.01
        assert row[kernels.NORMAL_FORCE_MIN] == pytest.approx(robot.mass * 9.81 / 2.0, rel=1e-3)
        assert row[kernels.SLIP_DISTANCE] == pytest.approx(distance, rel=0.02)


def test_joint_angles_are_counted_without_wrapping(tmp_path: Path) -> None:
    robot = rolling_disc(tmp_path, friction_static=0.5)
    stepper = ImplicitStepper(FullModel.build(robot), 1e-3)
    q, v = pin.neutral(robot.model), np.zeros(robot.model.nv)
    q[2], v[6:] = 10.0, (30.0, -20.0)
    stepper.reset(q, v)
    stepper.step(1000)
    np.testing.assert_allclose(stepper.statistics[:, kernels.JOINT_ANGLE], (30.0, -20.0), rtol=1e-9)
    for wheel, angle in zip(robot.wheels, (30.0, -20.0), strict=True):
        turned = stepper.configuration[wheel.index_q : wheel.index_q + 2]
        np.testing.assert_allclose(turned, (math.cos(angle), math.sin(angle)), atol=1e-9)
    np.testing.assert_allclose(stepper.statistics[:, kernels.AIR_TIME], 1.0)


@pytest.mark.parametrize("stepper_type", STEPPERS)
def test_same_inputs_give_the_same_bytes(m4: Robot, stepper_type: type[Stepper], rng: np.random.Generator) -> None:
    """Twice in one stepper, in another model, and with other work on the model's scratch memory between the steps."""
    slope = 0.3

    def run(stepper: Stepper, *, disturb: bool) -> bytes:
        stepper.reset(placed(stepper.model, "ugv", slope=slope, above=0.001))
        stepper.actuation.wheel_duty[:] = (0.4, 0.3, 0.4, 0.4)
        for _ in range(20):
            stepper.step(5)
            if disturb:
                q = random_configuration(m4.model, rng)
                forward_dynamics(stepper.model, q, random_velocity(m4.model, rng), np.zeros(16))
        return stepper.configuration.tobytes() + stepper.velocity.tobytes() + stepper.wheel_force_in_world.tobytes()

    dt = 1e-3 if stepper_type is ImplicitStepper else 1e-6
    first = stepper_type(on_incline(m4, slope), dt)
    expected = run(first, disturb=False)
    assert run(first, disturb=False) == expected
    assert run(stepper_type(on_incline(m4, slope), dt), disturb=True) == expected
    one_by_one = stepper_type(on_incline(m4, slope), dt)
    one_by_one.reset(placed(one_by_one.model, "ugv", slope=slope, above=0.001))
    one_by_one.actuation.wheel_duty[:] = (0.4, 0.3, 0.4, 0.4)
    one_by_one.step(100)
    assert one_by_one.configuration.tobytes() == expected[: m4.model.nq * 8]


def test_reset_forgets_everything(m4_on_ground: FullModel) -> None:
    stepper = ImplicitStepper(m4_on_ground)
    q = placed(m4_on_ground, "ugv")
    stepper.reset(q)
    stepper.actuation.thrust[:] = 3.0
    stepper.step(50)
    stepper.reset(q)
    assert stepper.time == 0.0
    assert not stepper.actuation.thrust.any()
    assert stepper.counters == (0, 0, 0, 0)
    assert not stepper.wheel_force_in_world.any()
    np.testing.assert_array_equal(stepper.configuration, q)
    np.testing.assert_array_equal(stepper.velocity, 0.0)
    # The state is the stepper's own copy.
    stepper.step()
    np.testing.assert_array_equal(q, placed(m4_on_ground, "ugv"))


@pytest.mark.parametrize("time_step", [0.0, -1e-3, 0.02, math.nan, math.inf])
def test_step_sizes_out_of_range_are_refused(m4_on_ground: FullModel, time_step: float) -> None:
    with pytest.raises(InvalidSettingError, match="time_step"):
        ImplicitStepper(m4_on_ground, time_step)


def test_wrong_states_and_counts_are_refused(m4_on_ground: FullModel) -> None:
    stepper = ImplicitStepper(m4_on_ground)
    q, v = placed(m4_on_ground, "ugv"), np.zeros(m4_on_ground.robot.model.nv)
    with pytest.raises(InvalidSettingError, match="configuration q"):
        stepper.reset(q[1:])
    with pytest.raises(InvalidSettingError, match="velocity v"):
        stepper.reset(q, v[1:])
    with pytest.raises(NonFiniteError, match="velocity v"):
        stepper.reset(q, v + np.inf)
    with pytest.raises(InvalidSettingError, match="count"):
        stepper.step(-1)
    assert stepper.time == 0.0


def test_divergence_is_named(m4_on_ground: FullModel) -> None:
    stepper = ImplicitStepper(m4_on_ground)
    stepper.reset(placed(m4_on_ground, "ugv"))
    stepper.require_bounded()
    stepper.velocity[m4_on_ground.robot.wheels[2].index_v] = np.nan
    with pytest.raises(SimulationDivergedError, match=m4_on_ground.robot.wheels[2].joint):
        stepper.require_bounded()
    stepper.velocity[:] = 0.0
    stepper.velocity[1] = -2e4
    with pytest.raises(SimulationDivergedError, match=r"root_joint.*-2e\+04"):
        stepper.require_bounded()


def test_impossible_inertia_shows_as_divergence(tmp_path: Path) -> None:
    robot = block(tmp_path)
    broken = robot.model.copy()
    broken.inertias[1] = pin.Inertia(-1.0, np.zeros(3), np.eye(3))
    stepper = ImplicitStepper(FullModel.build(dataclasses.replace(robot, model=broken)))
    q = pin.neutral(broken)
    q[2] = BLOCK_HALF_SIZE[2] + 1.0
    stepper.reset(q)
    stepper.step()
    assert stepper.counters.newton_failures == 1
    with pytest.raises(SimulationDivergedError):
        stepper.require_bounded()
