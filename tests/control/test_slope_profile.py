"""Slope by place: where a corner is, not when the clock says so."""

from __future__ import annotations

import numpy as np
import pytest

from m4_dynamics.control.mpc.controller import MpcController
from m4_dynamics.control.mpc.problem import Problem
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.control.reference import ReferenceTrajectory, balancing_pitch, smooth_step
from m4_dynamics.control.slope_profile import SlopeProfile
from m4_dynamics.errors import InvalidSettingError, NonFiniteError
from m4_dynamics.reduced import kernels
from m4_dynamics.reduced.ground_force import ground_force_in_slope
from m4_dynamics.reduced.pendulum import inverse_dynamics, state_derivative
from m4_dynamics.reduced.trim import select_trim

DT = 0.005
#: Wheel angle at which the slope begins [rad].
CORNER = 6.0


def test_slopes_hold_from_start_to_start():
    profile = SlopeProfile(np.array([-np.inf, 1.0, 3.0]), np.array([0.0, 0.5, 0.2]))
    np.testing.assert_array_equal(profile.slope_at([-50.0, 0.999, 1.0, 2.9, 3.0, 80.0]), [0, 0, 0.5, 0.5, 0.2, 0.2])
    assert profile.slope_at(2.0).shape == ()


def test_arcs_turn_in_steps_that_end_where_the_next_piece_starts():
    # Up a slope and round a convex corner onto the level, as a wheel's centre goes: radius times angle long.
    turn, radius = np.radians(30.0), 0.125
    starts = [-np.inf, 1.0, 1.0 + radius * turn]
    profile = SlopeProfile.along(starts, [(turn, turn), (turn, 0.0), (0.0, 0.0)], wheel_radius=radius)
    assert len(profile.slopes) == 8
    np.testing.assert_allclose(profile.starts[[1, -1]], [8.0, 8.0 + turn])
    angles = np.linspace(8.0, 8.0 + turn, 200, endpoint=False)
    exact = turn - (angles - 8.0)
    assert np.abs(profile.slope_at(angles) - exact).max() <= np.radians(2.5) + 1e-9
    assert np.mean(profile.slope_at(angles) - exact) == pytest.approx(0.0, abs=np.radians(0.1))


@pytest.mark.parametrize(
    ("starts", "slopes", "error"),
    [
        ([], [], InvalidSettingError),
        ([-np.inf, 1.0], [0.0], InvalidSettingError),
        ([-np.inf, 2.0, 1.0], [0.0, 0.1, 0.2], InvalidSettingError),
        ([-np.inf, np.nan], [0.0, 0.1], NonFiniteError),
        ([-np.inf], [np.inf], NonFiniteError),
    ],
)
def test_profiles_that_make_no_sense_are_refused(starts, slopes, error):
    with pytest.raises(error):
        SlopeProfile(np.array(starts), np.array(slopes))
    with pytest.raises(InvalidSettingError, match="arc"):
        SlopeProfile.along([0.0, 1.0], [(0.0, 0.5), (0.5, 0.5)], wheel_radius=0.1)


@pytest.mark.parametrize("states", [4, 5])
def test_rollout_takes_the_slope_where_the_wheels_are(pendulum, states):
    parameters = pendulum.with_(thrust_time_constant=0.15)
    starts, profile = np.array([-np.inf, 0.03, 0.08]), np.array([0.1, 0.6, -0.2])
    n = 12
    x0 = np.array([0.0, -0.2, 4.0, 0.3, 14.0])[:states]
    u = np.column_stack([np.linspace(-0.2, 0.5, n), np.linspace(5.0, 20.0, n)])
    shapes = [(n + 1, states), (n, states, states), (n, states, 2), (n, 2), (n, 2, states), (n, 2, 2)]
    out, same = ([np.full(shape, np.nan) for shape in shapes] for _ in range(2))
    slopes, pieces = np.empty(n + 1), np.empty(n + 1, dtype=np.int64)
    kernels.rollout_over_profile(parameters.as_array(), starts, profile, x0, u, DT, slopes, pieces, *out)
    assert set(pieces) == {0, 1, 2}
    x = x0.copy()
    for k in range(n):
        expected = np.searchsorted(starts[1:], x[0], side="right")
        assert pieces[k] == expected
        assert slopes[k] == profile[expected]
        applied = np.array([u[k, 0], x[4] if states == 5 else u[k, 1]])
        np.testing.assert_allclose(out[3][k], ground_force_in_slope(pendulum, slopes[k], x[:4], applied), rtol=1e-9)
        following = x[:4] + DT * state_derivative(pendulum, slopes[k], x[:4], applied)
        x = following if states == 4 else np.append(following, x[4] + (1 - np.exp(-DT / 0.15)) * (u[k, 1] - x[4]))
        np.testing.assert_allclose(out[0][k + 1], x, rtol=1e-9, atol=1e-12)
    # Given the same slopes by time it is the ordinary rollout.
    kernels.rollout_and_linearise(parameters.as_array(), slopes[:n], x0, u, DT, *same)
    for ours, theirs in zip(out, same, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def corner_reference(pendulum, slope, *, speed=0.3, corner=CORNER, thrusts=(2.0, 8.0)):
    """Drive from the level onto a slope at steady speed and stop there; pitch from trim to trim over the corner."""
    radius, duration = pendulum.wheel_radius, 9.0
    time = DT * np.arange(round(duration / DT) + 1)
    travel, motion = np.zeros(len(time)), np.zeros((4, len(time)))
    for start, sign in ((0.5, 1.0), (6.0, -1.0)):
        covered, derivatives = smooth_step(time - start, 1.5)
        travel += sign * speed * covered
        motion += sign * speed * derivatives
    angle = travel / radius
    ground = np.where(angle >= corner, slope, 0.0)
    trims = [select_trim(pendulum, b, criterion="thrust", thrust=f) for b, f in zip((0.0, slope), thrusts, strict=True)]
    crossing = time[np.argmax(angle >= corner)]
    _, blend = smooth_step(time - (crossing - 0.8), 1.6)
    level, uphill = (balancing_pitch(pendulum, b, trim, motion[1]) for b, trim in zip((0.0, slope), trims, strict=True))
    pitch = level[0] + blend[0] * (uphill[0] - level[0])
    rate = np.gradient(pitch, DT)
    pitch_acceleration = np.gradient(rate, DT)
    state = np.column_stack([angle, pitch, motion[0] / radius, rate])
    inputs = np.array(
        [
            inverse_dynamics(pendulum, float(b), x, (a / radius, aa))
            for b, x, a, aa in zip(ground, state, motion[1], pitch_acceleration, strict=True)
        ]
    )
    return ReferenceTrajectory(time, state, np.clip(inputs, [-1, 0], [1, 43.2]), ground, motion[1])


def drive(pendulum, controller, reference, slope, *, corner=CORNER):
    """The reduced plant over a corner that is where it is, whatever the reference says."""
    p, x = pendulum.as_array(), reference.state[0].copy()
    force, errors, forces, angles = np.zeros(2), [], [], []
    for k in range(len(reference)):
        u = controller.control(k, x)
        ground = slope if x[0] >= corner else 0.0
        kernels.ground_force(p, ground, x, u, force)
        errors.append(x - reference.state[k])
        forces.append(force.copy())
        angles.append(x[0])
        kernels.mip_step(p, ground, x, u, DT, 2, x)
        if abs(errors[-1][1]) > 1.2:
            break
    return np.array(errors), np.array(forces), np.array(angles)


SLOPES = [(15.0, (2.0, 4.0)), (45.0, (2.0, 20.0))]


@pytest.mark.parametrize(("slope_deg", "thrusts"), SLOPES)
def test_where_it_should_be_both_previews_are_the_same(pendulum, slope_deg, thrusts):
    slope = np.radians(slope_deg)
    reference = corner_reference(pendulum, slope, thrusts=thrusts)
    profile = SlopeProfile(np.array([-np.inf, CORNER]), np.array([0.0, slope]))
    by_time, by_place = (MpcController(pendulum, reference, profile=p) for p in (None, profile))
    timed = drive(pendulum, by_time, reference, slope)
    placed = drive(pendulum, by_place, reference, slope)
    assert np.abs(placed[0]).max() < np.abs(timed[0]).max() + 1e-3
    assert np.abs(placed[0][-1]).max() < 1e-4


@pytest.mark.parametrize(("slope_deg", "thrusts"), SLOPES)
@pytest.mark.parametrize("late", [-0.8, 0.8])
def test_a_corner_met_early_or_late(pendulum, slope_deg, thrusts, late):
    # The corner is 10 cm off from where the reference crosses it: a third of a second early or late.
    slope, corner = np.radians(slope_deg), CORNER + late
    reference = corner_reference(pendulum, slope, thrusts=thrusts)
    profile = SlopeProfile(np.array([-np.inf, corner]), np.array([0.0, slope]))
    worst = {}
    for name, given in (("time", None), ("place", profile)):
        controller = MpcController(pendulum, reference, profile=given)
        error, force, angle = drive(pendulum, controller, reference, slope, corner=corner)
        near = np.abs(angle - corner) < 2.0
        worst[name] = np.abs(error[near, 0]).max() * pendulum.wheel_radius
        assert len(error) == len(reference), "it fell"
        assert np.abs(error[-1]).max() < 1e-3
        assert controller.fallbacks == 0
        assert force[:, 1].min() > 5.0
    assert worst["place"] < 0.003  # measured 0.0000 to 0.0023
    assert worst["time"] > 0.015  # measured 0.018 to 0.078


def test_end_weight_is_that_of_the_slope_where_the_horizon_ends(pendulum):
    slope = np.radians(45.0)
    reference = corner_reference(pendulum, slope, thrusts=(2.0, 20.0))
    profile = SlopeProfile(np.array([-np.inf, CORNER]), np.array([0.0, slope]))
    controller = MpcController(pendulum, reference, MpcSettings(horizon=20), profile=profile)
    problem = controller.problem
    step = int(np.argmax(reference.state[:, 0] >= CORNER)) - 10
    controller.control(step, reference.state[step])
    assert controller.target.slopes[0] == 0.0
    assert controller.target.slopes[-1] == slope
    assert controller.target.terminal is problem.piece_terminals[1]
    uphill = np.flatnonzero(reference.slope == slope)[0]
    np.testing.assert_array_equal(controller.target.terminal, problem.terminals[uphill])
    # Well before the corner it is that of the level.
    controller.control(step - 60, reference.state[step - 60])
    assert controller.target.terminal is problem.piece_terminals[0]


def test_pieces_of_other_slopes_take_the_nearest_weight(pendulum):
    reference = corner_reference(pendulum, np.radians(45.0), thrusts=(2.0, 20.0))
    profile = SlopeProfile(np.array([-np.inf, CORNER, CORNER + 1.0]), np.radians([1.0, 20.0, 46.0]))
    level, gentle, steep = Problem(pendulum, reference, MpcSettings(), profile).piece_terminals
    np.testing.assert_array_equal(level, gentle)
    assert np.abs(steep - level).max() > 1.0


def test_lag_and_corner_together(pendulum):
    slope, corner = np.radians(45.0), CORNER + 0.8
    reference = corner_reference(pendulum, slope, thrusts=(2.0, 20.0))
    profile = SlopeProfile(np.array([-np.inf, corner]), np.array([0.0, slope]))
    lagging = pendulum.with_(thrust_time_constant=0.15)
    controller = MpcController(lagging, reference, profile=profile)
    p, x, thrust = pendulum.as_array(), reference.state[0].copy(), float(reference.inputs[0, 1])
    errors = []
    for k in range(len(reference)):
        u = controller.control(k, x)
        errors.append(x - reference.state[k])
        for _ in range(5):
            thrust += -np.expm1(-1e-3 / 0.15) * (u[1] - thrust)
            kernels.mip_step(p, slope if x[0] >= corner else 0.0, x, np.array([u[0], thrust]), 1e-3, 1, x)
    assert np.abs(np.array(errors)[:, 1]).max() < np.radians(5.0)
    assert np.abs(errors[-1]).max() < 1e-3
