"""The reference is an exact solution of the reduced model, and refuses what cannot be followed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from m4_dynamics.control.reference import ReferenceTrajectory, balancing_pitch, climb_reference
from m4_dynamics.errors import InvalidSettingError, NonFiniteError, NoTrimExists
from m4_dynamics.reduced.pendulum import acceleration, inverse_dynamics
from m4_dynamics.reduced.trim import select_trim


@pytest.mark.parametrize("slope_deg", [0.0, 15.0, 45.0])
def test_state_and_inputs_satisfy_the_equations_of_motion(pendulum, make_case, slope_deg):
    # Finely sampled, the derivative of the states by finite differences is what the model says, given the inputs.
    case = make_case(slope_deg, dt=5e-4, duration=6.0)
    reference = case.reference
    by_differences = np.gradient(reference.state, reference.time, axis=0, edge_order=2)
    by_model = np.array(
        [acceleration(pendulum, case.slope, x, u) for x, u in zip(reference.state, reference.inputs, strict=True)]
    )
    np.testing.assert_allclose(by_differences[:, :2], reference.state[:, 2:], atol=2e-6)
    np.testing.assert_allclose(by_differences[:, 2:], by_model, atol=2e-3)
    assert np.abs(by_model).max(axis=0) == pytest.approx(
        [2.1875 * 0.3 / 1.5 / 0.125, np.abs(by_model[:, 1]).max()], rel=1e-3
    )


def test_rest_cruise_and_hold(pendulum, make_case):
    case = make_case(30.0, speed=0.4, duration=8.0, start_time=1.0, ramp_time=1.0, hold_time=2.0)
    reference, trim = case.reference, case.trim
    rest = reference.time <= 1.0
    cruise = (reference.time >= 2.0) & (reference.time <= 5.0)
    hold = reference.time >= 6.0
    for steady in (rest, hold):
        np.testing.assert_allclose(reference.state[steady, 2:], 0.0, atol=1e-12)
        np.testing.assert_allclose(reference.inputs[steady], np.broadcast_to(trim.inputs, (steady.sum(), 2)), atol=1e-9)
        np.testing.assert_allclose(reference.state[steady, 1], trim.pitch, atol=1e-12)
    np.testing.assert_allclose(reference.state[cruise, 2], 0.4 / 0.125, rtol=1e-12)
    cruising = select_trim(pendulum, case.slope, criterion="thrust", thrust=trim.thrust, speed=0.4)
    np.testing.assert_allclose(reference.inputs[cruise], np.broadcast_to(cruising.inputs, (cruise.sum(), 2)), atol=1e-9)
    # The distance is the area under the speed: each ramp counts half.
    assert reference.state[-1, 0] * 0.125 == pytest.approx(0.4 * (5.0 - 2.0 + 1.0))


def test_thrust_barely_moves_in_a_slow_climb(make_case):
    case = make_case(45.0, ramp_time=3.0, duration=12.0)
    assert np.abs(case.reference.inputs[:, 1] - case.trim.thrust).max() < 0.3


@settings(max_examples=30, deadline=None)
@given(
    slope=st.floats(-0.3, 0.9),
    accelerations=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=4),
)
def test_balancing_pitch_needs_the_trims_thrust(pendulum, slope, accelerations):
    trim = select_trim(pendulum, slope, criterion="least-friction")
    pitch, slope_of_pitch, curvature = balancing_pitch(pendulum, slope, trim, np.array(accelerations))
    radius = pendulum.wheel_radius
    for theta, a in zip(pitch, accelerations, strict=True):
        u = inverse_dynamics(pendulum, slope, (0.0, theta, 0.0, 0.0), (a / radius, 0.0))
        assert u[1] == pytest.approx(trim.thrust, abs=1e-8)
    # Derivatives by central differences.
    a, h = np.array(accelerations), 1e-4
    after = balancing_pitch(pendulum, slope, trim, a + h)[0]
    before = balancing_pitch(pendulum, slope, trim, a - h)[0]
    np.testing.assert_allclose(slope_of_pitch, (after - before) / (2 * h), rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(curvature, (after - 2 * pitch + before) / h**2, rtol=1e-3, atol=1e-5)


def test_balancing_pitch_agrees_with_a_root_finder(pendulum, make_case):
    case = make_case(45.0)
    pitch, _, _ = balancing_pitch(pendulum, case.slope, case.trim, np.array([0.3]))

    def missing_thrust(theta: float) -> float:
        wanted = (0.3 / pendulum.wheel_radius, 0.0)
        return inverse_dynamics(pendulum, case.slope, (0.0, theta, 0.0, 0.0), wanted)[1] - case.trim.thrust

    assert balancing_pitch(pendulum, case.slope, case.trim, 0.3)[0] == pitch[0]
    assert pitch[0] == pytest.approx(brentq(missing_thrust, case.trim.pitch - 0.3, case.trim.pitch + 0.3), abs=1e-10)


def test_backwards_mirrors_forwards(make_case):
    up, down = make_case(0.0, speed=0.3).reference, make_case(0.0, speed=-0.3).reference
    np.testing.assert_allclose(up.state[:, 0], -down.state[:, 0])
    assert down.state[-1, 0] < 0.0


def test_too_hard_an_acceleration_is_refused(pendulum):
    # A body with its CoM close to the axle cannot lean against more than some 3 m/s^2.
    low = pendulum.with_(com_in_body=(0.0, 0.05))
    trim = select_trim(low, 0.0, criterion="least-thrust")
    with pytest.raises(NoTrimExists, match="no pitch balances") as caught:
        climb_reference(low, 0.0, trim, speed=3.0, ramp_time=1.0)
    assert caught.value.limit == "acceleration"


@pytest.mark.parametrize(
    "options", [{"duration": 3.0}, {"dt": 0.0}, {"ramp_time": 0.0}, {"hold_time": -1.0}, {"start_time": -0.1}]
)
def test_impossible_times_are_refused(pendulum, make_case, options):
    case = make_case(15.0)
    with pytest.raises(InvalidSettingError):
        climb_reference(pendulum, case.slope, case.trim, **options)


def test_not_a_number_is_refused_by_name(pendulum, make_case):
    case = make_case(15.0)
    with pytest.raises(NonFiniteError, match="speed"):
        climb_reference(pendulum, case.slope, case.trim, speed=float("nan"))


def test_malformed_trajectories_are_refused():
    time = np.array([0.0, 0.1, 0.2])
    good = {"state": np.zeros((3, 4)), "inputs": np.zeros((3, 2)), "slope": np.zeros(3), "acceleration": np.zeros(3)}
    assert ReferenceTrajectory(time, **good).time_step == pytest.approx(0.1)
    with pytest.raises(InvalidSettingError, match="state"):
        ReferenceTrajectory(time, **{**good, "state": np.zeros((3, 3))})
    with pytest.raises(InvalidSettingError, match="equal steps"):
        ReferenceTrajectory(np.array([0.0, 0.1, 0.3]), **good)
    with pytest.raises(NonFiniteError, match="slope"):
        ReferenceTrajectory(time, **{**good, "slope": np.array([0.0, np.nan, 0.0])})
    with pytest.raises(InvalidSettingError, match="at least 2"):
        ReferenceTrajectory(time[:1], *(v[:1] for v in good.values()))


def test_steadiest_samples_pick_rest_on_every_slope():
    count = 6
    slope = np.array([0.0, 0.0, 0.0, 0.5, 0.5, 0.5])
    acceleration_along_slope = np.array([0.2, 0.0, 0.1, -0.3, 0.1, 0.2])
    reference = ReferenceTrajectory(
        np.arange(count) * 0.1, np.zeros((count, 4)), np.zeros((count, 2)), slope, acceleration_along_slope
    )
    samples, index = reference.steadiest_samples()
    assert samples.tolist() == [1, 4]
    assert index.tolist() == [0, 0, 0, 1, 1, 1]
