"""The linearised full model against finite differences of f(x, u), of its flow, and a closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from finite_differences import configuration_jacobian, vector_jacobian
from numpy.typing import NDArray
from random_states import random_configuration, random_velocity
from scenes import on_incline, placed
from small_robots import BLOCK_HALF_SIZE, BLOCK_MASS, block

from m4_dynamics.errors import InvalidSettingError, NonFiniteError
from m4_dynamics.full.contact import contacts_at
from m4_dynamics.full.dynamics import forward_dynamics, state_derivative
from m4_dynamics.full.linearisation import linearise_full
from m4_dynamics.full.model import FullModel
from m4_dynamics.robot.robot import Robot

Array = NDArray[np.float64]


def random_inputs(model: FullModel, rng: np.random.Generator) -> Array:
    u: Array = rng.uniform(-2.0, 2.0, model.layout.size)
    u[model.layout.thrusters] = rng.uniform(0.0, 20.0, len(model.robot.thrusters))
    return u


def assert_blocks_close(found: Array, expected: Array, relative: float) -> None:
    """Each column to a fraction of its own largest entry, as they differ by orders of magnitude; rounding apart."""
    size = np.abs(expected).max(axis=0)
    np.testing.assert_array_less(np.abs(found - expected).max(axis=0), relative * size + 2e-9 * size.max() + 1e-9)


def test_without_contact_it_is_the_derivative_of_the_articulated_body_algorithm(
    m4_in_air: FullModel, rng: np.random.Generator
) -> None:
    model, layout = m4_in_air.robot.model, m4_in_air.layout
    q, v = random_configuration(model, rng), random_velocity(model, rng)
    u = random_inputs(m4_in_air, rng)
    u[layout.thrusters] = 0.0
    torque = np.zeros(model.nv)
    for servo, value in zip(m4_in_air.robot.servos, u[layout.servos], strict=True):
        torque[servo.index_v] = value
    torque[m4_in_air.wheel_velocity_indices] = u[layout.wheels]
    data = model.createData()
    pin.computeABADerivatives(model, data, q, v, torque)
    linear = linearise_full(m4_in_air, q, v, u)
    np.testing.assert_allclose(linear.A[model.nv :, : model.nv], data.ddq_dq, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(linear.A[model.nv :, model.nv :], data.ddq_dv, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(linear.A[: model.nv, model.nv :], np.eye(model.nv))


@pytest.mark.parametrize("slip", [0.0, 3e-5, 5e-3, 0.5])
def test_on_the_ground_it_is_the_derivative_of_the_dynamics(m4: Robot, rng: np.random.Generator, slip: float) -> None:
    """Four wheels on a slope, sticking, creeping, in the Stribeck range and sliding, with thrust."""
    model = on_incline(m4, 0.3)
    q, v, u = placed(model, "ugv", slope=0.3, above=-2e-4), np.zeros(m4.model.nv), random_inputs(model, rng)
    v[:2] = slip * np.array([1.0, 0.7])
    v += 0.1 * slip * rng.uniform(-1.0, 1.0, v.size)
    assert len(contacts_at(model, q)) == 4
    linear = linearise_full(model, q, v, u)
    nv = m4.model.nv
    by_q = configuration_jacobian(m4.model, lambda q: forward_dynamics(model, q, v, u), q, step=3e-8)
    # At rest the slope of friction has a kink: the difference is short of it by step / (2 stiction speed).
    by_v = vector_jacobian(lambda v: forward_dynamics(model, q, v, u), v, step=1e-8)
    by_u = vector_jacobian(lambda u: forward_dynamics(model, q, v, u), u, step=1e-3)
    assert_blocks_close(linear.A[nv:, :nv], by_q, 2e-5)
    assert_blocks_close(linear.A[nv:, nv:], by_v, 2e-4)
    assert_blocks_close(linear.B[nv:], by_u, 1e-7)
    assert not linear.B[:nv].any()


def test_it_predicts_the_flow_of_a_tumbling_robot(m4_in_air: FullModel, rng: np.random.Generator) -> None:
    """Two neighbouring motions drift apart at A (dq, dv), with the deviation measured by pinocchio.difference."""
    model, nv = m4_in_air.robot.model, m4_in_air.robot.model.nv
    q, v, u = random_configuration(model, rng), random_velocity(model, rng), random_inputs(m4_in_air, rng)
    linear = linearise_full(m4_in_air, q, v, u)

    def moved(q: Array, v: Array, time: float) -> tuple[Array, Array]:
        acceleration = state_derivative(m4_in_air, q, v, u)[nv:]
        return pin.integrate(model, q, time * v), v + time * acceleration

    deviation, size, time = rng.uniform(-1.0, 1.0, 2 * nv), 1e-5, 1e-5
    rates = []
    for sign in (1.0, -1.0):
        start = pin.integrate(model, q, sign * size * deviation[:nv]), v + sign * size * deviation[nv:]
        apart = []
        for at in (time, -time):
            nominal, deviated = moved(q, v, at), moved(*start, at)
            apart.append(np.concatenate((pin.difference(model, nominal[0], deviated[0]), deviated[1] - nominal[1])))
        rates.append((apart[0] - apart[1]) / (2.0 * time))
    measured = (rates[0] - rates[1]) / (2.0 * size)
    expected = linear.A @ deviation
    np.testing.assert_allclose(measured, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())
    assert np.abs(linear.A[:nv, :nv]).max() > 0.1


def test_a_block_at_rest_bounces_as_four_springs_and_dampers(tmp_path: Path) -> None:
    """Eigenvalues of the vertical motion: roots of m s^2 + 4 c s + 4 k = 0."""
    model = FullModel.build(block(tmp_path))
    q, v = pin.neutral(model.robot.model), np.zeros(6)
    q[2] = BLOCK_HALF_SIZE[2] - 5e-4
    linear = linearise_full(model, q, v, np.zeros(0))
    assert linear.B.shape == (12, 0)
    vertical = linear.A[np.ix_([2, 8], [2, 8])]
    ground = model.ground
    roots = np.roots([BLOCK_MASS, 4.0 * ground.damping, 4.0 * ground.stiffness])
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(vertical).real), np.sort(roots.real), rtol=1e-6)
    # Sticking: 2 mu_s f_n / e at each corner.
    normal = 4.0 * ground.stiffness * 5e-4
    drag = 2.0 * ground.friction_static * normal / ground.stiction_speed / BLOCK_MASS
    assert linear.A[7, 7] == pytest.approx(-drag, rel=1e-9)


def test_wrong_input_is_refused_in_words(m4_on_ground: FullModel) -> None:
    model = m4_on_ground.robot.model
    q, v, u = placed(m4_on_ground, "ugv"), np.zeros(model.nv), np.zeros(m4_on_ground.layout.size)
    with pytest.raises(InvalidSettingError, match="configuration q"):
        linearise_full(m4_on_ground, q[1:], v, u)
    with pytest.raises(InvalidSettingError, match="inputs u"):
        linearise_full(m4_on_ground, q, v, u[1:])
    with pytest.raises(NonFiniteError, match="velocity v"):
        linearise_full(m4_on_ground, q, v + np.nan, u)
