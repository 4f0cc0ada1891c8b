"""The dynamics obey mechanics: Lagrange's equation, energy, power and momentum, checked by finite differences."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from finite_differences import along_flow, configuration_jacobian, placement_jacobian, time_derivative
from numpy.typing import NDArray
from random_states import random_configuration, random_velocity

from m4_dynamics.errors import InvalidSettingError, NonFiniteError, UnknownNameError
from m4_dynamics.full.dynamics import (
    bias_forces,
    centre_of_mass,
    energies,
    forward_dynamics,
    frame_jacobian,
    generalised_force,
    gravity_forces,
    ground_generalised_force,
    input_map,
    mass_matrix,
    state_derivative,
    thrust_map,
)
from m4_dynamics.full.model import FullModel
from m4_dynamics.robot.robot import Robot

Array = NDArray[np.float64]
STATES = 5


@pytest.fixture(scope="module")
def m4_with_reaction(m4: Robot, m4_in_air: FullModel) -> FullModel:
    """M4 in the air with propellers whose reaction moments differ."""
    ratios = (0.02, -0.01, 0.03, 0.0)
    thrusters = tuple(
        dataclasses.replace(thruster, moment_ratio=ratio) for thruster, ratio in zip(m4.thrusters, ratios, strict=True)
    )
    return FullModel.build(dataclasses.replace(m4, thrusters=thrusters), m4_in_air.terrain)


def random_inputs(model: FullModel, rng: np.random.Generator) -> Array:
    u: Array = rng.uniform(-5.0, 5.0, model.layout.size)
    u[model.layout.thrusters] = rng.uniform(0.0, 20.0, len(model.robot.thrusters))
    return u


def test_bias_is_the_one_of_lagranges_equation(m4_in_air: FullModel, rng: np.random.Generator) -> None:
    """h = M' v + ad* p - dT/dq + dU/dq, all from M(q) and U(q) alone (Hamel's form of Lagrange's equation)."""
    model = m4_in_air.robot.model
    at_rest = np.zeros(model.nv)
    for _ in range(STATES):
        q, v = random_configuration(model, rng), random_velocity(model, rng)
        mass_rate = time_derivative(model, lambda q, _: mass_matrix(m4_in_air, q), q, v, at_rest)
        mass_slopes = configuration_jacobian(model, lambda q: mass_matrix(m4_in_air, q), q)
        kinetic_slope = 0.5 * np.einsum("i,ijk,j->k", v, mass_slopes, v)
        potential_slope = configuration_jacobian(model, lambda q: energies(m4_in_air, q, at_rest).potential, q)
        momentum = mass_matrix(m4_in_air, q) @ v
        # The base twist is measured in turning axes.
        turning = np.zeros(model.nv)
        turning[:6] = pin.Motion(v[:6]).cross(pin.Force(momentum[:6])).vector
        expected = mass_rate @ v + turning - kinetic_slope + potential_slope
        np.testing.assert_allclose(bias_forces(m4_in_air, q, v), expected, rtol=0.0, atol=1e-7)
        np.testing.assert_allclose(gravity_forces(m4_in_air, q), potential_slope, rtol=0.0, atol=1e-7)


def test_forward_dynamics_solves_the_equation_of_motion(m4_on_ground: FullModel, rng: np.random.Generator) -> None:
    model = m4_on_ground.robot.model
    touching = 0
    for _ in range(STATES):
        q, v, u = random_configuration(model, rng), random_velocity(model, rng), random_inputs(m4_on_ground, rng)
        acceleration = forward_dynamics(m4_on_ground, q, v, u)
        ground = ground_generalised_force(m4_on_ground, q, v)
        touching += bool(np.abs(ground).max() > 0.0)
        left = mass_matrix(m4_on_ground, q) @ acceleration + bias_forces(m4_on_ground, q, v)
        right = input_map(m4_on_ground, q) @ u + ground
        np.testing.assert_allclose(left, right, rtol=0.0, atol=1e-10 * max(1.0, np.abs(right).max()))
        np.testing.assert_allclose(generalised_force(m4_on_ground, q, v, u), right, rtol=1e-12, atol=1e-10)
        np.testing.assert_array_equal(
            state_derivative(m4_on_ground, q, v, u), np.concatenate((v, acceleration)), strict=True
        )
    assert touching > 0


def test_energies_are_those_of_masses_and_heights(m4_in_air: FullModel, rng: np.random.Generator) -> None:
    robot = m4_in_air.robot
    for _ in range(STATES):
        q, v = random_configuration(robot.model, rng), random_velocity(robot.model, rng)
        kinetic, potential = energies(m4_in_air, q, v)
        assert kinetic == pytest.approx(0.5 * v @ mass_matrix(m4_in_air, q) @ v, rel=1e-12)
        assert potential == pytest.approx(robot.mass * 9.81 * centre_of_mass(m4_in_air, q)[2], rel=1e-12)
        assert energies(m4_in_air, q, v).total == kinetic + potential


def drift_of_energy(model: FullModel, q: Array, v: Array, *, duration: float, steps: int) -> float:
    """Largest change of the energy over a free motion, by the implicit midpoint rule on f(x, u)."""
    dt, pinocchio_model = duration / steps, model.robot.model
    inputs = np.zeros(model.layout.size)
    start = energies(model, q, v).total
    worst = 0.0
    for _ in range(steps):
        middle = v
        for _ in range(8):
            half_way = pin.integrate(pinocchio_model, q, 0.5 * dt * middle)
            rate = state_derivative(model, half_way, middle, inputs)
            middle = v + 0.5 * dt * rate[pinocchio_model.nv :]
        q, v = pin.integrate(pinocchio_model, q, dt * middle), 2.0 * middle - v
        worst = max(worst, abs(energies(model, q, v).total - start))
    return worst


def test_energy_is_conserved_without_ground_and_inputs(m4_in_air: FullModel, rng: np.random.Generator) -> None:
    model = m4_in_air.robot.model
    q, v = random_configuration(model, rng), random_velocity(model, rng)
    kinetic = energies(m4_in_air, q, v).kinetic
    coarse = drift_of_energy(m4_in_air, q, v, duration=0.2, steps=200)
    fine = drift_of_energy(m4_in_air, q, v, duration=0.2, steps=400)
    # The rule is of second order, so what is left is its own error.
    assert fine < 1e-4 * kinetic
    assert coarse / fine == pytest.approx(4.0, rel=0.1)


def test_power_balance(m4_with_reaction: FullModel, rng: np.random.Generator) -> None:
    """dE/dt along the motion = u^T B^T v, with thrust, reaction moments, servo and wheel torques."""
    model = m4_with_reaction.robot.model
    for _ in range(STATES):
        q, v, u = random_configuration(model, rng), random_velocity(model, rng), random_inputs(m4_with_reaction, rng)
        acceleration = forward_dynamics(m4_with_reaction, q, v, u)
        gained = time_derivative(model, lambda q, v: energies(m4_with_reaction, q, v).total, q, v, acceleration)
        power = u @ input_map(m4_with_reaction, q).T @ v
        assert float(gained) == pytest.approx(power, rel=1e-6, abs=1e-6)


def test_ground_gives_no_more_power_than_its_springs(m4_on_ground: FullModel, rng: np.random.Generator) -> None:
    """Damping and friction only take: the power of the ground is at most that of its springs, at any velocity."""
    model = m4_on_ground.robot.model
    touching = 0
    for _ in range(50):
        q, v = random_configuration(model, rng, height=0.2), random_velocity(model, rng)
        spring = ground_generalised_force(m4_on_ground, q, np.zeros(model.nv)) @ v
        power = ground_generalised_force(m4_on_ground, q, v) @ v
        assert power <= spring + 1e-9 * abs(spring)
        touching += bool(power < spring)
    assert touching > 10


def test_linear_momentum(m4_with_reaction: FullModel, rng: np.random.Generator) -> None:
    """m a_com = m g + sum of the thrusts, with a_com from positions alone."""
    robot, model = m4_with_reaction.robot, m4_with_reaction.robot.model
    data, step = model.createData(), 1e-5
    for _ in range(STATES):
        q, v, u = random_configuration(model, rng), random_velocity(model, rng), random_inputs(m4_with_reaction, rng)
        acceleration = forward_dynamics(m4_with_reaction, q, v, u)
        behind, here, ahead = (
            centre_of_mass(m4_with_reaction, along_flow(model, q, v, acceleration, time)[0])
            for time in (-step, 0, step)
        )
        acceleration_com = (ahead - 2.0 * here + behind) / step**2
        pin.framesForwardKinematics(model, data, q)
        force = np.array([0.0, 0.0, -9.81 * robot.mass])
        for thruster, thrust in zip(robot.thrusters, u[m4_with_reaction.layout.thrusters], strict=True):
            force += thrust * (data.oMf[thruster.frame_id].rotation @ (0.0, 0.0, 1.0))
        np.testing.assert_allclose(robot.mass * acceleration_com, force, rtol=0.0, atol=1e-4)


def test_angular_momentum(m4_with_reaction: FullModel, rng: np.random.Generator) -> None:
    """d/dt of the angular momentum about the centre of mass = moments of the thrusts and propeller reactions."""
    robot, model = m4_with_reaction.robot, m4_with_reaction.robot.model
    data = model.createData()

    def angular_momentum(q: Array, v: Array) -> Array:
        pin.forwardKinematics(model, data, q, v)
        com = pin.centerOfMass(model, data, q)
        total = np.zeros(3)
        for joint in range(1, model.njoints):
            inertia, rotation = model.inertias[joint], data.oMi[joint].rotation
            position = data.oMi[joint].act(inertia.lever)
            twist = pin.getVelocity(model, data, joint, pin.ReferenceFrame.LOCAL)
            speed = rotation @ (twist.linear + np.cross(twist.angular, inertia.lever))
            total += rotation @ inertia.inertia @ twist.angular + inertia.mass * np.cross(position - com, speed)
        return total

    for _ in range(STATES):
        q, v, u = random_configuration(model, rng), random_velocity(model, rng), random_inputs(m4_with_reaction, rng)
        acceleration = forward_dynamics(m4_with_reaction, q, v, u)
        rate = time_derivative(model, angular_momentum, q, v, acceleration)
        com = centre_of_mass(m4_with_reaction, q)
        pin.framesForwardKinematics(model, data, q)
        moment = np.zeros(3)
        for thruster, thrust in zip(robot.thrusters, u[m4_with_reaction.layout.thrusters], strict=True):
            placement = data.oMf[thruster.frame_id]
            force = thrust * (placement.rotation @ (0.0, 0.0, 1.0))
            moment += np.cross(placement.translation - com, force) + thruster.moment_ratio * force
        np.testing.assert_allclose(rate, moment, rtol=0.0, atol=1e-6 * max(1.0, np.abs(moment).max()))


def test_thrust_map_is_virtual_work(m4_with_reaction: FullModel, rng: np.random.Generator) -> None:
    robot, model = m4_with_reaction.robot, m4_with_reaction.robot.model
    data = model.createData()
    for _ in range(STATES):
        q = random_configuration(model, rng)
        columns = thrust_map(m4_with_reaction, q)
        pin.framesForwardKinematics(model, data, q)
        for index, thruster in enumerate(robot.thrusters):
            # M4's thrusters push along their frame's z axis.
            direction = data.oMf[thruster.frame_id].rotation @ (0.0, 0.0, 1.0)
            wrench = np.concatenate((direction, thruster.moment_ratio * direction))
            expected = placement_jacobian(model, thruster.frame_id, q).T @ wrench
            np.testing.assert_allclose(columns[:, index], expected, rtol=0.0, atol=1e-8)


def test_input_map_is_virtual_work(m4_in_air: FullModel, rng: np.random.Generator) -> None:
    robot, model, layout = m4_in_air.robot, m4_in_air.robot.model, m4_in_air.layout

    def angles(q: Array) -> Array:
        hips = [q[servo.index_q] for servo in robot.servos]
        wheels = [np.arctan2(q[wheel.index_q + 1], q[wheel.index_q]) for wheel in robot.wheels]
        return np.array(hips + wheels)

    q = random_configuration(model, rng)
    columns = input_map(m4_in_air, q)
    torques = columns[:, : layout.wheels.stop]
    np.testing.assert_allclose(torques, configuration_jacobian(model, angles, q).T, rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(columns[:, layout.thrusters], thrust_map(m4_in_air, q))
    assert [label.split()[0] for label in layout.labels] == ["torque"] * 12 + ["thrust"] * 4
    joints = [servo.joint for servo in robot.servos] + [wheel.joint for wheel in robot.wheels]
    for label, name in zip(layout.labels, joints + [thruster.frame for thruster in robot.thrusters], strict=True):
        assert name in label


def test_frame_jacobian(m4_in_air: FullModel, rng: np.random.Generator) -> None:
    model = m4_in_air.robot.model
    for frame in ("front_left_thruster", "skid_rear_right", "rear_left_wheel"):
        q = random_configuration(model, rng)
        expected = placement_jacobian(model, m4_in_air.robot.frame_id(frame), q)
        np.testing.assert_allclose(frame_jacobian(m4_in_air, q, frame), expected, rtol=0.0, atol=1e-8)


def test_mass_matrix_is_symmetric_and_positive_definite(m4_in_air: FullModel, rng: np.random.Generator) -> None:
    for _ in range(STATES):
        matrix = mass_matrix(m4_in_air, random_configuration(m4_in_air.robot.model, rng))
        np.testing.assert_array_equal(matrix, matrix.T)
        assert np.linalg.eigvalsh(matrix)[0] > 0.0


def test_wrong_input_is_refused_in_words(m4_in_air: FullModel) -> None:
    model = m4_in_air.robot.model
    q, v, u = pin.neutral(model), np.zeros(model.nv), np.zeros(m4_in_air.layout.size)
    with pytest.raises(InvalidSettingError, match=r"configuration q.*\(22,\).*\(23,\)"):
        mass_matrix(m4_in_air, q[:-1])
    with pytest.raises(InvalidSettingError, match="velocity v"):
        bias_forces(m4_in_air, q, v[:, None])
    with pytest.raises(InvalidSettingError, match=r"inputs u.*thrust of rear_right_thruster"):
        forward_dynamics(m4_in_air, q, v, u[:-1])
    with pytest.raises(NonFiniteError, match="entry 7 is nan"):
        state_derivative(m4_in_air, np.where(np.arange(model.nq) == 7, np.nan, q), v, u)
    with pytest.raises(NonFiniteError, match=r"thrust of front_left_thruster.*inf"):
        forward_dynamics(m4_in_air, q, v, np.where(np.arange(u.size) == 12, np.inf, u))
    with pytest.raises(UnknownNameError, match=r"nose.*front_left_thruster"):
        frame_jacobian(m4_in_air, q, "nose")
