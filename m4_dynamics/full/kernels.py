"""Numba kernels of the full model: contact detection, ground law, contact-implicit step.

They stand in one file because a cached Numba kernel does not notice that a kernel which it calls in another file has
changed. Arrays are plain; `full/model.py` packs them and documents their meaning. Conventions:

- `jacobians` is Pinocchio's `data.J`: column c is the twist of the world's origin caused by velocity c, so that the
  velocity of a point p fixed to a body is J_linear + J_angular x p for the columns in the body's support.
- `poses[j]` is joint j's placement in the world: rotation (column-major, 9) and translation (3).
- A contact's own axes are (t1, t2, n): n = (n_x, 0, n_z) out of the ground, t1 = (n_z, 0, -n_x) uphill, t2 = y.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

# Columns of the contact table that `find_contacts` fills.
CONTACT_X, CONTACT_Y, CONTACT_Z, NORMAL_X, NORMAL_Z, GAP, FRICTION_SCALE = range(7)
CONTACT_COLUMNS = 7

# Entries of the packed ground law.
STIFFNESS, DAMPING, TRANSITION_WIDTH, FRICTION_STATIC, FRICTION_DYNAMIC, STICTION_SPEED, STRIBECK_SPEED, VISCOUS = (
    range(8)
)
GROUND_ENTRIES = 8

# Columns of the wheel statistics that a step accumulates: peaks, sums, impulse of the ground [N s], and the joint angle
# without wrapping [rad], which is what an encoder counts.
SLIP_SPEED_MAX, SLIP_DISTANCE, SLIP_TIME, AIR_TIME, FRICTION_USE_MAX, NORMAL_FORCE_MIN = range(6)
IMPULSE_X, IMPULSE_Y, IMPULSE_Z, JOINT_ANGLE = range(6, 10)
STATISTICS_COLUMNS = 10

#: A wheel slides when its contact point moves faster than this [m/s].
SLIP_THRESHOLD = 5.0e-3
#: A contact deeper than this is another segment's back side, not a contact [m].
DEPTH_LIMIT = 0.06
#: An implicit step looks ahead: a contact whose gap will be below this at the end takes part [m],
CONTACT_MARGIN = 2.0e-3
#: if it does not approach faster than this [m/s].
APPROACH_SPEED_LIMIT = 20.0
#: Newton stops when no contact velocity moves by more than this part of the stiction speed.
NEWTON_TOLERANCE = 1.0e-3
NEWTON_CAP = 60
#: Largest change of the sliding direction in one Newton step (Drake's TAMSI: pi/3).
COSINE_OF_LARGEST_TURN = 0.5


@njit(cache=True)
def friction_coefficient(speed: float, ground: Any, scale: float) -> tuple[float, float]:
    """Stribeck friction coefficient and its derivative with respect to the sliding speed.

    Up to the stiction speed e it rises as x (2 - x), x = v / e, and peaks there at exactly mu_s; beyond it falls to
    mu_d over the Stribeck speed and grows with the viscous term. It is continuously differentiable without that term.
    """
    static = scale * ground[FRICTION_STATIC]
    dynamic = scale * ground[FRICTION_DYNAMIC]
    stiction_speed = ground[STICTION_SPEED]
    if speed < stiction_speed:
        x = speed / stiction_speed
        return static * x * (2.0 - x), static * 2.0 * (1.0 - x) / stiction_speed
    beyond = speed - stiction_speed
    ratio = beyond / ground[STRIBECK_SPEED]
    decay = (static - dynamic) * math.exp(-ratio * ratio)
    coefficient = dynamic + decay + scale * ground[VISCOUS] * beyond
    return coefficient, -2.0 * ratio / ground[STRIBECK_SPEED] * decay + scale * ground[VISCOUS]


@njit(cache=True)
def normal_force(depth: float, depth_rate: float, ground: Any) -> tuple[float, float, float]:
    """Compliant normal force s(d, w) (k d + c d'), never pulling, and its derivatives in d and d'."""
    if depth <= 0.0:
        return 0.0, 0.0, 0.0
    spring = ground[STIFFNESS] * depth + ground[DAMPING] * depth_rate
    if spring <= 0.0:
        return 0.0, 0.0, 0.0
    width = ground[TRANSITION_WIDTH]
    if depth >= width:
        return spring, ground[STIFFNESS], ground[DAMPING]
    x = depth / width
    smooth = x * x * (3.0 - 2.0 * x)
    smooth_slope = 6.0 * x * (1.0 - x) / width
    return smooth * spring, smooth_slope * spring + smooth * ground[STIFFNESS], smooth * ground[DAMPING]


@njit(cache=True)
def _add_contact(
    contacts: Any,
    joints: Any,
    owners: Any,
    count: int,
    joint: int,
    owner: int,
    x: float,
    y: float,
    z: float,
    nx: float,
    nz: float,
    gap: float,
    scale: float,
) -> int:
    contacts[count, CONTACT_X] = x
    contacts[count, CONTACT_Y] = y
    contacts[count, CONTACT_Z] = z
    contacts[count, NORMAL_X] = nx
    contacts[count, NORMAL_Z] = nz
    contacts[count, GAP] = gap
    contacts[count, FRICTION_SCALE] = scale
    joints[count] = joint
    owners[count] = owner
    return count + 1


@njit(cache=True)
def _turn_to_world(pose: Any, vector: Any) -> tuple[float, float, float]:
    a, b, c = vector[0], vector[1], vector[2]
    return (
        pose[0] * a + pose[3] * b + pose[6] * c,
        pose[1] * a + pose[4] * b + pose[7] * c,
        pose[2] * a + pose[5] * b + pose[8] * c,
    )


@njit(cache=True)
def find_contacts(
    poses: Any,
    wheel_joints: Any,
    wheel_axes: Any,
    wheel_radii: Any,
    point_joints: Any,
    point_positions: Any,
    segments: Any,
    margin: float,
    contacts: Any,
    joints: Any,
    owners: Any,
) -> int:
    """Every contact nearer than a margin: wheel rims against segments and convex corners, points against segments.

    A wheel is a thin disc. On a segment it touches with the rim's deepest point along the normal, if that point lies
    within the segment; at a convex corner, beyond both segments, it touches with the rim's point nearest to the corner
    line, whose normal turns continuously from one segment's to the other's. A point touches the nearest segment or
    corner.

    Args:
        poses: Joint placements in the world, shape (njoints, 12).
        wheel_joints, wheel_axes, wheel_radii: Joint index, axis in the joint frame, rim radius [m] of each wheel.
        point_joints, point_positions: Joint index and position in the joint frame [m] of each contact point.
        segments: Terrain segments, shape (n, 9), see `terrain.SEGMENT_COLUMNS`.
        margin: Contacts with a gap below this are listed [m].
        contacts, joints, owners: Filled: contact table, joint index, owner (wheel index, then point index).

    Returns:
        The number of contacts, at most one for each wheel or point and segment.
    """
    count = 0
    n_segments = segments.shape[0]
    n_wheels = wheel_joints.shape[0]
    for wheel in range(n_wheels):
        pose = poses[wheel_joints[wheel]]
        axis_x, axis_y, axis_z = _turn_to_world(pose, wheel_axes[wheel])
        px, py, pz = pose[9], pose[10], pose[11]
        radius = wheel_radii[wheel]
        past_previous = False
        side = 8 if py > 0.0 else 7
        for k in range(n_segments):
            ax, az, tx, tz = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
            nx, nz, length, scale = segments[k, 4], segments[k, 5], segments[k, 6], segments[k, side]
            centre_height = (px - ax) * nx + (pz - az) * nz
            # w: the normal projected into the wheel's plane; the rim is deepest against it.
            along_axis = axis_x * nx + axis_z * nz
            wx, wy, wz = nx - along_axis * axis_x, -along_axis * axis_y, nz - along_axis * axis_z
            size = math.sqrt(wx * wx + wy * wy + wz * wz)
            reach = radius / size if size > 1e-9 else 0.0
            # The point of the wheel's plane on the segment's plane below the centre decides whose contact it is: in the
            # wheel's plane the ground is a polyline too. A wheel lying flat has none; its rim must do.
            foot = min(centre_height / (size * size), 2.0 * reach) if size > 1e-9 else 0.0
            s = (px - foot * wx - ax) * tx + (pz - foot * wz - az) * tz
            before_start = k > 0 and s < 0.0
            if past_previous and before_start and abs(axis_y) > 1e-6:
                # Between two segments: the corner line through (ax, az) meets the wheel's plane at `corner_y`.
                corner_y = py + ((px - ax) * axis_x + (pz - az) * axis_z) / axis_y
                rx, ry, rz = px - ax, py - corner_y, pz - az
                distance = math.sqrt(rx * rx + ry * ry + rz * rz)
                if distance > 1e-9:
                    # Rim tangent = axis x radial; the normal is perpendicular to it and to the corner line (y).
                    vx = axis_y * rz - axis_z * ry
                    vz = axis_x * ry - axis_y * rx
                    norm = math.sqrt(vx * vx + vz * vz)
                    if norm > 1e-9 * distance:
                        cx, cz = -vz / norm, vx / norm
                    else:  # the rim runs along the corner line, any normal between the segments' does
                        cx, cz = nx, nz
                    if cx * rx + cz * rz < 0.0:
                        cx, cz = -cx, -cz
                    gap = (distance - radius) * (cx * rx + cz * rz) / distance
                    if -DEPTH_LIMIT < gap < margin:
                        part = radius / distance
                        count = _add_contact(
                            contacts, joints, owners, count, wheel_joints[wheel], wheel, px - part * rx, py - part * ry,
                            pz - part * rz, cx, cz, gap, min(scale, segments[k - 1, side]),
                        )  # fmt: skip
            past_previous = k < n_segments - 1 and s > length
            if not before_start and not past_previous:
                gap = centre_height - reach * size * size
                if -DEPTH_LIMIT < gap < margin:
                    count = _add_contact(
                        contacts, joints, owners, count, wheel_joints[wheel], wheel, px - reach * wx, py - reach * wy,
                        pz - reach * wz, nx, nz, gap, scale,
                    )  # fmt: skip
    for point in range(point_joints.shape[0]):
        pose = poses[point_joints[point]]
        px, py, pz = _turn_to_world(pose, point_positions[point])
        px, py, pz = px + pose[9], py + pose[10], pz + pose[11]
        previous_gap = math.inf
        past_previous = False
        side = 8 if py > 0.0 else 7
        for k in range(n_segments):
            dx, dz = px - segments[k, 0], pz - segments[k, 1]
            nx, nz, scale = segments[k, 4], segments[k, 5], segments[k, side]
            s = dx * segments[k, 2] + dz * segments[k, 3]
            gap = dx * nx + dz * nz
            before_start = k > 0 and s < 0.0
            if past_previous and before_start:
                # Between two segments the corner is nearest: outside a convex one, or pressed into a concave one.
                distance = math.sqrt(dx * dx + dz * dz)
                sign = 1.0 if gap > 0.0 else -1.0
                if distance > 1e-12 and -DEPTH_LIMIT < sign * distance < margin:
                    count = _add_contact(
                        contacts, joints, owners, count, point_joints[point], n_wheels + point, px, py, pz,
                        sign * dx / distance, sign * dz / distance, sign * distance, min(scale, segments[k - 1, side]),
                    )  # fmt: skip
            # Below a convex corner, where both segments claim the point, the nearer face pushes it out.
            claimed_before = k > 0 and not past_previous and previous_gap < 0.0 and previous_gap >= gap
            past_previous = k < n_segments - 1 and s >= segments[k, 6]
            previous_gap = gap
            if before_start or past_previous or claimed_before or not -DEPTH_LIMIT < gap < margin:
                continue
            if gap < 0.0 and k < n_segments - 1:
                next_dx, next_dz = px - segments[k + 1, 0], pz - segments[k + 1, 1]
                next_gap = next_dx * segments[k + 1, 4] + next_dz * segments[k + 1, 5]
                next_s = next_dx * segments[k + 1, 2] + next_dz * segments[k + 1, 3]
                if next_s >= 0.0 and gap < next_gap < 0.0:
                    continue
            count = _add_contact(
                contacts, joints, owners, count, point_joints[point], n_wheels + point, px, py, pz, nx, nz, gap, scale
            )
    return count


@njit(cache=True)
def contact_jacobian(jacobians: Any, support: Any, contact: Any, joint: int, out: Any) -> None:
    """Rows (t1, t2, n) of one contact's Jacobian: velocity of the body's material point at the contact.

    Args:
        jacobians: Pinocchio's data.J, shape (6, nv).
        support: support[joint, c] is 1 where velocity c moves the joint, shape (njoints, nv).
        contact: One row of the contact table.
        joint: The joint that carries the contact.
        out: Filled, shape (3, nv).
    """
    x, y, z = contact[CONTACT_X], contact[CONTACT_Y], contact[CONTACT_Z]
    nx, nz = contact[NORMAL_X], contact[NORMAL_Z]
    for c in range(jacobians.shape[1]):
        if support[joint, c]:
            vx = jacobians[0, c] + jacobians[4, c] * z - jacobians[5, c] * y
            vy = jacobians[1, c] + jacobians[5, c] * x - jacobians[3, c] * z
            vz = jacobians[2, c] + jacobians[3, c] * y - jacobians[4, c] * x
            out[0, c] = nz * vx - nx * vz
            out[1, c] = vy
            out[2, c] = nx * vx + nz * vz
        else:
            out[0, c] = 0.0
            out[1, c] = 0.0
            out[2, c] = 0.0


@njit(cache=True)
def contact_law(v1: float, v2: float, vn: float, gap: float, scale: float, ground: Any, dt: float, force: Any,
                gradient: Any) -> None:  # fmt: skip
    """Force of the ground in a contact's axes, and its gradient, as functions of the contact velocity.

    With dt > 0 the depth is the one at the end of the step, d - dt v_n (implicit); with dt = 0 it is the present one.

    Args:
        v1, v2, vn: Contact velocity along t1, t2, n [m/s].
        gap: Present distance, negative when in contact [m].
        scale: Friction scale of the ground here.
        ground: Packed ground law.
        dt: Time step [s], or 0.
        force: Filled, shape (3,) [N].
        gradient: Filled, d force / d velocity, shape (3, 3) [N s/m].
    """
    fn, fn_depth, fn_rate = normal_force(-gap - dt * vn, -vn, ground)
    fn_slope = -dt * fn_depth - fn_rate
    speed = math.sqrt(v1 * v1 + v2 * v2)
    mu, mu_slope = friction_coefficient(speed, ground, scale)
    force[2] = fn
    gradient[2, 0] = 0.0
    gradient[2, 1] = 0.0
    gradient[2, 2] = fn_slope
    if speed > 1e-12 * ground[STICTION_SPEED]:
        d1, d2 = v1 / speed, v2 / speed
        mu_over_speed = mu / speed
    else:
        d1, d2 = 0.0, 0.0
        mu_over_speed = mu_slope
    force[0] = -mu * fn * d1
    force[1] = -mu * fn * d2
    excess = mu_slope - mu_over_speed
    gradient[0, 0] = -fn * (mu_over_speed + excess * d1 * d1)
    gradient[0, 1] = -fn * excess * d1 * d2
    gradient[1, 0] = gradient[0, 1]
    gradient[1, 1] = -fn * (mu_over_speed + excess * d2 * d2)
    gradient[0, 2] = -mu * d1 * fn_slope
    gradient[1, 2] = -mu * d2 * fn_slope


@njit(cache=True)
def _add_wrench(jacobians: Any, support: Any, joint: int, fx: float, fy: float, fz: float, mx: float, my: float,
                mz: float, out: Any) -> None:  # fmt: skip
    """Add the generalised force of a force and a moment about the world's origin, both in world axes, on a joint."""
    for c in range(jacobians.shape[1]):
        if support[joint, c]:
            out[c] += (
                jacobians[0, c] * fx + jacobians[1, c] * fy + jacobians[2, c] * fz
                + jacobians[3, c] * mx + jacobians[4, c] * my + jacobians[5, c] * mz
            )  # fmt: skip


@njit(cache=True)
def _add_base_wrench(poses: Any, jacobians: Any, support: Any, wrench: Any, out: Any) -> None:
    """Add the generalised force of a wrench on the base about its origin, world axes, shape (6,)."""
    fx, fy, fz = wrench[0], wrench[1], wrench[2]
    x, y, z = poses[1, 9], poses[1, 10], poses[1, 11]
    mx, my, mz = wrench[3] + y * fz - z * fy, wrench[4] + z * fx - x * fz, wrench[5] + x * fy - y * fx
    _add_wrench(jacobians, support, 1, fx, fy, fz, mx, my, mz, out)


@njit(cache=True)
def thrust_force(poses: Any, jacobians: Any, support: Any, thruster_joints: Any, thruster_positions: Any,
                 thruster_directions: Any, moment_ratios: Any, thrust: Any, out: Any) -> None:  # fmt: skip
    """Add the generalised force of the thrusters, J_t(q)^T (d f_t), to `out` (nv,)."""
    for i in range(thruster_joints.shape[0]):
        f = thrust[i]
        if f == 0.0:
            continue
        joint = thruster_joints[i]
        pose = poses[joint]
        x, y, z = _turn_to_world(pose, thruster_positions[i])
        x, y, z = x + pose[9], y + pose[10], z + pose[11]
        dx, dy, dz = _turn_to_world(pose, thruster_directions[i])
        fx, fy, fz = f * dx, f * dy, f * dz
        # Moment about the world's origin, propeller reaction included.
        ratio = moment_ratios[i]
        mx = y * fz - z * fy + ratio * fx
        my = z * fx - x * fz + ratio * fy
        mz = x * fy - y * fx + ratio * fz
        _add_wrench(jacobians, support, joint, fx, fy, fz, mx, my, mz, out)


@njit(cache=True)
def ground_force(jacobians: Any, support: Any, contacts: Any, joints: Any, count: int, velocity: Any, ground: Any,
                 forces: Any, out: Any) -> None:  # fmt: skip
    """Explicit ground forces from the present state: adds J_c^T f_c to `out` (nv,), and fills `forces` (n, 3)."""
    nv = velocity.shape[0]
    rows = np.empty((3, nv))
    gradient = np.empty((3, 3))
    contact_velocity = np.empty(3)
    for i in range(count):
        contact_jacobian(jacobians, support, contacts[i], joints[i], rows)
        for k in range(3):
            total = 0.0
            for c in range(nv):
                total += rows[k, c] * velocity[c]
            contact_velocity[k] = total
        contact_law(contact_velocity[0], contact_velocity[1], contact_velocity[2], contacts[i, GAP],
                    contacts[i, FRICTION_SCALE], ground, 0.0, forces[i], gradient)  # fmt: skip
        for c in range(nv):
            out[c] += rows[0, c] * forces[i, 0] + rows[1, c] * forces[i, 1] + rows[2, c] * forces[i, 2]


@njit(cache=True)
def _factorise(a: Any, parents: Any, reciprocals: Any) -> bool:
    """Factor a = L^T L in place, for a matrix with the sparsity of a kinematic tree (Featherstone, 2008, section 6.5).

    Row i of L has entries at i and at the velocities that carry it, so nothing fills in; only those entries of the
    lower triangle are read and written. `reciprocals` takes 1 / L_ii.
    """
    for k in range(a.shape[0] - 1, -1, -1):
        if not a[k, k] > 0.0:
            return False
        reciprocal = 1.0 / math.sqrt(a[k, k])
        reciprocals[k] = reciprocal
        i = parents[k]
        while i >= 0:
            a[k, i] *= reciprocal
            i = parents[i]
        i = parents[k]
        while i >= 0:
            part = a[k, i]
            j = i
            while j >= 0:
                a[i, j] -= part * a[k, j]
                j = parents[j]
            i = parents[i]
    return True


@njit(cache=True)
def _solve_transposed(factor: Any, parents: Any, reciprocals: Any, x: Any) -> None:
    """x := L^-T x."""
    for i in range(x.shape[0] - 1, -1, -1):
        value = x[i] * reciprocals[i]
        x[i] = value
        j = parents[i]
        while j >= 0:
            x[j] -= factor[i, j] * value
            j = parents[j]


@njit(cache=True)
def _solve(factor: Any, parents: Any, reciprocals: Any, x: Any) -> None:
    """x := L^-1 x."""
    for i in range(x.shape[0]):
        total = x[i]
        j = parents[i]
        while j >= 0:
            total -= factor[i, j] * x[j]
            j = parents[j]
        x[i] = total * reciprocals[i]


@njit(cache=True)
def _solve_contact_rows(factor: Any, parents: Any, reciprocals: Any, tip: int, rows: Any, out: Any) -> None:
    """Three rows of J L^-1 for a contact on a joint whose last velocity is `tip`; other columns stay as they are."""
    i = tip
    while i >= 0:
        for r in range(3):
            out[r, i] = rows[r, i]
        i = parents[i]
    i = tip
    while i >= 0:
        x, y, z = out[0, i] * reciprocals[i], out[1, i] * reciprocals[i], out[2, i] * reciprocals[i]
        out[0, i], out[1, i], out[2, i] = x, y, z
        j = parents[i]
        while j >= 0:
            entry = factor[i, j]
            out[0, j] -= entry * x
            out[1, j] -= entry * y
            out[2, j] -= entry * z
            j = parents[j]
        i = parents[i]


@njit(cache=True)
def _delassus_block(scaled: Any, parents: Any, tip: int, first: int, second: int, out: Any) -> None:
    """Block (first, second) of W = (J L^-1) (J L^-1)^T and its mirror; nothing is beyond the chain of `tip`."""
    a, b = scaled[first : first + 3], scaled[second : second + 3]
    w00 = w01 = w02 = w10 = w11 = w12 = w20 = w21 = w22 = 0.0
    c = tip
    while c >= 0:
        a0, a1, a2, b0, b1, b2 = a[0, c], a[1, c], a[2, c], b[0, c], b[1, c], b[2, c]
        w00 += a0 * b0
        w01 += a0 * b1
        w02 += a0 * b2
        w10 += a1 * b0
        w11 += a1 * b1
        w12 += a1 * b2
        w20 += a2 * b0
        w21 += a2 * b1
        w22 += a2 * b2
        c = parents[c]
    block = ((w00, w01, w02), (w10, w11, w12), (w20, w21, w22))
    for i in range(3):
        for j in range(3):
            out[first + i, second + j] = block[i][j]
            out[second + j, first + i] = block[i][j]


@njit(cache=True)
def _solve_dense(a: Any, b: Any, n: int) -> bool:
    """Solve a x = b in place by Gaussian elimination with partial pivoting (n is small: three rows a contact)."""
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            if abs(a[i, j]) > abs(a[pivot, j]):
                pivot = i
        if a[pivot, j] == 0.0:
            return False
        if pivot != j:
            for k in range(j, n):
                a[j, k], a[pivot, k] = a[pivot, k], a[j, k]
            b[j], b[pivot] = b[pivot], b[j]
        for i in range(j + 1, n):
            part = a[i, j] / a[j, j]
            if part != 0.0:
                for k in range(j + 1, n):
                    a[i, k] -= part * a[j, k]
                b[i] -= part * b[j]
    for i in range(n - 1, -1, -1):
        total = b[i]
        for k in range(i + 1, n):
            total -= a[i, k] * b[k]
        b[i] = total / a[i, i]
    return True


@njit(cache=True)
def newton_step_length(v1: float, v2: float, d1: float, d2: float, stiction_speed: float) -> float:
    """Largest part of a Newton step of the sliding velocity that neither jumps over stiction nor turns too far.

    Friction changes its direction within the stiction speed; a step that passes through that region must stop in it,
    and a step outside must not turn the sliding direction by more than a fixed angle (the limiter of Drake's TAMSI:
    Castro et al., A transition-aware method for the simulation of compliant contact with regularized friction, 2020).

    Args:
        v1, v2: Present sliding velocity [m/s].
        d1, d2: Its Newton step [m/s].
        stiction_speed: Speed at which friction peaks [m/s].

    Returns:
        The part in (0, 1].
    """
    tiny = 1e-6 * stiction_speed
    step = math.sqrt(d1 * d1 + d2 * d2)
    if step < tiny:
        return 1.0
    speed = math.sqrt(v1 * v1 + v2 * v2)
    w1, w2 = v1 + d1, v2 + d2
    new_speed = math.sqrt(w1 * w1 + w2 * w2)
    if speed < tiny:
        # From rest: stop halfway up the stiction region, where the slope of friction is known.
        return 1.0 if new_speed < stiction_speed else 0.5 * stiction_speed / step
    if new_speed < tiny:
        return 1.0 if speed < stiction_speed else 1.0 - 0.5 * stiction_speed / speed
    if speed < stiction_speed and new_speed < stiction_speed:
        return 1.0
    along = v1 * d1 + v2 * d2
    if along < 0.0:
        nearest = -along / (step * step)
        if nearest < 1.0:
            n1, n2 = v1 + nearest * d1, v2 + nearest * d2
            if n1 * n1 + n2 * n2 < stiction_speed * stiction_speed and speed >= stiction_speed:
                return nearest
    if speed < stiction_speed:
        # Leaving stiction: stop at its edge, at the peak of friction, before sliding.
        b = along
        c = speed * speed - stiction_speed * stiction_speed
        part = (-b + math.sqrt(b * b - step * step * c)) / (step * step)
        return min(1.0, max(part, 0.1))
    cosine = (v1 * w1 + v2 * w2) / (speed * new_speed)
    if cosine >= COSINE_OF_LARGEST_TURN:
        return 1.0
    # The part at which the direction has turned by the largest angle: |cross| = tan(angle) dot.
    cross = abs(v1 * d2 - v2 * d1)
    tangent = math.sqrt(1.0 - COSINE_OF_LARGEST_TURN**2) / COSINE_OF_LARGEST_TURN
    denominator = cross - tangent * along
    if denominator <= 0.0:
        return 1.0
    return min(1.0, tangent * speed * speed / denominator)


@njit(cache=True)
def newton_step_length_normal(depth: float, new_depth: float, width: float) -> float:
    """Largest part of a Newton step of the depth that does not jump over the steep part of the normal force.

    The force rises from nothing to the whole spring and damper within the transition width. A step over it sees the
    slope of the wrong side and the next one jumps back, for ever at a hard landing; stopped in the middle, where the
    law is steepest, Newton finds the force between.

    Args:
        depth, new_depth: Depth at the end of the time step, before and after the Newton step [m].
        width: Transition width of the normal force [m].

    Returns:
        The part in (0, 1].
    """
    if (depth > 0.6 * width and new_depth <= 0.0) or (depth < 0.4 * width and new_depth >= width):
        return (0.5 * width - depth) / (new_depth - depth)
    return 1.0


@njit(cache=True)
def _drop_weakening(v1: float, v2: float, fn: float, scale: float, ground: Any, gradient: Any) -> None:
    """Take the slope of the friction coefficient out of a contact's gradient where it is negative."""
    speed = math.sqrt(v1 * v1 + v2 * v2)
    _, slope = friction_coefficient(speed, ground, scale)
    if slope < 0.0:
        d1, d2 = v1 / speed, v2 / speed
        gradient[0, 0] += fn * slope * d1 * d1
        gradient[0, 1] += fn * slope * d1 * d2
        gradient[1, 0] += fn * slope * d1 * d2
        gradient[1, 1] += fn * slope * d2 * d2


@njit(cache=True)
def solve_contacts(delassus: Any, free: Any, contacts: Any, count: int, ground: Any, dt: float, ascending: bool,
                   velocity: Any, force: Any) -> int:  # fmt: skip
    """Newton on the contact velocities: v = v_free + dt W f(v).

    Args:
        delassus: W = J M^-1 J^T, shape (3 n, 3 n).
        free: Contact velocities without ground forces, shape (3 n,) [m/s].
        contacts: Contact table.
        count: Number of contacts n.
        ground: Packed ground law.
        dt: Time step [s].
        ascending: Leave out the slope of friction that weakens with the speed. Newton's steps then point the right way
            between sticking and sliding, but they converge more slowly.
        velocity: In: first guess; out: contact velocities, shape (3 n,).
        force: Filled, shape (3 n,) [N].

    Returns:
        The number of iterations, or -1 if Newton did not converge; then the forces are those of the iterate that came
        nearest, and the velocities those that they lead to.
    """
    n = 3 * count
    a = np.empty((n, n))
    b = np.empty(n)
    gradients = np.empty((count, 3, 3))
    best_force = np.zeros(n)
    least_residual = math.inf
    tolerance = NEWTON_TOLERANCE * ground[STICTION_SPEED]
    for iteration in range(1, NEWTON_CAP + 1):
        for i in range(count):
            k = 3 * i
            contact_law(velocity[k], velocity[k + 1], velocity[k + 2], contacts[i, GAP], contacts[i, FRICTION_SCALE],
                        ground, dt, force[k : k + 3], gradients[i])  # fmt: skip
            if ascending:
                _drop_weakening(velocity[k], velocity[k + 1], force[k + 2], contacts[i, FRICTION_SCALE], ground,
                                gradients[i])  # fmt: skip
        residual = 0.0
        for row in range(n):
            total = free[row] - velocity[row]
            for column in range(n):
                total += dt * delassus[row, column] * force[column]
            b[row] = total
            residual += abs(total)
            for j in range(count):
                w0, w1, w2 = delassus[row, 3 * j], delassus[row, 3 * j + 1], delassus[row, 3 * j + 2]
                for c in range(3):
                    a[row, 3 * j + c] = -dt * (
                        w0 * gradients[j, 0, c] + w1 * gradients[j, 1, c] + w2 * gradients[j, 2, c]
                    )
            a[row, row] += 1.0
        if residual < least_residual:
            least_residual = residual
            best_force[:] = force
        if not (math.isfinite(residual) and _solve_dense(a, b, n)):
            break
        part = 1.0
        largest = 0.0
        for i in range(count):
            k = 3 * i
            limited = newton_step_length(velocity[k], velocity[k + 1], b[k], b[k + 1], ground[STICTION_SPEED])
            depth = -contacts[i, GAP] - dt * velocity[k + 2]
            limited_normal = newton_step_length_normal(depth, depth - dt * b[k + 2], ground[TRANSITION_WIDTH])
            part = min(part, limited, limited_normal)
            largest = max(largest, abs(b[k]), abs(b[k + 1]), abs(b[k + 2]))
        for row in range(n):
            velocity[row] += part * b[row]
        if part == 1.0 and largest < tolerance:
            for i in range(count):
                k = 3 * i
                contact_law(velocity[k], velocity[k + 1], velocity[k + 2], contacts[i, GAP],
                            contacts[i, FRICTION_SCALE], ground, dt, force[k : k + 3], gradients[i])  # fmt: skip
            return iteration
    for row in range(n):
        force[row] = best_force[row]
        velocity[row] = free[row]
        for column in range(n):
            velocity[row] += dt * delassus[row, column] * best_force[column]
    return -1


@njit(cache=True)
def implicit_step(
    mass: Any, bias: Any, jacobians: Any, poses: Any, configuration: Any, velocity: Any, support: Any, parents: Any,
    tips: Any, wheel_joints: Any, wheel_axes: Any, wheel_radii: Any, wheel_velocity_indices: Any, wheel_motor: Any,
    point_joints: Any, point_positions: Any,
    thruster_joints: Any, thruster_positions: Any, thruster_directions: Any, moment_ratios: Any,
    servo_indices: Any, servo_gains: Any, segments: Any, ground: Any,
    servo_targets: Any, wheel_duty: Any, wheel_brake: Any, thrust: Any, external: Any, dt: float,
    displacement: Any, servo_torque: Any, wheel_force: Any, wheel_contact: Any, point_force: Any, statistics: Any,
    counters: Any,
) -> None:  # fmt: skip
    """One step, implicit in contact forces, servo gains and back-EMF: Delassus operator, Newton with a step limiter.

    (M + dt K_d + dt^2 K_p) v+ = M v + dt (tau - h) + dt J_c^T f_c(v+), and q+ = q (+) dt v+.

    Args:
        mass, bias, jacobians, poses: M (upper triangle), h, data.J and joint placements at (q, v).
        configuration, velocity: q (nq,) and v (nv,); v is overwritten with v+.
        support, parents, tips, and the arrays of wheels, points, thrusters, servos, segments, ground: see
            `full/model.py`.
        wheel_motor: Stall torque and back-EMF constant of each wheel, shape (wheels, 2) [N m, N m s].
        servo_indices: (index_q, index_v) of each servo. servo_gains: stiffness, damping, effort limit.
        servo_targets: Joint angles [rad]. wheel_duty: in [-1, 1]. wheel_brake: viscous brake [N m s/rad].
        thrust: [N]. external: wrench on the base about its origin, world axes, force then moment, shape (6,).
        dt: Time step [s].
        displacement: Filled, dt v+ (nv,), to integrate the configuration.
        servo_torque, wheel_force, wheel_contact, point_force: Filled: torques, force of the ground on each wheel in the
            world, its point of application, force on each contact point in the world.
        statistics: Accumulated for each wheel, see the column names.
        counters: Accumulated: steps, Newton iterations, Newton failures, servo saturations.
    """
    nv = velocity.shape[0]
    n_wheels = wheel_joints.shape[0]
    n_servos = servo_indices.shape[0]
    capacity = (n_wheels + point_joints.shape[0]) * segments.shape[0]
    contacts = np.empty((capacity, CONTACT_COLUMNS))
    joints = np.empty(capacity, np.int64)
    owners = np.empty(capacity, np.int64)
    found = find_contacts(poses, wheel_joints, wheel_axes, wheel_radii, point_joints, point_positions, segments,
                          CONTACT_MARGIN + dt * APPROACH_SPEED_LIMIT, contacts, joints, owners)  # fmt: skip
    # Of the contacts nearby, only those take part that come within the margin by the end of the step.
    rows = np.empty((3 * found, nv))
    count = 0
    for i in range(found):
        row = 3 * count
        contact_jacobian(jacobians, support, contacts[i], joints[i], rows[row : row + 3])
        approach = 0.0
        for c in range(nv):
            approach += rows[row + 2, c] * velocity[c]
        if contacts[i, GAP] + dt * min(approach, 0.0) < CONTACT_MARGIN:
            contacts[count] = contacts[i]
            joints[count] = joints[i]
            owners[count] = owners[i]
            count += 1

    # Forces that do not depend on the new velocity: bias, thrust, external wrench, motor stall torque.
    applied = np.empty(nv)
    for i in range(nv):
        applied[i] = -bias[i]
    thrust_force(poses, jacobians, support, thruster_joints, thruster_positions, thruster_directions, moment_ratios,
                 thrust, applied)  # fmt: skip
    _add_base_wrench(poses, jacobians, support, external, applied)
    for i in range(n_wheels):
        applied[wheel_velocity_indices[i]] += wheel_motor[i, 0] * wheel_duty[i]

    factor = np.empty((nv, nv))
    reciprocals = np.empty(nv)
    new_velocity = np.empty(nv)
    scaled = np.zeros((3 * count, nv))
    delassus = np.empty((3 * count, 3 * count))
    free = np.empty(3 * count)
    contact_velocity = np.empty(3 * count)
    force = np.empty(3 * count)
    saturated = np.zeros(n_servos)
    for _ in range(n_servos + 1):
        # Servos at their torque limit push with it; the others are springs and dampers, implicit.
        for i in range(nv):
            factor[i, i] = mass[i, i]
            total = mass[i, i] * velocity[i]
            j = parents[i]
            while j >= 0:
                factor[i, j] = mass[j, i]
                total += mass[j, i] * velocity[j]
                new_velocity[j] += mass[j, i] * velocity[i]
                j = parents[j]
            new_velocity[i] = total + dt * applied[i]
        for i in range(n_servos):
            index = servo_indices[i, 1]
            if saturated[i] == 0.0:
                factor[index, index] += dt * servo_gains[i, 1] + dt * dt * servo_gains[i, 0]
                error = servo_targets[i] - configuration[servo_indices[i, 0]]
                new_velocity[index] += dt * servo_gains[i, 0] * error
            else:
                new_velocity[index] += dt * saturated[i]
        for i in range(n_wheels):
            index = wheel_velocity_indices[i]
            factor[index, index] += dt * (wheel_motor[i, 1] + wheel_brake[i])
        if not _factorise(factor, parents, reciprocals):
            # M is not positive definite: no inertia is like that, or the state is lost already.
            counters[2] += 1
            velocity[:] = math.nan
            displacement[:] = math.nan
            return
        # With M = L^T L: y = L^-T rhs, Y = J L^-1 (rows of `scaled`), W = Y Y^T, free velocities J M^-1 rhs = Y y.
        _solve_transposed(factor, parents, reciprocals, new_velocity)
        for i in range(count):
            tip = tips[joints[i]]
            _solve_contact_rows(factor, parents, reciprocals, tip, rows[3 * i : 3 * i + 3], scaled[3 * i : 3 * i + 3])
            for r in range(3 * i, 3 * i + 3):
                total = 0.0
                start = 0.0
                c = tip
                while c >= 0:
                    total += scaled[r, c] * new_velocity[c]
                    start += rows[r, c] * velocity[c]
                    c = parents[c]
                free[r] = total
                contact_velocity[r] = start
            for j in range(i + 1):
                _delassus_block(scaled, parents, tip, 3 * i, 3 * j, delassus)
        iterations = 0
        if count > 0:
            iterations = solve_contacts(delassus, free, contacts, count, ground, dt, False, contact_velocity, force)
            if iterations < 0:
                # Between sticking and sliding, friction that weakens with the speed misleads Newton. A second try first
                # lets it keep its peak, from the free velocities, and goes on from there without that slope.
                for r in range(3 * count):
                    contact_velocity[r] = free[r]
                lasting = ground.copy()
                lasting[FRICTION_DYNAMIC] = ground[FRICTION_STATIC]
                solve_contacts(delassus, free, contacts, count, lasting, dt, True, contact_velocity, force)
                iterations = solve_contacts(delassus, free, contacts, count, ground, dt, True, contact_velocity, force)
            for r in range(3 * count):
                impulse = dt * force[r]
                for c in range(nv):
                    new_velocity[c] += scaled[r, c] * impulse
        _solve(factor, parents, reciprocals, new_velocity)
        changed = False
        for i in range(n_servos):
            if saturated[i] != 0.0:
                continue
            rate = new_velocity[servo_indices[i, 1]]
            error = servo_targets[i] - configuration[servo_indices[i, 0]] - dt * rate
            torque = servo_gains[i, 0] * error - servo_gains[i, 1] * rate
            limit = servo_gains[i, 2]
            if abs(torque) > limit:
                saturated[i] = math.copysign(limit, torque)
                counters[3] += 1
                changed = True
            servo_torque[i] = saturated[i] if saturated[i] != 0.0 else torque
        if not changed:
            break
    counters[0] += 1
    if iterations < 0:
        counters[2] += 1
    else:
        counters[1] += iterations
    for c in range(nv):
        velocity[c] = new_velocity[c]
        displacement[c] = dt * new_velocity[c]
    for i in range(n_wheels):
        statistics[i, JOINT_ANGLE] += displacement[wheel_velocity_indices[i]]
    _record_forces(contacts, owners, count, contact_velocity, force, ground, dt, n_wheels, wheel_force, wheel_contact,
                   point_force, statistics)  # fmt: skip


@njit(cache=True)
def _record_forces(contacts: Any, owners: Any, count: int, contact_velocity: Any, force: Any, ground: Any, dt: float,
                   n_wheels: int, wheel_force: Any, wheel_contact: Any, point_force: Any,
                   statistics: Any) -> None:  # fmt: skip
    """Sum the contact forces of each wheel and point in world axes, and keep the wheels' statistics."""
    wheel_force[:, :] = 0.0
    point_force[:, :] = 0.0
    largest = np.zeros(n_wheels)
    for i in range(count):
        f1, f2, fn = force[3 * i], force[3 * i + 1], force[3 * i + 2]
        nx, nz = contacts[i, NORMAL_X], contacts[i, NORMAL_Z]
        wx, wy, wz = nz * f1 + nx * fn, f2, -nx * f1 + nz * fn
        owner = owners[i]
        if owner >= n_wheels:
            point_force[owner - n_wheels, 0] += wx
            point_force[owner - n_wheels, 1] += wy
            point_force[owner - n_wheels, 2] += wz
            continue
        wheel_force[owner, 0] += wx
        wheel_force[owner, 1] += wy
        wheel_force[owner, 2] += wz
        statistics[owner, IMPULSE_X] += dt * wx
        statistics[owner, IMPULSE_Y] += dt * wy
        statistics[owner, IMPULSE_Z] += dt * wz
        if fn <= 0.0:
            continue
        if fn > largest[owner]:
            largest[owner] = fn
            wheel_contact[owner, 0] = contacts[i, CONTACT_X]
            wheel_contact[owner, 1] = contacts[i, CONTACT_Y]
            wheel_contact[owner, 2] = contacts[i, CONTACT_Z]
        slip = math.sqrt(contact_velocity[3 * i] ** 2 + contact_velocity[3 * i + 1] ** 2)
        use = math.sqrt(f1 * f1 + f2 * f2) / (fn * contacts[i, FRICTION_SCALE] * ground[FRICTION_STATIC] + 1e-300)
        statistics[owner, SLIP_SPEED_MAX] = max(statistics[owner, SLIP_SPEED_MAX], slip)
        statistics[owner, FRICTION_USE_MAX] = max(statistics[owner, FRICTION_USE_MAX], use)
        statistics[owner, SLIP_DISTANCE] += dt * slip
        if slip > SLIP_THRESHOLD:
            statistics[owner, SLIP_TIME] += dt
    for wheel in range(n_wheels):
        if largest[wheel] == 0.0:
            statistics[wheel, AIR_TIME] += dt
        statistics[wheel, NORMAL_FORCE_MIN] = min(statistics[wheel, NORMAL_FORCE_MIN], largest[wheel])


@njit(cache=True)
def explicit_forces(
    poses: Any, jacobians: Any, support: Any, wheel_joints: Any, wheel_axes: Any, wheel_radii: Any, point_joints: Any,
    point_positions: Any, thruster_joints: Any, thruster_positions: Any, thruster_directions: Any, moment_ratios: Any,
    segments: Any, ground: Any, velocity: Any, thrust: Any, external: Any, wheel_force: Any, wheel_contact: Any,
    point_force: Any, out: Any,
) -> None:  # fmt: skip
    """Ground, thrust and external forces at the present state: adds them to `out` (nv,); see `implicit_step`."""
    n_wheels = wheel_joints.shape[0]
    capacity = (n_wheels + point_joints.shape[0]) * segments.shape[0]
    contacts = np.empty((capacity, CONTACT_COLUMNS))
    joints = np.empty(capacity, np.int64)
    owners = np.empty(capacity, np.int64)
    count = find_contacts(poses, wheel_joints, wheel_axes, wheel_radii, point_joints, point_positions, segments, 0.0,
                          contacts, joints, owners)  # fmt: skip
    thrust_force(poses, jacobians, support, thruster_joints, thruster_positions, thruster_directions, moment_ratios,
                 thrust, out)  # fmt: skip
    _add_base_wrench(poses, jacobians, support, external, out)
    forces = np.empty((count, 3))
    ground_force(jacobians, support, contacts, joints, count, velocity, ground, forces, out)
    statistics = np.zeros((n_wheels, STATISTICS_COLUMNS))
    _record_forces(contacts, owners, count, np.zeros(3 * count), forces.ravel(), ground, 0.0, n_wheels, wheel_force,
                   wheel_contact, point_force, statistics)  # fmt: skip
