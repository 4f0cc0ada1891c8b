"""The inertial estimator: rotations, Kalman filters against the textbook, and what a sliding wheel does to it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are
from scipy.spatial.transform import Rotation

from m4_dynamics.control import inertial_kernels as kernels
from m4_dynamics.control.imu import ImuErrors
from m4_dynamics.control.inertial import ODOMETRY_NOISE, InertialEstimator
from m4_dynamics.errors import InvalidSettingError

DT = 5e-3
GRAVITY = 9.81
RADIUS, TRACK = 0.125, 0.28
angles = st.floats(-math.pi, math.pi)


def pendulum_attitude(slope: float, heading: float, roll: float, pitch: float) -> np.ndarray:
    """Rotation from pendulum axes to world of a body whose axle lies at a roll out of the slope's plane."""
    about_normal = Rotation.from_rotvec(heading * np.array([-math.sin(slope), 0.0, math.cos(slope)]))
    along = Rotation.from_rotvec(roll * np.array([math.cos(slope), 0.0, math.sin(slope)]))
    return (about_normal * along * Rotation.from_euler("y", pitch)).as_matrix()


def heading_of(rotation: np.ndarray, slope: float) -> float:
    return math.atan2(-(rotation[:, 1] @ [math.cos(slope), 0.0, math.sin(slope)]), rotation[1, 1])


def estimator(slope: float = 0.0, **changes) -> InertialEstimator:
    settings = {
        "axes_in_base": np.eye(3), "wheels": 2, "drive_wheels": (0, 1), "wheel_signs": (1.0, 1.0),
        "wheel_radius": RADIUS, "track": TRACK, "slope": slope, "axle_in_base": np.array([0.02, 0.0, -0.4]),
        "encoder_resolution": 2.0 * math.pi / 4096,
    }  # fmt: skip
    return InertialEstimator(**{**settings, **changes})


def at_rest(attitude: np.ndarray, wheel_angles=(0.0, 0.0)) -> np.ndarray:
    """A measurement of a body at rest, its attitude not given."""
    return np.array([*[math.nan] * 4, 0.0, 0.0, 0.0, *(GRAVITY * attitude[2]), *wheel_angles, 0.0, 0.0])


@settings(deadline=None)  # the first call compiles
@given(x=st.floats(-6, 6), y=st.floats(-6, 6), z=st.floats(-6, 6), scale=st.sampled_from([1.0, 1e-3, 1e-6, 1e-12]))
def test_rotation_of_a_vector_is_rodrigues(x, y, z, scale):
    vector, out = scale * np.array([x, y, z]), np.empty((3, 3))
    kernels.rotation_of(vector, out)
    np.testing.assert_allclose(out, Rotation.from_rotvec(vector).as_matrix(), atol=1e-12)


@settings(deadline=None)  # the first call compiles
@given(slope=st.floats(0.0, 1.3), heading=angles, roll=st.floats(-0.4, 0.4), pitch=angles)
def test_level_finds_the_attitude_from_vertical_and_heading(slope, heading, roll, pitch):
    rotation = pendulum_attitude(slope, heading, roll, pitch)
    # Where the axle points straight up or down the heading says nothing about the yaw.
    assume(abs(rotation[2, 1]) < 0.95)
    found = np.empty((3, 3))
    kernels.level(GRAVITY * rotation[2], heading_of(rotation, slope), slope, found)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(found[2], rotation[2], atol=1e-12)
    assert abs(kernels.wrap(heading_of(found, slope) - heading_of(rotation, slope))) < 1e-7
    if abs(heading) < 1.2 and abs(roll) < 0.1 and slope < 1.0:
        np.testing.assert_allclose(found, rotation, atol=1e-7)


@settings(deadline=None)  # the first call compiles
@given(x=angles, y=angles, z=angles, error=st.floats(-1e-4, 1e-4))
def test_orthonormalise_takes_out_rounding_and_no_more(x, y, z, error):
    exact = Rotation.from_euler("xyz", [x, y, z]).as_matrix()
    rotation = exact + error * np.array([[1.0, -0.5, 0.3], [0.2, 0.7, -1.0], [-0.4, 0.6, 0.1]])
    kernels.orthonormalise(rotation)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation, exact, atol=5.0 * abs(error) + 1e-12)


@pytest.mark.parametrize("n", [3, 6])
def test_prediction_and_correction_are_kalmans(n):
    rng = np.random.default_rng(n)
    root, transition, noise = rng.normal(size=(3, n, n))
    covariance, noise = root @ root.T, noise @ noise.T
    expected = transition @ covariance @ transition.T + noise
    kernels.predict(covariance, transition, noise)
    np.testing.assert_allclose(covariance, expected, rtol=1e-12, atol=1e-12)
    # Two scalar measurements one after the other are one measurement of both.
    h, variances = rng.normal(size=(2, n)), np.array([0.3, 0.7])
    innovation = np.array([0.2, -0.1])
    gain = expected @ h.T @ np.linalg.inv(h @ expected @ h.T + np.diag(variances))
    error = np.zeros(n)
    for row in range(2):
        assert kernels.correct(covariance, h[row], variances[row], innovation[row], error) == 0.0
    np.testing.assert_allclose(error, gain @ innovation, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(covariance, (np.eye(n) - gain @ h) @ expected, rtol=1e-9, atol=1e-9)


def models(design, case):
    """Transition, noise, observation rows and their variances of one of the three filters."""
    n = {"longitudinal": 4, "lateral": 6, "vertical": 3}[case]
    f, q = np.zeros((n, n)), np.zeros((n, n))
    if case == "lateral":
        h, r = np.zeros((2, n)), [design[kernels.SIDEWAYS_VARIANCE], design[kernels.HEADING_VARIANCE]]
        kernels.lateral_model(design, 0.3, -0.5, 0.86, 0.05, 0.4, f, q, h)
    else:
        h, r = np.zeros((1, n)), [design[kernels.TRAVEL_VARIANCE]]
        if case == "longitudinal":
            kernels.longitudinal_model(design, 0.5, f, q, h[0])
        else:
            kernels.vertical_model(design, f, q, h[0])
    return f, q, h, np.diag(r)


@pytest.mark.parametrize("case", ["longitudinal", "lateral", "vertical"])
def test_gains_settle_at_the_riccati_equations(case):
    one = estimator(errors=ImuErrors(gyro_bias_walk=1e-2))  # offsets that wander fast are found fast
    one.reset(at_rest(np.eye(3)))
    f, q, h, r = models(one._design, case)
    covariance = 1e-4 * np.eye(len(f))
    for _ in range(20_000):
        kernels.predict(covariance, f, q)
        predicted = covariance.copy()
        for row in range(len(h)):
            kernels.correct(covariance, h[row], r[row, row], 0.0, np.zeros(len(f)))
    steady = solve_discrete_are(f.T, h.T, q, r)
    gain = predicted @ h.T @ np.linalg.inv(h @ predicted @ h.T + r)
    np.testing.assert_allclose(gain, steady @ h.T @ np.linalg.inv(h @ steady @ h.T + r), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("slope", [0.0, 0.6])
@pytest.mark.parametrize(
    ("case", "entry"),
    [(case, i) for case, n in (("longitudinal", 4), ("lateral", 6), ("vertical", 3)) for i in range(n)],
)
def test_error_models_are_the_derivatives_of_the_navigation(case, entry, slope):
    # Two navigations without any correction, one started with a small error: what they expect of the odometer must
    # differ as the linear model says.
    attitude = pendulum_attitude(slope, 0.0, 0.0, -0.1)
    size, steps = 1e-6, 40
    innovations = []
    for error in (0.0, size):
        one = estimator(slope)
        one.reset(at_rest(attitude))
        for covariance in (one._longitudinal, one._lateral, one._vertical):
            covariance[:] = 0.0
        for index in (kernels.RATE_VARIANCE, kernels.BIAS_STEP_VARIANCE, kernels.VERTICAL_BIAS_STEP_VARIANCE,
                      kernels.ACCELERATION_VARIANCE):  # fmt: skip
            one._design[index] = 0.0
        _err(one, case, entry, -error)  # the estimate is the truth less the error
        for _ in range(steps):
            one.update(at_rest(attitude))
        place = one._rotation @ one._sensor - one._drift
        turn = -heading_of(one._rotation, slope)
        innovations.append(
            {"longitudinal": place[:1], "lateral": np.array([place[1], turn]), "vertical": place[2:]}[case]
        )
        height, ahead = place[2] + one._drift[2], place[0] + one._drift[0]
        design = one._design.copy()
    f, q, h, _ = models(design, case)
    if case == "longitudinal":
        kernels.longitudinal_model(design, RADIUS * math.cos(slope) + height, f, q, h[0])
    elif case == "lateral":
        kernels.lateral_model(design, 0.0, -math.sin(slope), math.cos(slope), ahead, height, f, q, h)
    expected = h @ np.linalg.matrix_power(f, steps)[:, entry]
    found = (innovations[1] - innovations[0]) / size
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=2e-5)


def _err(one: InertialEstimator, case: str, entry: int, error: float) -> None:
    """Put an error of one entry into an estimate that stands at heading 0."""
    axis = {"longitudinal": 0, "lateral": 1, "vertical": 2}[case]
    if entry == 0:
        one._drift[axis] += error
    elif entry == 1:
        one._velocity[axis] += error
    elif case == "vertical":
        one._vertical_bias[0] += error
    else:
        tilts = {("longitudinal", 2): [0, 1, 0], ("lateral", 2): [1, 0, 0], ("lateral", 3): [0, 0, 1]}
        offsets = {("longitudinal", 3): [0, 1, 0], ("lateral", 4): [1, 0, 0], ("lateral", 5): [0, 0, 1]}
        vector = {**tilts, **offsets}[case, entry]
        if (case, entry) in tilts:
            # The odometer counts with the pitch.
            one._drift -= RADIUS * error * vector[1] * np.array([math.cos(one.slope), 0.0, math.sin(one.slope)])
            one._rotation[:] = Rotation.from_rotvec(error * np.array(vector)).as_matrix() @ one._rotation
        else:
            one._bias[:] += one._rotation.T @ (error * np.array(vector, dtype=float))


@pytest.mark.parametrize("slope", [0.0, 0.7])
def test_errors_are_as_large_as_the_filter_expects(slope):
    # Forty sensors at rest, each with its own offsets and noise: estimates scatter as the covariances say.
    attitude = pendulum_attitude(slope, 0.1, 0.0, -0.3)
    errors = ImuErrors(gyro_bias_walk=0.0, accelerometer_bias=0.0)
    rate_deviation = ImuErrors.sample_deviation(errors.gyro_noise, DT)
    force_deviation = ImuErrors.sample_deviation(errors.accelerometer_noise, DT)
    marks, runs = (100, 400, 1600), 40
    misses = np.empty((runs, len(marks), 4))
    for run in range(runs):
        rng = np.random.default_rng(run)
        offset = errors.gyro_bias * rng.standard_normal(3)

        def sample(rng=rng, offset=offset):
            values = at_rest(attitude)
            values[4:7] += offset + rate_deviation * rng.standard_normal(3)
            values[7:10] += force_deviation * rng.standard_normal(3)
            values[10:12] += ODOMETRY_NOISE / RADIUS * rng.standard_normal(2)
            return values

        one = estimator(slope, errors=errors)
        one.reset(sample(), wheel_angle=3.0, heading=0.1)
        for k in range(1, marks[-1] + 1):
            one.update(sample())
            if k in marks:
                tilt = Rotation.from_matrix(one._rotation @ attitude.T).as_rotvec()
                offsets = one._rotation @ (one.gyro_bias - offset)
                # Tilt and offset about the horizontal lateral axis, tilt about the one ahead of it, offset about z.
                left = np.array([-math.sin(0.1 * math.cos(slope)), math.cos(0.1 * math.cos(slope)), 0.0])
                ahead = np.array([left[1], -left[0], 0.0])
                expected = np.sqrt(
                    [one._longitudinal[2, 2], one._longitudinal[3, 3], one._lateral[2, 2], one._lateral[5, 5]]
                )
                found = np.array([tilt @ left, offsets @ left, tilt @ ahead, offsets[2]])
                misses[run, marks.index(k)] = found / expected
    scatter = np.sqrt((misses**2).mean(axis=0))
    # A standard deviation from 40 draws is good to 11 %.
    assert np.all(scatter > 0.6), scatter
    assert np.all(scatter < 1.4), scatter
    assert one.pitch_deviation < math.radians(0.06)
    assert one.state[0] == pytest.approx(3.0, abs=0.02)


def test_a_sliding_wheel_does_not_turn_the_vertical():
    # Both wheels spin by 1 rad within 50 ms under a robot that does not move, and go on turning with the ground again.
    one, attitude = estimator(), pendulum_attitude(0.0, 0.0, 0.0, -0.2)
    one.reset(at_rest(attitude))
    for _ in range(400):
        one.update(at_rest(attitude))
    before = one.pitch
    for k in range(200):
        angle = min(k, 10) * 0.1
        one.update(at_rest(attitude, (angle, angle)))
        assert abs(one.pitch - before) < math.radians(0.1)
        assert abs(one.heading) < math.radians(0.1)
    assert abs(one.state[2]) < 0.1, "at rest again"
    # One wheel alone spins: the heading is the gyro's.
    for k in range(100):
        one.update(at_rest(attitude, (1.0 + min(k, 10) * 0.1, 1.0)))
    assert abs(one.heading) < math.radians(0.2)


def test_a_given_attitude_is_taken_and_the_heading_is_the_odometers():
    attitude = pendulum_attitude(0.3, 0.0, 0.0, -0.25)
    quaternion = Rotation.from_matrix(attitude).as_quat()

    def sample(left: float, right: float) -> np.ndarray:
        values = at_rest(attitude, (left, right))
        values[:4] = quaternion
        return values

    one = estimator(0.3)
    one.reset(sample(0.0, 0.0), heading=0.2)
    one.update(sample(-0.1, 0.1))
    assert one.pitch == pytest.approx(-0.25, abs=1e-12)
    assert one.heading == pytest.approx(0.2 + RADIUS / TRACK * 0.2, abs=1e-12)


def test_a_new_place_leaves_level_and_offsets_alone():
    one, attitude = estimator(0.5), pendulum_attitude(0.5, 0.1, 0.0, -0.3)
    values = at_rest(attitude, (0.7, 0.2))
    values[5] = 2e-3
    one.reset(values, heading=0.1)
    for _ in range(1000):
        one.update(values)
    pitch, bias, deviation = one.pitch, one.gyro_bias, one.pitch_deviation
    one.relocate(values, wheel_angle=-7.0, heading=0.4)
    assert (one.pitch, one.pitch_deviation) == pytest.approx((pitch, deviation), abs=1e-3)
    np.testing.assert_array_equal(one.gyro_bias, bias)
    for _ in range(2):
        assert one.state[0] == pytest.approx(-7.0, abs=1e-3)
        assert one.heading == pytest.approx(0.4, abs=1e-3)
        one.update(values)


def test_figures_that_cannot_be_meant_are_refused():
    for change in ({"track": 0.0}, {"period": -1.0}, {"wheel_radius": math.nan}, {"encoder_resolution": -0.1}):
        with pytest.raises(InvalidSettingError, match=next(iter(change))):
            estimator(**change)
