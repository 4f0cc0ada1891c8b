"""The contact solver: the limiters of its Newton steps, its solutions, and how often it fails."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import brentq

from m4_dynamics.full import kernels
from m4_dynamics.full.contact import friction_coefficient, normal_force
from m4_dynamics.full.model import FullModel, pack_ground
from m4_dynamics.full.stepping import ImplicitStepper, StepCounters
from m4_dynamics.full.terrain import Terrain, flat_terrain, incline_terrain, plateau_terrain, ramp_terrain
from m4_dynamics.robot.robot import Ground, Robot

Array = NDArray[np.float64]
STICTION = 1e-4
WIDTH = 1e-4

speeds = st.floats(0.0, 3.0).map(lambda exponent: STICTION * (10.0**exponent - 1.0) / 10.0)
angles = st.floats(-math.pi, math.pi)


def polar(size: float, angle: float) -> Array:
    return size * np.array([math.cos(angle), math.sin(angle)])


@settings(deadline=None, max_examples=500)
@given(speed=speeds, angle=angles, step=speeds, direction=angles)
def test_no_step_jumps_over_stiction_or_turns_too_far(
    speed: float, angle: float, step: float, direction: float
) -> None:
    old, change = polar(speed, angle), polar(step, direction)
    part = kernels.newton_step_length(old[0], old[1], change[0], change[1], STICTION)
    assert 0.0 < part <= 1.0
    new, whole = old + part * change, old + change
    if part == 1.0 and step > 1e-6 * STICTION:
        # A whole step outside stiction passes by it, and turns by no more than 60 deg.
        if min(speed, float(np.linalg.norm(whole))) >= STICTION:
            nearest = float(np.clip(-(old @ change) / (step * step), 0.0, 1.0))
            assert np.linalg.norm(old + nearest * change) >= STICTION * (1.0 - 1e-9)
            assert old @ whole >= (0.5 - 1e-9) * speed * np.linalg.norm(whole)
    elif part < 1.0 and speed >= STICTION:
        # A step that was cut ends within stiction, or has turned by exactly 60 deg.
        inside = np.linalg.norm(new) <= STICTION * (1.0 + 1e-9)
        assert inside or old @ new == pytest.approx(0.5 * speed * np.linalg.norm(new), rel=1e-6)
    elif part < 1.0:
        # One that leaves stiction stops at its edge, where friction peaks, or has done a tenth of its way.
        assert np.linalg.norm(new) <= STICTION * (1.0 + 1e-9) or part == pytest.approx(0.1)


def test_steps_within_stiction_are_free() -> None:
    assert kernels.newton_step_length(0.5 * STICTION, 0.0, -STICTION, 0.0, STICTION) == 1.0
    assert kernels.newton_step_length(0.0, 0.0, 0.9 * STICTION, 0.0, STICTION) == 1.0
    assert kernels.newton_step_length(0.0, 0.0, 50.0 * STICTION, 0.0, STICTION) == pytest.approx(0.01)


@given(depth=st.floats(-5.0, 5.0), new_depth=st.floats(-5.0, 5.0))
def test_no_step_jumps_over_the_transition_width(depth: float, new_depth: float) -> None:
    part = kernels.newton_step_length_normal(depth * WIDTH, new_depth * WIDTH, WIDTH)
    assert 0.0 < part <= 1.0
    end = depth + part * (new_depth - depth)
    assert part == 1.0 or end == pytest.approx(0.5)
    # Not from one side to the other.
    assert not (depth >= 1.0 and end < 0.0)
    assert not (depth <= 0.0 and end > 1.0 + 1e-9)


def solve(
    mobility: Array, free: Array, gaps: Array, ground: Ground, dt: float, *, ascending: bool = False
) -> Array | None:
    """Contact velocities and forces, shape (2, 3 n), from the free velocities; None if Newton fails."""
    count = len(gaps)
    contacts = np.zeros((count, kernels.CONTACT_COLUMNS))
    contacts[:, kernels.NORMAL_Z] = 1.0
    contacts[:, kernels.GAP] = gaps
    contacts[:, kernels.FRICTION_SCALE] = 1.0
    velocity, force = free.copy(), np.empty(3 * count)
    iterations = kernels.solve_contacts(
        mobility, free, contacts, count, pack_ground(ground), dt, ascending, velocity, force
    )
    return None if iterations < 0 else np.stack((velocity, force))


def law(ground: Ground, gap: float, velocity: Array, dt: float) -> Array:
    """Force of one contact, from the functions of the ground law."""
    normal = float(normal_force(ground, -gap - dt * velocity[2], -velocity[2]))
    speed = float(np.hypot(velocity[0], velocity[1]))
    friction = float(friction_coefficient(ground, speed)) * normal
    along = velocity[:2] / speed if speed > 0.0 else np.zeros(2)
    return np.array([-friction * along[0], -friction * along[1], normal])


@settings(deadline=None, max_examples=300)
@given(
    inverse_mass=st.floats(0.1, 10.0),
    gap=st.floats(-5e-3, 5e-4),
    sliding=st.floats(0.0, 3.0),
    angle=angles,
    fall=st.floats(-3.0, 1.0),
)
def test_one_contact_on_a_point_mass(
    inverse_mass: float, gap: float, sliding: float, angle: float, fall: float
) -> None:
    """Against a bracketed root for the normal, and Coulomb's alternatives for the tangent."""
    ground, dt = Ground(), 1e-3
    free = np.array([*polar(sliding, angle), fall])
    solution = solve(inverse_mass * np.eye(3), free, np.array([gap]), ground, dt)
    if solution is None:
        solution = solve(inverse_mass * np.eye(3), free, np.array([gap]), ground, dt, ascending=True)
    assert solution is not None
    velocity, force = solution

    def excess(normal_velocity: float) -> float:
        return (
            normal_velocity
            - fall
            - dt * inverse_mass * float(normal_force(ground, -gap - dt * normal_velocity, -normal_velocity))
        )

    # Both sides of the equation are monotone, so there is one root.
    root = brentq(excess, fall - 1.0, 100.0, xtol=1e-14)
    assert velocity[2] == pytest.approx(root, abs=1e-7)
    # Newton stops at 1e-7 m/s; within stiction the force changes by up to 40,000 times that.
    np.testing.assert_allclose(velocity, free + dt * inverse_mass * force, atol=1e-5)
    strength = dt * inverse_mass * force[2]
    speed = np.hypot(velocity[0], velocity[1])
    if sliding > strength * ground.friction_static + ground.stiction_speed + 1e-6:
        assert speed > ground.stiction_speed
    if sliding < strength * ground.friction_static * ground.friction_dynamic_fraction:
        assert speed <= ground.stiction_speed
    # Friction acts against the sliding that there would be without it.
    assert velocity[0] * free[1] == pytest.approx(velocity[1] * free[0], abs=1e-6)


@settings(deadline=None, max_examples=100)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 6))
def test_solutions_satisfy_the_law(seed: int, count: int) -> None:
    """Random coupled contacts: what is returned as converged solves v = v_free + dt W f(v)."""
    rng = np.random.default_rng(seed)
    ground, dt = Ground(), 1e-3
    rows = rng.normal(size=(3 * count, 18))
    mobility = rows @ np.diag(rng.uniform(0.01, 1.0, 18)) @ rows.T
    free = rng.normal(size=3 * count) * np.tile([1.0, 1.0, 0.5], count)
    gaps = rng.uniform(-2e-3, 2e-4, count)
    solution = solve(mobility, free, gaps, ground, dt)
    assume(solution is not None)
    assert solution is not None
    velocity, force = solution
    expected = np.concatenate([law(ground, gaps[i], velocity[3 * i : 3 * i + 3], dt) for i in range(count)])
    np.testing.assert_allclose(force, expected, rtol=1e-9, atol=1e-9)
    residual = np.abs(velocity - free - dt * mobility @ force).max()
    # Newton stops when its last step was below 1e-3 of the stiction speed, and converges quadratically.
    assert residual < 1e-3 * np.abs(mobility).max() * max(1.0, np.abs(force).max() * dt)


def throw(robot: Robot, terrain: Terrain, ground: Ground, rng: np.random.Generator, *, steps: int) -> StepCounters:
    """Let the robot hit the ground in a random posture, tumbling, at metres per second, with all motors on."""
    stepper = ImplicitStepper(FullModel.build(robot, terrain, ground=ground), 1e-3)
    posture = list(robot.postures.values())[rng.integers(len(robot.postures))]
    tangent = np.zeros(robot.model.nv)
    tangent[3:6] = rng.uniform(-3.0, 3.0, 3)
    q = pin.integrate(robot.model, posture.configuration, tangent)
    q[0] = rng.uniform(-0.3, 0.3)
    q[2] = 0.5 + terrain.height_at(q[0])
    v = rng.uniform(-5.0, 5.0, robot.model.nv)
    v[:3] = pin.Quaternion(q[3:7]).toRotationMatrix().T @ (*rng.uniform(-5.0, 5.0, 2), rng.uniform(-5.0, 0.0))
    v[3:6] = rng.uniform(-10.0, 10.0, 3)
    stepper.reset(q, v)
    stepper.actuation.wheel_duty[:] = rng.uniform(-1.0, 1.0, len(robot.wheels))
    stepper.step(steps)
    stepper.require_bounded()
    return stepper.counters


@pytest.mark.parametrize("stiction_speed", [1e-5, 1e-4, 1e-3])
def test_harsh_impacts_rarely_defeat_newton(m4: Robot, rng: np.random.Generator, stiction_speed: float) -> None:
    """Failures are counted, and there is less than one in ten thousand steps of tumbling on flat, foot and crest."""
    ground = dataclasses.replace(m4.ground, stiction_speed=stiction_speed)
    terrains = (flat_terrain(), ramp_terrain(0.8), plateau_terrain(0.8, length=0.3))
    counters = [throw(m4, terrains[i % 3], ground, rng, steps=400) for i in range(30)]
    steps, iterations, failures, _ = np.sum(counters, axis=0)
    assert steps == 12000
    assert failures <= 1
    assert 1.0 < iterations / steps < 5.0


@pytest.mark.parametrize("slope", [0.0, 15.0, 30.0])
def test_rolling_never_defeats_newton(m4: Robot, slope: float) -> None:
    """Four wheels: driving off, at speed, braking to a stop and holding, with unequal torques."""
    angle = math.radians(slope)
    stepper = ImplicitStepper(FullModel.build(m4, incline_terrain(angle)), 1e-3)
    q = m4.posture("ugv").configuration.copy()
    q[:3] = 0.2939 * np.array([-math.sin(angle), 0.0, math.cos(angle)])
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, -angle, 0.0)).coeffs()
    stepper.reset(q)
    for duty, brake in (([0.6, 0.65, 0.6, 0.6], 0.0), ([0.1, 0.0, 0.1, 0.1], 0.0), ([0.0] * 4, 5.0)):
        stepper.actuation.wheel_duty[:] = duty
        stepper.actuation.wheel_brake[:] = brake
        stepper.step(700)
    assert stepper.counters.newton_failures == 0
    assert stepper.counters.newton_iterations < 3 * stepper.counters.steps


def test_what_has_no_solution_is_no_solution() -> None:
    for free in ([math.nan, 0.0, 0.0], [0.0, 0.0, math.nan], [0.0, math.inf, -1.0]):
        assert solve(np.eye(3), np.array(free), np.array([-1e-3]), Ground(), 1e-3) is None


def test_after_a_failure_forces_and_velocities_belong_together(rng: np.random.Generator) -> None:
    """Without convergence the forces are those of the nearest iterate, and the velocities those that they lead to."""
    ground, dt = Ground(), 1e-3
    contacts = np.zeros((1, kernels.CONTACT_COLUMNS))
    contacts[0, [kernels.NORMAL_Z, kernels.FRICTION_SCALE, kernels.GAP]] = 1.0, 1.0, -4e-3
    failures = 0
    for _ in range(2000):
        rows = rng.normal(size=(3, 6))
        mobility, free = 0.5 * rows @ rows.T, rng.normal(size=3)
        velocity, force = free.copy(), np.full(3, np.nan)
        count = kernels.solve_contacts(mobility, free, contacts, 1, pack_ground(ground), dt, False, velocity, force)
        if count < 0:
            failures += 1
            assert force[2] >= 0.0
            np.testing.assert_allclose(velocity, free + dt * mobility @ force, atol=1e-12)
    # Friction that weakens with the speed defeats the plain Newton now and then; that is what the second try is for.
    assert 0 < failures < 400


def test_failures_are_counted_and_do_no_harm(m4: Robot) -> None:
    """A stiction speed below what rounding resolves cannot converge: the counter says so, the robot stays put."""
    ground = dataclasses.replace(m4.ground, stiction_speed=1e-20)
    stepper = ImplicitStepper(FullModel.build(m4, ground=ground), 1e-3)
    q = m4.posture("ugv").configuration.copy()
    q[2] = 0.2939
    stepper.reset(q)
    stepper.step(100)
    assert stepper.counters.newton_failures > 90
    assert np.abs(stepper.velocity[:3]).max() < 0.02
