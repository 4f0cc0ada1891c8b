"""Numba kernels of the inertial estimator: rotations, and one sample of its Kalman filter.

They stand in one file because a cached Numba kernel does not notice that a kernel which it calls in another file has
changed. Arrays are plain; `control/inertial.py` owns them and explains the filter.

Frames: W the world, P the pendulum's axes on the base (forward, lateral, up), H the horizontal heading frame: l is the
lateral axis's horizontal direction, f ahead of it, z up. Errors (true less estimated) stand in three filters that are
independent to first order:

    longitudinal: position and velocity along f, tilt about l, gyro offset about l
    lateral:      position and velocity along l, tilt about f and turn about z, gyro offsets about f and z
    vertical:     position and velocity along z, accelerometer offset along z
"""

# Arguments of one kind share a line of the docstring.
# ruff: noqa: D417

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

# Entries of the design: variances of one sample, and the geometry.
(
    ACCELERATION_VARIANCE, RATE_VARIANCE, BIAS_STEP_VARIANCE, VERTICAL_BIAS_STEP_VARIANCE, TRAVEL_VARIANCE,
    SIDEWAYS_VARIANCE, HEADING_VARIANCE, WHEEL_RADIUS, TRACK, GRAVITY, PERIOD,
) = range(11)  # fmt: skip
DESIGN_ENTRIES = 11

#: An innovation of more standard deviations than this is no noise; one in two million is beyond it by chance.
OUTLIER = 5.0

# Entries of an estimate, the same as the ideal estimator's.
PHI, PITCH, PHI_RATE, PITCH_RATE, HEADING, HEADING_RATE, ROLL = range(7)
ESTIMATE_ENTRIES = 7


@njit(cache=True)
def wrap(angle: float) -> float:
    """The same direction within half a turn of zero."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@njit(cache=True)
def rotation_of(vector: Any, out: Any) -> None:
    """Rotation matrix of a rotation vector (Rodrigues), shape (3,) -> (3, 3)."""
    x, y, z = vector[0], vector[1], vector[2]
    square = x * x + y * y + z * z
    if square < 1e-10:
        # Taylor series; what is left out is below rounding.
        sine, versine = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        angle = math.sqrt(square)
        sine, versine = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    out[0, 0] = 1.0 - versine * (y * y + z * z)
    out[1, 1] = 1.0 - versine * (x * x + z * z)
    out[2, 2] = 1.0 - versine * (x * x + y * y)
    out[0, 1] = versine * x * y - sine * z
    out[1, 0] = versine * x * y + sine * z
    out[0, 2] = versine * x * z + sine * y
    out[2, 0] = versine * x * z - sine * y
    out[1, 2] = versine * y * z - sine * x
    out[2, 1] = versine * y * z + sine * x


@njit(cache=True)
def multiply(a: Any, b: Any, out: Any) -> None:
    """Product of two 3 x 3 matrices; `out` must be neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(cache=True)
def orthonormalise(rotation: Any) -> None:
    """Take rounding out of a rotation matrix: rows 0 and 2 made unit and normal to each other, row 1 their product."""
    for i in (2, 0):
        if i == 0:
            overlap = (
                rotation[2, 0] * rotation[0, 0] + rotation[2, 1] * rotation[0, 1] + rotation[2, 2] * rotation[0, 2]
            )
            for j in range(3):
                rotation[0, j] -= overlap * rotation[2, j]
        length = math.sqrt(rotation[i, 0] ** 2 + rotation[i, 1] ** 2 + rotation[i, 2] ** 2)
        for j in range(3):
            rotation[i, j] /= length
    rotation[1, 0] = rotation[2, 1] * rotation[0, 2] - rotation[2, 2] * rotation[0, 1]
    rotation[1, 1] = rotation[2, 2] * rotation[0, 0] - rotation[2, 0] * rotation[0, 2]
    rotation[1, 2] = rotation[2, 0] * rotation[0, 1] - rotation[2, 1] * rotation[0, 0]


@njit(cache=True)
def level(up_in_pendulum: Any, heading: float, slope: float, out: Any) -> None:
    """Attitude with a given vertical and a given heading.

    Args:
        up_in_pendulum: The vertical, in P, of any length, shape (3,).
        heading: About the slope normal, positive left of uphill [rad].
        slope: Inclination of the ground [rad].
        out: Filled, rotation from P to W, shape (3, 3).
    """
    length = math.sqrt(up_in_pendulum[0] ** 2 + up_in_pendulum[1] ** 2 + up_in_pendulum[2] ** 2)
    for j in range(3):
        out[2, j] = up_in_pendulum[j] / length
    # The lateral axis is (-c sin yaw, c cos yaw, s); the yaw follows from -l.t cos(heading) = l_y sin(heading).
    rise = out[2, 1]
    across = math.sqrt(max(1.0 - rise * rise, 1e-12))
    sine = across * math.cos(slope) * math.cos(heading)
    cosine = -across * math.sin(heading)
    ratio = rise * math.sin(slope) * math.cos(heading) / math.sqrt(sine * sine + cosine * cosine)
    yaw = math.atan2(-cosine, sine) + math.asin(min(1.0, max(-1.0, ratio)))
    # Horizontal directions across and along the lateral axis, in P.
    left = np.array([-out[2, 0] * rise / across, across, -out[2, 2] * rise / across])
    ahead = np.array(
        [
            left[1] * out[2, 2] - left[2] * out[2, 1],
            left[2] * out[2, 0] - left[0] * out[2, 2],
            left[0] * out[2, 1] - left[1] * out[2, 0],
        ]
    )
    for j in range(3):
        out[0, j] = math.cos(yaw) * ahead[j] - math.sin(yaw) * left[j]
        out[1, j] = math.sin(yaw) * ahead[j] + math.cos(yaw) * left[j]


@njit(cache=True)
def predict(covariance: Any, transition: Any, noise: Any) -> None:
    """P <- F P F^T + Q, in place; Q is symmetric, shape (n, n) all."""
    n = covariance.shape[0]
    half = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            if transition[i, k] != 0.0:
                for j in range(n):
                    half[i, j] += transition[i, k] * covariance[k, j]
    for i in range(n):
        for j in range(i, n):
            total = noise[i, j]
            for k in range(n):
                total += half[i, k] * transition[j, k]
            covariance[i, j] = total
            covariance[j, i] = total


@njit(cache=True)
def correct(covariance: Any, observation: Any, variance: float, innovation: float, error: Any) -> float:
    """One scalar measurement y = H x + noise: the estimated error x and its covariance, in place.

    An innovation beyond `OUTLIER` standard deviations corrects nothing: a wheel slides, and the odometer has run away.

    Args:
        covariance: P, shape (n, n).
        observation: H, shape (n,).
        variance: Of the noise.
        innovation: Measured less expected before anything was corrected in this sample.
        error: x so far, shape (n,).

    Returns:
        0, or the whole of an innovation that was left out.
    """
    n = covariance.shape[0]
    gain = np.empty(n)
    total = variance
    left = innovation
    for i in range(n):
        gain[i] = 0.0
        for j in range(n):
            gain[i] += covariance[i, j] * observation[j]
        total += observation[i] * gain[i]
        left -= observation[i] * error[i]
    if left * left > OUTLIER * OUTLIER * total:
        return left
    for i in range(n):
        error[i] += gain[i] / total * left
        for j in range(i, n):
            covariance[i, j] -= gain[i] * gain[j] / total
            covariance[j, i] = covariance[i, j]
    return 0.0


@njit(cache=True)
def restart(covariance: Any, observation: Any, place_variance: float, slid: float, period: float) -> None:
    """After an outlier: the place is the odometer's, the speed may be wrong by as much as it slid, the rest stands.

    Place and speed no longer say anything about tilt and offsets, so a sliding wheel does not turn the vertical. If it
    goes on sliding, the next samples take its speed for the robot's, as any odometer does, until it grips again.

    Args:
        covariance: P, shape (n, n); position and velocity first.
        observation: H of the place, 1 in the position's entry, shape (n,).
        place_variance: Variance of the odometer's place in one sample [m^2].
        slid: The outlier [m].
        period: Time between samples [s].
    """
    n = covariance.shape[0]
    speed_variance = covariance[1, 1] + (slid / period) ** 2
    covariance[:2, :] = 0.0
    covariance[:, :2] = 0.0
    covariance[1, 1] = speed_variance
    # The place agrees with what is expected of it, so it is wrong by as much as the tilt makes that wrong: H x = noise.
    covariance[0, 0] = place_variance
    for i in range(2, n):
        for j in range(2, n):
            covariance[0, i] -= observation[j] * covariance[j, i]
        covariance[i, 0] = covariance[0, i]
    for i in range(2, n):
        covariance[0, 0] -= observation[i] * covariance[0, i]


@njit(cache=True)
def longitudinal_model(design: Any, arm: float, transition: Any, noise: Any, observation: Any) -> None:
    """Model of the errors (position, velocity, tilt, gyro offset) along f.

    Tilt turns gravity's reaction into acceleration, delta v' = g tilt. The odometer counts wheel against body, so a
    tilt shifts it by r tilt, and the sensor above the axle by its height: `arm` is the sum of both.
    """
    dt, g = design[PERIOD], design[GRAVITY]
    _chain(design, transition, noise)
    transition[0, 2], transition[1, 2] = 0.5 * g * dt * dt, g * dt
    transition[2, 3] = -dt
    # The attitude turns before it is used, so the offset acts within the sample already.
    transition[0, 3], transition[1, 3] = -0.5 * g * dt**3, -g * dt * dt
    noise[2, 2] = design[RATE_VARIANCE] * dt * dt
    noise[3, 3] = design[BIAS_STEP_VARIANCE]
    observation[:] = 0.0
    observation[0], observation[2] = 1.0, -arm


@njit(cache=True)
def lateral_model(
    design: Any, speed: float, normal_ahead: float, normal_up: float, ahead: float, height: float, transition: Any,
    noise: Any, observations: Any,
) -> None:  # fmt: skip
    """Model of the errors (position, velocity, tilt about f, turn about z, gyro offsets about f and z) along l.

    The axle does not move sideways, but a turn of the heading turns its speed. The heading is the turn about the slope
    normal, n = normal_ahead f + normal_up z. `ahead` and `height` are the sensor's place from the axle.
    """
    dt, g = design[PERIOD], design[GRAVITY]
    _chain(design, transition, noise)
    transition[0, 2], transition[1, 2] = -0.5 * g * dt * dt, -g * dt
    transition[0, 2] -= speed * dt * normal_ahead
    transition[0, 3] = -speed * dt * normal_up
    transition[0, 4], transition[1, 4] = 0.5 * g * dt**3, g * dt * dt
    transition[2, 4] = transition[3, 5] = -dt
    noise[2, 2] = noise[3, 3] = design[RATE_VARIANCE] * dt * dt
    noise[4, 4] = noise[5, 5] = design[BIAS_STEP_VARIANCE]
    observations[:] = 0.0
    observations[0, 0], observations[0, 2], observations[0, 3] = 1.0, height, -ahead
    observations[1, 2], observations[1, 3] = normal_ahead, normal_up


@njit(cache=True)
def vertical_model(design: Any, transition: Any, noise: Any, observation: Any) -> None:
    """Model of the errors (position, velocity, accelerometer offset) along z."""
    dt = design[PERIOD]
    _chain(design, transition, noise)
    transition[0, 2], transition[1, 2] = -0.5 * dt * dt, -dt
    noise[2, 2] = design[VERTICAL_BIAS_STEP_VARIANCE]
    observation[:] = 0.0
    observation[0] = 1.0


@njit(cache=True)
def _chain(design: Any, transition: Any, noise: Any) -> None:
    """What all three have in common: position and velocity driven by acceleration noise."""
    dt = design[PERIOD]
    transition[:] = 0.0
    noise[:] = 0.0
    for i in range(transition.shape[0]):
        transition[i, i] = 1.0
    transition[0, 1] = dt
    variance = design[ACCELERATION_VARIANCE] * dt * dt
    noise[0, 0] = 0.25 * variance * dt * dt
    noise[0, 1] = noise[1, 0] = 0.5 * variance * dt
    noise[1, 1] = variance


@njit(cache=True)
def navigate(
    measurement: Any, wheels: int, left: int, right: int, sign_left: float, sign_right: float, axes: Any, sensor: Any,
    slope: float, zero: Any, design: Any, rotation: Any, bias: Any, vertical_bias: Any, drift: Any, velocity: Any,
    previous: Any, longitudinal: Any, lateral: Any, vertical: Any, out: Any,
) -> None:  # fmt: skip
    """One sample of the estimator.

    Args:
        measurement: Flat measurement, see `control/estimator.py`; an attitude that is not NaN is taken as it is.
        wheels: Number of wheels. left, right: indices of the drive wheels. sign_left, sign_right: of their joints.
        axes: Forward, lateral and up in the base, rows, shape (3, 3).
        sensor: The sensor's place from the axle, in P, shape (3,) [m].
        slope: [rad].
        zero: Relative angle of the left and of the right wheel where the odometer started, and the heading there.
        design: See the names of its entries.
        rotation, bias, vertical_bias, drift, velocity: The estimate, overwritten: rotation from P to W; gyro offset in
            P [rad/s]; accelerometer offset along z [m/s^2], shape (1,); inertial place of the sensor less the
            odometer's place of the axle, in W [m]; velocity of the sensor in W [m/s].
        previous: Of the sample before, overwritten: angular rate in P (3), relative angle of the left and of the right
            wheel (2).
        longitudinal, lateral, vertical: Covariances, shapes (4, 4), (6, 6), (3, 3), overwritten.
        out: Filled, see the names of its entries.
    """
    dt, radius = design[PERIOD], design[WHEEL_RADIUS]
    sine, cosine = math.sin(slope), math.cos(slope)
    given = not math.isnan(measurement[0])

    rate = np.empty(3)
    force = np.empty(3)
    middle = np.empty(3)
    for i in range(3):
        rate[i] = 0.0
        force[i] = 0.0
        for j in range(3):
            rate[i] += axes[i, j] * measurement[4 + j]
            force[i] += axes[i, j] * measurement[7 + j]
        middle[i] = dt * (0.5 * (rate[i] + previous[i]) - bias[i])
        previous[i] = rate[i]
    angle_left = sign_left * measurement[10 + left]
    angle_right = sign_right * measurement[10 + right]
    pitch_before = math.atan2(-rotation[2, 0], rotation[2, 2])

    # Propagation: turn by the gyro, accelerate by the accelerometer.
    small, turned = np.empty((3, 3)), np.empty((3, 3))
    if given:
        attitude(measurement, axes, rotation)
    else:
        rotation_of(middle, small)
        multiply(rotation, small, turned)
        rotation[:] = turned
    pitch = math.atan2(-rotation[2, 0], rotation[2, 2])
    rolled = 0.5 * (angle_left - previous[3] + angle_right - previous[4])
    rolled += wrap(pitch - pitch_before)
    previous[3], previous[4] = angle_left, angle_right
    travel = np.empty(3)  # direction of travel: lateral axis x slope normal
    _travel_direction(rotation, sine, cosine, travel)
    acceleration = np.empty(3)
    for i in range(3):
        acceleration[i] = rotation[i, 0] * force[0] + rotation[i, 1] * force[1] + rotation[i, 2] * force[2]
    acceleration[2] -= design[GRAVITY] + vertical_bias[0]
    place = np.empty(3)
    for i in range(3):
        drift[i] += dt * (velocity[i] + 0.5 * dt * acceleration[i]) - radius * rolled * travel[i]
        velocity[i] += dt * acceleration[i]
        place[i] = rotation[i, 0] * sensor[0] + rotation[i, 1] * sensor[1] + rotation[i, 2] * sensor[2]
    rate_angle = (velocity[0] * travel[0] + velocity[1] * travel[1] + velocity[2] * travel[2]) / radius

    # The heading frame.
    across = math.hypot(rotation[0, 1], rotation[1, 1])
    left_x, left_y = rotation[0, 1] / across, rotation[1, 1] / across
    ahead_x, ahead_y = left_y, -left_x
    innovation = np.empty(3)
    for i in range(3):
        innovation[i] = place[i] - drift[i]
    along, sideways = ahead_x * innovation[0] + ahead_y * innovation[1], left_x * innovation[0] + left_y * innovation[1]
    travel_ahead = travel[0] * ahead_x + travel[1] * ahead_y
    place_ahead = place[0] * ahead_x + place[1] * ahead_y

    transition, noise = np.empty((4, 4)), np.empty((4, 4))
    along_model = np.empty(4)
    error_long = np.zeros(4)
    longitudinal_model(design, radius * travel_ahead + place[2], transition, noise, along_model)
    predict(longitudinal, transition, noise)
    slid_along = correct(longitudinal, along_model, design[TRAVEL_VARIANCE], along, error_long)

    transition, noise = np.empty((6, 6)), np.empty((6, 6))
    observations = np.empty((2, 6))
    error_lat = np.zeros(6)
    lateral_model(design, radius * rate_angle, -sine * ahead_x, cosine, place_ahead, place[2], transition, noise,
                  observations)  # fmt: skip
    predict(lateral, transition, noise)
    counted = radius / design[TRACK] * (angle_right - zero[1] - angle_left + zero[0]) + zero[2]
    turn = wrap(counted - _heading(rotation, sine, cosine))
    slid_sideways = correct(lateral, observations[0], design[SIDEWAYS_VARIANCE], sideways, error_lat)
    slid_round = correct(lateral, observations[1], design[HEADING_VARIANCE], turn, error_lat)

    transition, noise = np.empty((3, 3)), np.empty((3, 3))
    observation = np.empty(3)
    error_vert = np.zeros(3)
    vertical_model(design, transition, noise, observation)
    predict(vertical, transition, noise)
    slid_up = correct(vertical, observation, design[TRAVEL_VARIANCE], innovation[2], error_vert)

    # What cannot be noise is the odometer's fault: its place and its heading start anew from where the robot is.
    if slid_along != 0.0:
        restart(longitudinal, along_model, design[TRAVEL_VARIANCE], slid_along, dt)
    if slid_sideways != 0.0:
        restart(lateral, observations[0], design[SIDEWAYS_VARIANCE], slid_sideways, dt)
    if slid_up != 0.0:
        restart(vertical, observation, design[TRAVEL_VARIANCE], slid_up, dt)

    # Take the estimated errors out.
    drift[0] += ahead_x * (error_long[0] + slid_along) + left_x * (error_lat[0] + slid_sideways)
    drift[1] += ahead_y * (error_long[0] + slid_along) + left_y * (error_lat[0] + slid_sideways)
    drift[2] += error_vert[0] + slid_up
    zero[2] -= slid_round
    velocity[0] += ahead_x * error_long[1] + left_x * error_lat[1]
    velocity[1] += ahead_y * error_long[1] + left_y * error_lat[1]
    velocity[2] += error_vert[1]
    vertical_bias[0] += error_vert[2]
    if not given:
        middle[0] = ahead_x * error_lat[2] + left_x * error_long[2]
        middle[1] = ahead_y * error_lat[2] + left_y * error_long[2]
        middle[2] = error_lat[3]
        rotation_of(middle, small)
        multiply(small, rotation, turned)
        rotation[:] = turned
        orthonormalise(rotation)
        offset_x = ahead_x * error_lat[4] + left_x * error_long[3]
        offset_y = ahead_y * error_lat[4] + left_y * error_long[3]
        for j in range(3):
            bias[j] += rotation[0, j] * offset_x + rotation[1, j] * offset_y + rotation[2, j] * error_lat[5]
        # The odometer counts with the pitch, so a corrected pitch moves it.
        corrected = math.atan2(-rotation[2, 0], rotation[2, 2])
        shift = radius * wrap(corrected - pitch)
        for i in range(3):
            drift[i] -= shift * travel[i]

    read_out(rotation, bias, velocity, rate, sensor, slope, angle_left - zero[0], angle_right - zero[1], radius, out)
    if given:
        # A given attitude tells the vertical; the heading is the odometer's, as with ideal sensors.
        out[HEADING] = counted


@njit(cache=True)
def read_out(
    rotation: Any, bias: Any, velocity: Any, rate: Any, sensor: Any, slope: float, angle_left: float,
    angle_right: float, radius: float, out: Any,
) -> None:  # fmt: skip
    """The reduced state, heading and roll of an estimate.

    Args:
        rotation, bias, velocity: The estimate, see `navigate`.
        rate: Measured angular rate in P [rad/s].
        sensor, slope, radius: See `navigate`.
        angle_left, angle_right: Relative angles of the wheels since the odometer's start [rad].
        out: Filled, see the names of its entries.
    """
    sine, cosine = math.sin(slope), math.cos(slope)
    wx, wy, wz = rate[0] - bias[0], rate[1] - bias[1], rate[2] - bias[2]
    # Velocity of the axle = that of the sensor less omega x (sensor's place).
    swing = np.empty(3)
    swing[0], swing[1], swing[2] = (
        wy * sensor[2] - wz * sensor[1],
        wz * sensor[0] - wx * sensor[2],
        wx * sensor[1] - wy * sensor[0],
    )
    travel = np.empty(3)
    _travel_direction(rotation, sine, cosine, travel)
    speed = 0.0
    heading_rate = 0.0
    for i in range(3):
        swung = rotation[i, 0] * swing[0] + rotation[i, 1] * swing[1] + rotation[i, 2] * swing[2]
        speed += travel[i] * (velocity[i] - swung)
        turning = rotation[i, 0] * wx + rotation[i, 1] * wy + rotation[i, 2] * wz
        heading_rate += (-sine if i == 0 else (cosine if i == 2 else 0.0)) * turning
    out[PITCH] = math.atan2(-rotation[2, 0], rotation[2, 2])
    out[PITCH_RATE] = wy
    out[PHI] = 0.5 * (angle_left + angle_right) + out[PITCH]
    out[PHI_RATE] = speed / radius
    out[HEADING] = _heading(rotation, sine, cosine)
    out[HEADING_RATE] = heading_rate
    out[ROLL] = math.asin(min(1.0, max(-1.0, rotation[2, 1])))


@njit(cache=True)
def _heading(rotation: Any, sine: float, cosine: float) -> float:
    return math.atan2(-(rotation[0, 1] * cosine + rotation[2, 1] * sine), rotation[1, 1])


@njit(cache=True)
def _travel_direction(rotation: Any, sine: float, cosine: float, out: Any) -> None:
    """Unit vector along the ground, ahead of the lateral axis: lateral x normal, with the normal (-sine, 0, cosine)."""
    x, y, z = rotation[0, 1], rotation[1, 1], rotation[2, 1]
    out[0], out[1], out[2] = y * cosine, -z * sine - x * cosine, y * sine
    length = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    for i in range(3):
        out[i] /= length


@njit(cache=True)
def attitude(measurement: Any, axes: Any, out: Any) -> None:
    """Rotation from P to W of a measured attitude of the base."""
    x, y, z, w = measurement[0], measurement[1], measurement[2], measurement[3]
    base = np.empty((3, 3))
    base[0, 0], base[0, 1], base[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    base[1, 0], base[1, 1], base[1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    base[2, 0], base[2, 1], base[2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    for i in range(3):
        for j in range(3):
            out[i, j] = base[i, 0] * axes[j, 0] + base[i, 1] * axes[j, 1] + base[i, 2] * axes[j, 2]
