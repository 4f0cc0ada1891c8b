"""Discs and blocks on an incline, against their closed forms, stepped implicitly."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq
from small_robots import BLOCK_HALF_SIZE, BLOCK_MASS, DISC_MASS, DISC_RADIUS, block, rolling_disc

from m4_dynamics.full.dynamics import centre_of_mass, energies
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.stepping import ExplicitStepper, ImplicitStepper
from m4_dynamics.full.terrain import Terrain, incline_terrain, ramp_terrain
from m4_dynamics.robot.robot import Robot

Array = NDArray[np.float64]
GRAVITY = 9.81


def resting_on_incline(robot: Robot, slope: float, *, height: float, contacts: int, dt: float) -> ImplicitStepper:
    """A robot put on an incline at its static depth, level with the face, at rest."""
    model = FullModel.build(robot, incline_terrain(slope))
    sink = robot.mass * GRAVITY * math.cos(slope) / (contacts * robot.ground.stiffness)
    q = pin.neutral(robot.model)
    q[:3] = (height - sink) * np.array([-math.sin(slope), 0.0, math.cos(slope)])
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, -slope, 0.0)).coeffs()
    stepper = ImplicitStepper(model, dt)
    stepper.reset(q)
    return stepper


def velocity_downhill(stepper: ImplicitStepper, slope: float) -> float:
    """Of the base's origin, in the world."""
    rotation = pin.Quaternion(stepper.configuration[3:7]).toRotationMatrix()
    return float((rotation @ stepper.velocity[:3]) @ (-math.cos(slope), 0.0, -math.sin(slope)))


def accelerations(stepper: ImplicitStepper, slope: float, *, settle: int, steps: int) -> tuple[float, Array]:
    """Mean acceleration downhill [m/s^2], and of all velocities, after some steps to settle."""
    stepper.step(settle)
    speed, velocity = velocity_downhill(stepper, slope), stepper.velocity.copy()
    stepper.step(steps)
    time = steps * stepper.time_step
    return (velocity_downhill(stepper, slope) - speed) / time, (stepper.velocity - velocity) / time


@pytest.mark.parametrize("part_of_limit", [0.3, 0.8, 0.98])
def test_a_disc_rolls_up_to_three_times_friction(tmp_path: Path, part_of_limit: float) -> None:
    """tan(beta) <= 3 mu_s: it rolls at 2/3 g sin(beta), its contact point slower than the stiction speed."""
    friction = 0.3
    slope = math.atan(part_of_limit * 3.0 * friction)
    robot = rolling_disc(tmp_path, friction_static=friction)
    stepper = resting_on_incline(robot, slope, height=DISC_RADIUS, contacts=2, dt=1e-3)
    measured, _ = accelerations(stepper, slope, settle=200, steps=300)
    # The regularised law lets the contact point drift at a constant speed below e, so the acceleration is exact once
    # the drift stands; what is left is the integration error of the settling.
    assert measured == pytest.approx(2.0 / 3.0 * GRAVITY * math.sin(slope), rel=1e-6)
    slip = velocity_downhill(stepper, slope) + DISC_RADIUS * stepper.velocity[6]
    needed = math.tan(slope) / 3.0
    expected = robot.ground.stiction_speed * (1.0 - math.sqrt(1.0 - needed / friction))
    assert slip == pytest.approx(expected, rel=1e-3)
    use = np.linalg.norm(stepper.wheel_force_in_world @ (math.cos(slope), 0.0, math.sin(slope)))
    normal = np.linalg.norm(stepper.wheel_force_in_world @ (-math.sin(slope), 0.0, math.cos(slope)))
    assert use / normal == pytest.approx(needed, rel=1e-4)
    assert stepper.counters.newton_failures == 0


@pytest.mark.parametrize("part_of_limit", [1.02, 1.5])
def test_a_disc_slides_beyond_three_times_friction(tmp_path: Path, part_of_limit: float) -> None:
    """tan(beta) > 3 mu_s: it slides at g (sin - mu_d cos), and spins up at 2 mu_d g cos / r."""
    friction, fraction = 0.3, 0.8
    slope = math.atan(part_of_limit * 3.0 * friction)
    robot = rolling_disc(tmp_path, friction_static=friction, dynamic_fraction=fraction)
    stepper = resting_on_incline(robot, slope, height=DISC_RADIUS, contacts=2, dt=1e-3)
    # 0.5 s is enough to leave the Stribeck range (2 cm/s) behind even 2 % beyond the limit.
    measured, rates = accelerations(stepper, slope, settle=500, steps=300)
    dynamic = fraction * friction
    assert measured == pytest.approx(GRAVITY * (math.sin(slope) - dynamic * math.cos(slope)), rel=1e-6)
    spin = -2.0 * dynamic * GRAVITY * math.cos(slope) / DISC_RADIUS
    np.testing.assert_allclose(rates[6:], spin, rtol=1e-6)
    assert stepper.counters.newton_failures == 0


@pytest.mark.parametrize("part_of_limit", [0.2, 0.7, 0.99])
def test_a_block_sticks_up_to_its_friction(tmp_path: Path, part_of_limit: float) -> None:
    """tan(beta) < mu_s: it creeps at the speed at which the regularised law gives tan(beta), and no faster."""
    friction = 0.5
    slope = math.atan(part_of_limit * friction)
    robot = block(tmp_path, friction_static=friction)
    stepper = resting_on_incline(robot, slope, height=BLOCK_HALF_SIZE[2], contacts=4, dt=1e-3)
    stepper.step(500)
    start = stepper.configuration[:3].copy()
    stepper.step(1000)
    moved = stepper.configuration[:3] - start
    creep = robot.ground.stiction_speed * (1.0 - math.sqrt(1.0 - part_of_limit))
    downhill = np.array([-math.cos(slope), 0.0, -math.sin(slope)])
    assert moved @ downhill == pytest.approx(creep * 1.0, rel=1e-3)
    assert abs(moved[1]) < 1e-12
    forces = stepper.point_force_in_world
    np.testing.assert_allclose(forces.sum(axis=0), (0.0, 0.0, BLOCK_MASS * GRAVITY), atol=1e-6)


@pytest.mark.parametrize("part_of_limit", [1.02, 2.0])
def test_a_block_slides_beyond_its_friction(tmp_path: Path, part_of_limit: float) -> None:
    friction, fraction = 0.5, 0.8
    slope = math.atan(part_of_limit * friction)
    robot = block(tmp_path, friction_static=friction, dynamic_fraction=fraction)
    stepper = resting_on_incline(robot, slope, height=BLOCK_HALF_SIZE[2], contacts=4, dt=1e-3)
    measured, _ = accelerations(stepper, slope, settle=500, steps=300)
    assert measured == pytest.approx(GRAVITY * (math.sin(slope) - fraction * friction * math.cos(slope)), rel=1e-6)


def test_a_block_at_rest_presses_where_its_weight_is(tmp_path: Path) -> None:
    """Across the slope each side carries half; along it friction's moment loads the lower edge more."""
    slope = 0.3
    robot = block(tmp_path)
    stepper = resting_on_incline(robot, slope, height=BLOCK_HALF_SIZE[2], contacts=4, dt=1e-3)
    stepper.step(1000)
    normal = stepper.point_force_in_world @ (-math.sin(slope), 0.0, math.cos(slope))
    # Corners are numbered x, y, z; the lower ones have even numbers, downhill is -x.
    half, height = BLOCK_HALF_SIZE[0], BLOCK_HALF_SIZE[2]
    weight = BLOCK_MASS * GRAVITY
    shift = 0.25 * weight * math.sin(slope) * height / half
    quarter = 0.25 * weight * math.cos(slope)
    np.testing.assert_allclose(normal[[0, 2]], quarter + shift, rtol=1e-3)
    np.testing.assert_allclose(normal[[4, 6]], quarter - shift, rtol=1e-3)
    np.testing.assert_array_equal(normal[1::2], 0.0)


@pytest.mark.parametrize("stepper_type", [ImplicitStepper, ExplicitStepper])
def test_free_fall(tmp_path: Path, stepper_type: type[ImplicitStepper] | type[ExplicitStepper]) -> None:
    """A tumbling block: its centre falls as the integrator's own parabola, -g dt^2 n (n + 1) / 2."""
    robot = block(tmp_path)
    stepper = stepper_type(FullModel.build(robot), 1e-3)
    q, v = pin.neutral(robot.model), np.zeros(6)
    q[2] = 5.0
    v[3:] = (3.0, -1.0, 2.0)
    stepper.reset(q, v)
    steps = 400
    stepper.step(steps)
    fallen = 0.5 * GRAVITY * 1e-6 * steps * (steps + 1)
    np.testing.assert_allclose(
        centre_of_mass(stepper.model, stepper.configuration), (0.0, 0.0, 5.0 - fallen), atol=5e-3
    )
    assert stepper.time == pytest.approx(0.4)


@pytest.mark.parametrize("drop", [0.02, 0.3, 2.0, 2.0015, 2.003, 2.0045])
def test_landing_loses_energy_and_ends_at_the_static_depth(tmp_path: Path, drop: float) -> None:
    robot = block(tmp_path)
    model = FullModel.build(robot)
    stepper = ImplicitStepper(model, 1e-3)
    k, w = robot.ground.stiffness, robot.ground.transition_width

    def elastic(depth: float) -> float:
        """Energy in the four corners' springs: the integral of k d (d / w)^2 (3 - 2 d / w), then of k d."""
        x = min(max(depth, 0.0), w) / w
        return 4.0 * k * (w * w * (0.75 * x**4 - 0.4 * x**5) + 0.5 * (max(depth, w) ** 2 - w * w))

    q = pin.neutral(robot.model)
    q[2] = BLOCK_HALF_SIZE[2] + drop
    stepper.reset(q)
    heights, totals = [], []
    for _ in range(1500):
        stepper.step()
        heights.append(stepper.configuration[2] - BLOCK_HALF_SIZE[2])
        totals.append(energies(model, stepper.configuration, stepper.velocity).total + elastic(-heights[-1]))
    # Each corner carries a quarter, within the transition width.
    static = brentq(lambda d: k * d * (d / w) ** 2 * (3.0 - 2.0 * d / w) - 0.25 * BLOCK_MASS * GRAVITY, 0.0, w)
    assert heights[-1] == pytest.approx(-static, abs=1e-9)
    # The implicit step only ever takes energy, and the damper most of it: hardly any rebound.
    assert max(np.diff(totals)) < 1e-9
    assert max(heights[int(np.argmin(heights)) :]) < 0.02 * drop
    # Without a damper and without the soft first part it would sink by this much.
    assert -min(heights) < math.sqrt(2.0 * BLOCK_MASS * GRAVITY * drop / (4.0 * k)) + w + 2.0 * static
    assert stepper.counters.newton_failures == 0


@pytest.mark.parametrize(("start", "speed", "deepest"), [(5e-5, 0.0, 2e-4), (-5e-3, 2.0, 5e-3)])
def test_a_block_pushed_into_a_corner_stays_above_the_ground(
    tmp_path: Path, start: float, speed: float, deepest: float
) -> None:
    """Its lower edge rests at, or slides to, the foot of a 45 deg face and is pressed there: it does not fall through.

    Without damping, the edge's two corners would stop an impact of 2 m/s on the face within 5.5 mm.
    """
    robot = block(tmp_path, friction_static=0.2)
    model = FullModel.build(robot, ramp_terrain(math.radians(45.0)))
    stepper = ImplicitStepper(model, 1e-3)
    q, v = pin.neutral(robot.model), np.zeros(6)
    q[0], q[2] = start - BLOCK_HALF_SIZE[0], BLOCK_HALF_SIZE[2] - 1e-4
    v[0] = speed
    stepper.reset(q, v)
    stepper.actuation.external_wrench[0] = 8.0
    data = robot.model.createData()
    furthest = -math.inf
    for _ in range(1000):
        stepper.step()
        pin.forwardKinematics(robot.model, data, stepper.configuration)
        for point in robot.contact_points:
            x, _, z = data.oMi[point.joint_id].act(point.position_in_joint)
            furthest = max(furthest, x)
            above = z if x < 0.0 else (z - x) / math.sqrt(2.0)
            assert above > -deepest, (point.name, stepper.time)
    assert furthest > 0.0
    assert stepper.counters.newton_failures == 0


def test_friction_scale_of_the_terrain_acts(tmp_path: Path) -> None:
    """The same block sticks on the upper, rough half of an incline and slides on the lower, icy one."""
    slope = 0.35
    robot = block(tmp_path, friction_static=0.5)
    tangent = np.array([math.cos(slope), math.sin(slope)])
    face = Terrain(np.stack((-5.0 * tangent, 0.0 * tangent, 5.0 * tangent)), friction_scale=np.array([0.2, 1.0]))
    for place, slides in ((1.0, False), (-1.0, True)):
        stepper = ImplicitStepper(FullModel.build(robot, face), 1e-3)
        q = pin.neutral(robot.model)
        q[:3] = place * np.array([tangent[0], 0.0, tangent[1]])
        q[:3] += BLOCK_HALF_SIZE[2] * np.array([-tangent[1], 0.0, tangent[0]])
        q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, -slope, 0.0)).coeffs()
        stepper.reset(q)
        stepper.step(500)
        speed = velocity_downhill(stepper, slope)
        if slides:
            expected = 0.5 * GRAVITY * (math.sin(slope) - 0.2 * 0.5 * math.cos(slope))
            assert speed == pytest.approx(expected, rel=0.1)
        else:
            assert speed < robot.ground.stiction_speed


def test_the_disc_is_the_disc_of_the_closed_form(tmp_path: Path) -> None:
    robot = rolling_disc(tmp_path, friction_static=0.5)
    assert robot.mass == pytest.approx(DISC_MASS)
    wheels = [robot.model.inertias[wheel.joint_id].inertia[1, 1] for wheel in robot.wheels]
    assert sum(wheels) == pytest.approx(0.5 * DISC_MASS * DISC_RADIUS**2)
