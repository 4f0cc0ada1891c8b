"""The compliant ground and its Stribeck friction: shape of the law, and its gradient by finite differences."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from finite_differences import vector_jacobian
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from m4_dynamics.errors import NonFiniteError
from m4_dynamics.full import kernels
from m4_dynamics.full.contact import friction_coefficient, normal_force
from m4_dynamics.full.model import pack_ground
from m4_dynamics.robot.robot import Ground

Array = NDArray[np.float64]
GROUND = Ground()
STATIC, DYNAMIC = GROUND.friction_static, GROUND.friction_static * GROUND.friction_dynamic_fraction

grounds = st.builds(
    Ground,
    stiffness=st.floats(1e3, 1e7),
    damping=st.floats(0.0, 2e3),
    transition_width=st.floats(1e-5, 1e-3),
    friction_static=st.floats(0.05, 2.0),
    friction_dynamic_fraction=st.floats(0.1, 1.0),
    stiction_speed=st.floats(1e-6, 1e-2),
    stribeck_speed=st.floats(1e-3, 0.5),
)


@settings(deadline=None)
@given(ground=grounds)
def test_friction_peaks_at_mu_s_at_the_stiction_speed(ground: Ground) -> None:
    speeds = ground.stiction_speed * np.concatenate((np.linspace(0.0, 2.0, 401), np.geomspace(2.0, 1e6, 100)))
    coefficients = friction_coefficient(ground, speeds)
    # "Exactly" up to the rounding of one addition.
    assert friction_coefficient(ground, ground.stiction_speed) == pytest.approx(ground.friction_static, rel=1e-15)
    assert coefficients.max() == pytest.approx(ground.friction_static, rel=1e-15)
    rising, falling = coefficients[speeds <= ground.stiction_speed], coefficients[speeds >= ground.stiction_speed]
    assert (np.diff(rising) > 0.0).all()
    assert (np.diff(falling) <= 0.0).all()
    assert coefficients[0] == 0.0


@settings(deadline=None)
@given(ground=grounds)
def test_fast_sliding_has_dynamic_friction(ground: Ground) -> None:
    dynamic = ground.friction_static * ground.friction_dynamic_fraction
    fast = ground.stiction_speed + 7.0 * ground.stribeck_speed
    assert friction_coefficient(ground, fast) == pytest.approx(dynamic, rel=1e-12)
    # One Stribeck speed beyond the peak, 1/e of the difference is left.
    middle = friction_coefficient(ground, ground.stiction_speed + ground.stribeck_speed)
    assert middle == pytest.approx(dynamic + (ground.friction_static - dynamic) / np.e, rel=1e-12)


def test_friction_opposes_either_direction_alike_and_is_continuous() -> None:
    speeds = GROUND.stiction_speed * np.linspace(-3.0, 3.0, 60001)
    coefficients = friction_coefficient(GROUND, speeds)
    np.testing.assert_allclose(coefficients, coefficients[::-1], rtol=1e-9)
    # The steepest part is at rest, 2 mu_s / e.
    steepest = 2.0 * STATIC / GROUND.stiction_speed
    assert np.abs(np.diff(coefficients)).max() <= steepest * (speeds[1] - speeds[0]) * (1.0 + 1e-9)


def test_viscous_friction_grows_with_the_sliding_speed() -> None:
    viscous = dataclasses.replace(GROUND, viscous_friction=0.05)
    difference = friction_coefficient(viscous, 3.0) - friction_coefficient(GROUND, 3.0)
    assert difference == pytest.approx(0.05 * (3.0 - GROUND.stiction_speed))


@settings(deadline=None)
@given(ground=grounds, depth=st.floats(-1e-2, 1e-2), rate=st.floats(-10.0, 10.0))
def test_normal_force_never_pulls_and_is_nothing_without_contact(ground: Ground, depth: float, rate: float) -> None:
    force = normal_force(ground, depth, rate)
    assert force >= 0.0
    if depth <= 0.0:
        assert force == 0.0
    if depth >= ground.transition_width:
        spring = ground.stiffness * depth + ground.damping * rate
        assert force == pytest.approx(max(0.0, spring), rel=1e-12, abs=1e-12)


@settings(deadline=None)
@given(ground=grounds, rate=st.floats(-0.01, 1.0))
def test_normal_force_comes_in_smoothly(ground: Ground, rate: float) -> None:
    """No step at touch-down whatever the speed, none in the slope either, and it never falls with the depth."""
    width = ground.transition_width
    depths = np.linspace(-0.5 * width, 2.0 * width, 5001)
    forces = normal_force(ground, depths, rate)
    assert (np.diff(forces) >= 0.0).all()
    spacing = depths[1] - depths[0]
    # s' <= 1.5 / w and s <= 1, so the slope is at most 1.5 (k 2 w + c d') / w + k.
    steepest = 1.5 * (2.0 * ground.stiffness * width + ground.damping * abs(rate)) / width + ground.stiffness
    assert np.diff(forces).max() <= steepest * spacing
    slopes = np.diff(forces) / spacing
    if rate >= 0.0:
        assert np.abs(np.diff(slopes)).max() <= 0.02 * steepest


@settings(deadline=None)
@given(
    ground=grounds,
    gap=st.floats(-5e-3, 1e-3),
    speed=st.floats(0.0, 50.0),
    direction=st.floats(-np.pi, np.pi),
    normal_velocity=st.floats(-1.0, 1.0),
    scale=st.floats(0.0, 2.0),
    dt=st.sampled_from([0.0, 1e-4, 1e-3, 4e-3]),
)
def test_gradient_of_the_contact_law(
    ground: Ground, gap: float, speed: float, direction: float, normal_velocity: float, scale: float, dt: float
) -> None:
    """Against central differences; speeds are in stiction speeds, from rest to well into the Stribeck range."""
    packed = pack_ground(ground)
    sliding = speed * ground.stiction_speed
    velocity = np.array([sliding * np.cos(direction), sliding * np.sin(direction), normal_velocity])
    # The force has a corner where the damper would pull, and its second derivative steps at 0, w and e: stay off them.
    depth = -gap - dt * normal_velocity
    spring = ground.stiffness * depth - ground.damping * normal_velocity
    assume(abs(spring) > 1e-3 * ground.stiffness * ground.transition_width + 1e-5 * ground.damping)
    assume(min(abs(depth), abs(depth - ground.transition_width)) > 1e-2 * ground.transition_width)
    assume(abs(speed - 1.0) > 1e-3)

    def force(velocity: Array) -> Array:
        out = np.empty(3)
        kernels.contact_law(velocity[0], velocity[1], velocity[2], gap, scale, packed, dt, out, np.empty((3, 3)))
        return out

    gradient = np.empty((3, 3))
    value = np.empty(3)
    kernels.contact_law(velocity[0], velocity[1], velocity[2], gap, scale, packed, dt, value, gradient)
    tangential = vector_jacobian(force, velocity, step=1e-5 * ground.stiction_speed)[:, :2]
    normal = vector_jacobian(force, velocity, step=1e-6)[:, 2]
    size = np.abs(gradient).max()
    # A difference of forces is no better than their rounding over the step.
    digits = 1e-13 * np.abs(value).max()
    tangential_tolerance = 1e-3 * size + digits / (1e-5 * ground.stiction_speed)
    normal_tolerance = 1e-3 * np.abs(normal).max() + 1e-6 + digits / 1e-6
    np.testing.assert_allclose(gradient[:, :2], tangential, rtol=0.0, atol=tangential_tolerance)
    np.testing.assert_allclose(gradient[:, 2], normal, rtol=0.0, atol=normal_tolerance)
    # Coulomb's bound, and friction against the sliding.
    assert np.hypot(value[0], value[1]) <= scale * ground.friction_static * value[2] * (1.0 + 1e-12)
    assert value[:2] @ velocity[:2] <= 0.0


def test_functions_take_arrays_and_refuse_nan() -> None:
    depths, rates = np.array([[1e-3], [2e-3]]), np.array([0.0, 0.1, -0.1])
    forces = normal_force(GROUND, depths, rates)
    assert forces.shape == (2, 3)
    assert forces[1, 2] == normal_force(GROUND, 2e-3, -0.1)
    assert friction_coefficient(GROUND, np.zeros((2, 2))).shape == (2, 2)
    with pytest.raises(NonFiniteError, match="sliding speed"):
        friction_coefficient(GROUND, [0.0, np.nan])
    with pytest.raises(NonFiniteError, match="depth"):
        normal_force(GROUND, np.nan, 0.0)
    with pytest.raises(NonFiniteError, match="rate"):
        normal_force(GROUND, 1e-3, np.inf)
