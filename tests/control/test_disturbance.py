"""The disturbance estimate: an optimal filter, exact at rest, and wheels that end where they should."""

from __future__ import annotations

import numpy as np
import pytest

from m4_dynamics.control.disturbance import (
    DisturbanceEstimator,
    DisturbanceNoise,
    disturbance_filter_gain,
    disturbance_levers,
)
from m4_dynamics.control.lqr import LqrController
from m4_dynamics.control.mpc.controller import MpcController
from m4_dynamics.control.mpc.kernels import FRICTION
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.reduced import kernels
from m4_dynamics.reduced.linear import discretise_zoh
from m4_dynamics.reduced.pendulum import linearise, mass_matrix

DT = 0.005
#: What a tenth of mass, of thrust or two centimetres of CoM amount to at 45 deg, and more [N m].
DISTURBANCES = [(-0.5, -2.7), (-0.5, -1.3), (0.0, 1.2), (0.5, 1.3), (-1.0, -5.4)]


def disturbed_plant(pendulum, disturbance):
    p = pendulum.as_array()
    p[kernels.DISTURBANCE_WHEEL : kernels.DISTURBANCE_PITCH + 1] = disturbance
    return p


def augmented_model(pendulum, case):
    a, _ = linearise(pendulum, case.slope, case.trim.state, case.trim.inputs)
    force = np.vstack([np.zeros((2, 2)), np.linalg.inv(mass_matrix(pendulum, case.slope, case.trim.state))])
    a_d, force_d = discretise_zoh(a, force, DT)
    return np.block([[a_d, force_d], [np.zeros((2, 4)), np.eye(2)]])


def covariances(pendulum, noise):
    walk = noise.walk * disturbance_levers(pendulum)
    process = np.diag([0, 0, *[(noise.acceleration * DT) ** 2] * 2, *(walk**2 * DT)])
    return process, np.diag([noise.angle**2] * 2 + [noise.rate**2] * 2)


@pytest.mark.parametrize("slope_deg", [0.0, 15.0, 45.0])
def test_gain_is_where_the_kalman_recursion_ends(pendulum, make_case, slope_deg):
    case, noise = make_case(slope_deg), DisturbanceNoise()
    gain, innovation = disturbance_filter_gain(
        pendulum, case.slope, case.trim.state, case.trim.inputs, time_step=DT, noise=noise
    )
    model, measured = augmented_model(pendulum, case), np.eye(4, 6)
    process, measurement = covariances(pendulum, noise)
    covariance = np.eye(6)
    for _ in range(3000):
        spread = measured @ covariance @ measured.T + measurement
        recursive = covariance @ measured.T @ np.linalg.inv(spread)
        covariance = model @ (covariance - recursive @ measured @ covariance) @ model.T + process
    np.testing.assert_allclose(gain, recursive, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(innovation, spread, rtol=1e-6)
    # The estimate's error dies out within some tenths of a second.
    poles = np.linalg.eigvals((np.eye(6) - gain @ measured) @ model)
    assert 0.05 < -DT / np.log(np.abs(poles).max()) < 0.5


def test_errors_are_as_large_as_the_filter_believes(pendulum, make_case):
    case, noise = make_case(45.0), DisturbanceNoise()
    gain, innovation = disturbance_filter_gain(
        pendulum, case.slope, case.trim.state, case.trim.inputs, time_step=DT, noise=noise
    )
    model, measured = augmented_model(pendulum, case), np.eye(4, 6)
    process, measurement = covariances(pendulum, noise)
    rng = np.random.default_rng(11)
    # Only the error matters, whose dynamics the (unstable) state does not enter.
    error, seen = np.zeros(6), []
    for k in range(40_000):
        error = model @ error + rng.normal(size=6) * np.sqrt(np.diag(process))
        surprise = measured @ error + rng.normal(size=4) * np.sqrt(np.diag(measurement))
        error = error - gain @ surprise
        if k > 1000:
            seen.append(surprise)
    np.testing.assert_allclose(np.cov(np.array(seen).T), innovation, rtol=0.05, atol=0.03 * innovation.diagonal().min())


@pytest.mark.parametrize("slope_deg", [15.0, 45.0])
@pytest.mark.parametrize("disturbance", DISTURBANCES)
def test_estimate_is_the_disturbance_and_the_wheels_stay(pendulum, make_case, simulate, slope_deg, disturbance):
    case = make_case(slope_deg, thrust=8.0 if slope_deg == 15.0 else 20.0, speed=0.0, duration=8.0)
    controller = MpcController(pendulum, case.reference)
    run = simulate(controller, case.reference, plant=disturbed_plant(pendulum, disturbance))
    np.testing.assert_allclose(controller.estimator.estimate, disturbance, atol=1e-4)
    assert np.abs(run.error[-1]).max() < 1e-5
    assert controller.target.pitch_shift == 0.0
    # The target's own inputs hold the robot.
    np.testing.assert_allclose(run.inputs[-1], controller.target.inputs[0], atol=1e-3)


@pytest.mark.parametrize("disturbance", [(0.02, 0.0), (0.0, 0.05), (-0.02, 0.05)])
def test_without_the_estimate_the_offset_is_what_the_feedback_leaves(pendulum, make_case, simulate, disturbance):
    # Balance of generalised forces at rest, linear for small disturbances: (A - B K) e + (0, M^-1 d) = 0.
    case = make_case(45.0, speed=0.0, duration=8.0)
    settings = MpcSettings(disturbance_rejection=False)
    controller = MpcController(pendulum, case.reference, settings)
    run = simulate(controller, case.reference, plant=disturbed_plant(pendulum, disturbance))
    a, b = linearise(pendulum, case.slope, case.trim.state, case.trim.inputs)
    push = np.linalg.solve(mass_matrix(pendulum, case.slope, case.trim.state), disturbance)
    expected = -np.linalg.solve(a - b @ controller.problem.gains[0], np.concatenate([np.zeros(2), push]))
    np.testing.assert_allclose(run.error[-1], expected, rtol=0.02, atol=1e-6)
    assert np.abs(expected[:2]).max() > 1e-3


def test_settled_speed_is_offset_free_too(pendulum, make_case, simulate):
    case = make_case(45.0, thrust=20.0)
    run = simulate(
        MpcController(pendulum, case.reference), case.reference, plant=disturbed_plant(pendulum, (-0.5, -2.7))
    )
    cruise = run.error[1000:1200]
    assert np.abs(cruise[:, 0]).max() * pendulum.wheel_radius < 5e-4
    assert not run.fell


def test_lqr_uses_the_same_estimate(pendulum, make_case, simulate):
    case = make_case(45.0, thrust=20.0, duration=8.0)
    plant = disturbed_plant(pendulum, (-0.5, -2.7))
    plain, rejecting = (LqrController(pendulum, case.reference, disturbance_rejection=on) for on in (False, True))
    offset = simulate(plain, case.reference, plant=plant).error[-1, 0] * pendulum.wheel_radius
    corrected = simulate(rejecting, case.reference, plant=plant).error[-1, 0] * pendulum.wheel_radius
    assert abs(offset) > 0.05
    assert abs(corrected) < 1e-4
    rejecting.reset()
    np.testing.assert_array_equal(rejecting.estimator.estimate, 0.0)


@pytest.mark.parametrize("pitch_error_deg", [-5.0, 5.0])
def test_thrust_target_keeps_its_margin_by_giving_up_pitch(pendulum, make_case, simulate, pitch_error_deg):
    # A CoM far forward takes more thrust away than the trim has.
    case = make_case(15.0, thrust=4.0, duration=8.0)
    controller = MpcController(pendulum, case.reference)
    run = simulate(
        controller, case.reference, pitch_error_deg=pitch_error_deg, plant=disturbed_plant(pendulum, (0.0, 3.0))
    )
    assert not run.fell
    assert abs(run.error[-1, 0]) * pendulum.wheel_radius < 1e-4
    assert run.inputs[-1, 1] == pytest.approx(2.0, abs=1e-2)
    assert run.error[-1, 1] == pytest.approx(controller.target.pitch_shift, abs=1e-4)
    assert controller.target.pitch_shift < -np.radians(0.3)


def test_plan_makes_room_for_a_target_that_needs_its_margin(pendulum, make_case, simulate):
    # Pulled downhill: the robot needs more friction to stand than the plan would use, less than the ground gives.
    case = make_case(45.0, thrust=15.0, speed=0.0, duration=8.0)
    controller = MpcController(pendulum, case.reference)
    settings = controller.problem.settings
    run = simulate(controller, case.reference, plant=disturbed_plant(pendulum, (-0.7, 1.5)))
    assert abs(run.error[-1, 0]) * pendulum.wheel_radius < 1e-4
    assert settings.friction_plan < run.friction_use[-1] < settings.friction_static
    assert controller.target.weights[FRICTION] == pytest.approx(1.03 * run.friction_use[-1], rel=1e-3)
    assert controller.target.pitch_shift == 0.0
    assert controller.diagnostics.slack < 1e-3


def test_pitch_gives_way_where_the_ground_gives_no_more(pendulum, make_case, simulate):
    case = make_case(45.0, thrust=15.0, speed=0.0, duration=12.0)
    controller = MpcController(pendulum, case.reference, MpcSettings(friction_static=0.68))
    run = simulate(controller, case.reference, plant=disturbed_plant(pendulum, (-0.7, 1.0)))
    assert abs(run.error[-1, 0]) * pendulum.wheel_radius < 1e-4
    assert run.friction_use[-1] == pytest.approx(0.68 / 1.03, rel=1e-4)
    assert run.error[-1, 1] == pytest.approx(controller.target.pitch_shift, abs=1e-5)
    assert controller.target.pitch_shift < -np.radians(2.0)


def test_wheels_alone_find_the_pitch_that_balances(pendulum, make_case, simulate):
    case = make_case(15.0, thrust=0.0, speed=0.0, duration=20.0)
    controller = MpcController(pendulum, case.reference, MpcSettings(thrust_limits=(0.0, 0.0)))
    run = simulate(controller, case.reference, plant=disturbed_plant(pendulum, (-0.1, -1.0)))
    assert (run.inputs[:, 1] == 0.0).all()
    assert abs(run.error[-1, 0]) * pendulum.wheel_radius < 1e-3
    assert abs(run.error[-1, 1]) > np.radians(1.0)


def test_jumps_are_no_disturbance(pendulum, make_case):
    case = make_case(45.0)
    estimator = DisturbanceEstimator(pendulum, case.reference)
    x = case.reference.state[0].copy()
    for step in range(200):
        estimator.measure(step, x + ([0.0, 0.0, 0.0, 1.0] if step == 100 else 0.0))
        estimator.apply(step, case.slope, case.reference.inputs[0])
    np.testing.assert_allclose(estimator.estimate, 0.0, atol=1e-9)


def test_gaps_and_repeated_steps_keep_the_estimate(pendulum, make_case):
    case = make_case(45.0)
    estimator = DisturbanceEstimator(pendulum, case.reference)
    x, plant = case.reference.state[0].copy(), disturbed_plant(pendulum, (0.3, -1.0))
    for step in range(100):
        estimator.measure(step, x)
        estimator.apply(step, case.slope, case.trim.inputs)
        kernels.mip_step(plant, case.slope, x, case.trim.inputs, DT, 2, x)
    learnt = estimator.estimate
    assert np.abs(learnt - [0.3, -1.0]).max() < 0.2
    for step in (99, 500, 3):
        estimator.measure(step, case.reference.state[0])
        estimator.apply(step, case.slope, case.trim.inputs)
        np.testing.assert_array_equal(estimator.estimate, learnt)
    estimator.reset()
    np.testing.assert_array_equal(estimator.estimate, 0.0)


def test_estimate_is_limited(pendulum, make_case):
    case = make_case(45.0)
    estimator = DisturbanceEstimator(pendulum, case.reference, noise=DisturbanceNoise(limit=0.01, gate=1e9))
    for step in range(200):
        estimator.measure(step, case.reference.state[0] + [0.0, 0.1 * step, 0.0, 0.0])
        estimator.apply(step, case.slope, case.trim.inputs)
    assert abs(estimator.estimate[1]) == pytest.approx(0.01 * disturbance_levers(pendulum)[1])


@pytest.mark.parametrize("name", ["angle", "rate", "acceleration", "walk", "limit", "gate"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_noise_must_be_positive(name, value):
    with pytest.raises(InvalidSettingError, match=name):
        DisturbanceNoise(**{name: value})
