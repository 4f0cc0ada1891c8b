"""Where wheels and points touch the ground: against sampled rims, over crests, in corners, and as Jacobians."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pinocchio as pin
import pytest
from finite_differences import configuration_jacobian
from numpy.typing import NDArray
from random_states import random_configuration

from m4_dynamics.errors import InvalidSettingError, NonFiniteError
from m4_dynamics.full import kernels
from m4_dynamics.full.contact import contact_jacobian, contacts_at
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.terrain import Terrain, incline_terrain, plateau_terrain, ramp_terrain
from m4_dynamics.robot.robot import Robot

Array = NDArray[np.float64]
RADIUS = 0.125
CREST = Terrain(np.array([[-2.0, -2.0], [0.0, 0.0], [2.0, 0.0]]))
#: Yaw and tilt of the wheel from rolling straight uphill [rad].
ATTITUDES = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.3), (-0.4, 0.25), (1.2, 0.1), (1.5, -0.05), (1.56, 0.4))


def wheel_axis(yaw: float, tilt: float) -> Array:
    axis: Array = pin.rpy.rpyToMatrix(tilt, 0.0, yaw) @ np.array([0.0, 1.0, 0.0])
    return axis


def rim_points(centre: Array, axis: Array, angles: Array) -> Array:
    """Points of the rim at angles from its lowest one, shape (*angles.shape, 3)."""
    first = np.cross(axis, (0.0, 0.0, 1.0))
    first /= np.linalg.norm(first)
    down = np.cross(first, axis)
    down *= -np.sign(down[2])
    points: Array = centre + RADIUS * (np.sin(angles)[..., None] * first + np.cos(angles)[..., None] * down)
    return points


def heights(terrain: Terrain, x: Array) -> Array:
    """Height of the ground from the profile's corner points alone; its ends go on."""
    profile = terrain.profile_in_world
    first, last = profile[1] - profile[0], profile[-1] - profile[-2]
    far = np.vstack((profile[0] - 100.0 * first, profile[1:-1], profile[-1] + 100.0 * last))
    height: Array = np.interp(x, far[:, 0], far[:, 1])
    return height


def heights_of_touching_wheel(terrain: Terrain, x: Array, axis: Array) -> Array:
    """Height of the centre at which the rim just touches, for each x: sampled, then zoomed in on."""
    centres = np.stack((x, np.zeros_like(x), np.zeros_like(x)), axis=-1)[:, None, :]
    best, width = np.zeros((x.size, 1)), 0.5 * math.pi
    for _ in range(5):
        angles = best + np.linspace(-width, width, 61)
        rim = rim_points(centres, axis, angles)
        needed = heights(terrain, rim[..., 0]) - rim[..., 2]
        at = needed.argmax(axis=1)[:, None]
        best, width = np.take_along_axis(angles, at, axis=1), width / 15.0
    return np.take_along_axis(needed, at, axis=1)[:, 0]


def distance_to_ground(terrain: Terrain, points: Array) -> float:
    """Least distance of points above the ground from its profile."""
    least = math.inf
    for (ax, az), (bx, bz) in itertools.pairwise(terrain.profile_in_world):
        along = np.array([bx - ax, bz - az])
        part = np.clip(((points[:, [0, 2]] - (ax, az)) @ along) / (along @ along), 0.0, 1.0)
        nearest = np.array([ax, az]) + part[:, None] * along
        least = min(least, float(np.linalg.norm(points[:, [0, 2]] - nearest, axis=1).min()))
    return least


def contacts_of(terrain: Terrain, *, centre: Array | None = None, axis: Array | None = None,
                point: Array | None = None, margin: float = 0.0) -> Array:  # fmt: skip
    """Contact table of one wheel, or of one point."""
    poses = np.zeros((2, 12))
    poses[:, [0, 4, 8]] = 1.0
    wheels = 0 if centre is None else 1
    points = 0 if point is None else 1
    if centre is not None:
        poses[1, 9:] = centre
    table = np.zeros((50, kernels.CONTACT_COLUMNS))
    joints, owners = np.zeros(50, np.int64), np.zeros(50, np.int64)
    count = kernels.find_contacts(
        poses, np.ones(wheels, np.int64), np.zeros((wheels, 3)) + (0.0 if axis is None else axis),
        np.full(wheels, RADIUS), np.ones(points, np.int64), np.zeros((points, 3)) + (0.0 if point is None else point),
        terrain.segments, margin, table, joints, owners,
    )  # fmt: skip
    return table[:count]


@pytest.mark.parametrize(("yaw", "tilt"), ATTITUDES)
def test_gap_of_a_wheel_is_the_distance_of_its_rim(yaw: float, tilt: float, rng: np.random.Generator) -> None:
    """On flat, crest and slope, against a densely sampled rim: nothing when it touches, and the distance above."""
    axis = wheel_axis(yaw, tilt)
    places = rng.uniform(-0.15, 0.15, 60)
    for x, height in zip(places, heights_of_touching_wheel(CREST, places, axis), strict=True):
        touching = contacts_of(CREST, centre=np.array([x, 0.3, height]), axis=axis, margin=1e-6)
        np.testing.assert_allclose(touching[:, kernels.GAP], [0.0], atol=1e-7)  # as fine as the rim is sampled
        # Above the ground, a wheel almost parallel to the corner line lists the distance within its own plane.
        if axis[1] > 0.05:
            centre = np.array([x, 0.3, height + 5e-4])
            found = contacts_of(CREST, centre=centre, axis=axis, margin=2e-3)
            rim = rim_points(centre, axis, np.linspace(-math.pi, math.pi, 20001))
            assert found[:, kernels.GAP].min() == pytest.approx(distance_to_ground(CREST, rim), rel=0.02), x


@pytest.mark.parametrize(("yaw", "tilt"), ATTITUDES)
@pytest.mark.parametrize("depth", [1e-4, 3e-3])
def test_contact_moves_continuously_over_a_crest(yaw: float, tilt: float, depth: float) -> None:
    """A wheel swept over the corner at constant penetration has one contact throughout, which never jumps.

    What moves continuously moves a quarter as far in a quarter of a step; a jump stays.
    """
    axis = wheel_axis(yaw, tilt)
    places = np.arange(-0.15, 0.15, 1e-4)
    table = []
    for x, height in zip(places, heights_of_touching_wheel(CREST, places, axis), strict=True):
        found = contacts_of(CREST, centre=np.array([x, 0.0, height - depth]), axis=axis)
        assert len(found) == 1, f"{len(found)} contacts at x = {x:.4f}"
        table.append(found[0])
    path = np.array(table)
    # Almost parallel to the corner line, the wheel's contact goes over it within less than a step.
    columns = (*range(3), kernels.NORMAL_X, kernels.NORMAL_Z, kernels.GAP) if axis[1] > 0.2 else ()
    for column in columns:
        fine, coarse = (np.abs(np.diff(path[::every, column])).max() for every in (1, 4))
        assert fine < 0.3 * coarse + 1e-8, column
    normals = path[:, [kernels.NORMAL_X, kernels.NORMAL_Z]]
    np.testing.assert_allclose(normals[0], (-math.sqrt(0.5), math.sqrt(0.5)), atol=1e-12)
    np.testing.assert_allclose(normals[-1], (0.0, 1.0), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)


def test_a_wheel_in_a_concave_corner_touches_two_segments() -> None:
    slope = math.radians(45.0)
    ramp = ramp_terrain(slope)
    # Centre one radius from either face, less the penetration.
    depth = 2e-4
    inset = (RADIUS - depth) * math.tan(0.5 * slope)
    axis = np.array([0.0, 1.0, 0.0])
    found = contacts_of(ramp, centre=np.array([-inset, 0.0, RADIUS - depth]), axis=axis)
    assert len(found) == 2
    np.testing.assert_allclose(found[:, kernels.GAP], -depth, atol=1e-12)
    normals = found[:, [kernels.NORMAL_X, kernels.NORMAL_Z]]
    np.testing.assert_allclose(normals, [(0.0, 1.0), (-math.sin(slope), math.cos(slope))], atol=1e-12)
    np.testing.assert_allclose(found[0, :3], (-inset, 0.0, -depth), atol=1e-12)
    # A little further back only the level part is touched.
    assert len(contacts_of(ramp, centre=np.array([-inset - 1e-3, 0.0, RADIUS - depth]), axis=axis)) == 1


def test_contacts_are_clipped_to_their_segment() -> None:
    """The planes of a plateau's segments go on beyond its corners, but nothing touches them there."""
    slope = math.radians(40.0)
    plateau = plateau_terrain(slope, length=1.0)
    top = math.cos(slope) + 0.3, math.sin(slope)
    for x, z, expected in ((-1.0, 0.0, (0.0, 1.0)), (top[0], top[1], (0.0, 1.0))):
        found = contacts_of(plateau, centre=np.array([x, 0.0, z + RADIUS - 1e-3]), axis=np.array([0.0, 1.0, 0.0]))
        assert len(found) == 1
        np.testing.assert_allclose(found[0, [kernels.NORMAL_X, kernels.NORMAL_Z]], expected, atol=1e-12)
        found = contacts_of(plateau, point=np.array([x, 0.0, z - 1e-3]))
        assert len(found) == 1
        np.testing.assert_allclose(found[0, [kernels.NORMAL_X, kernels.NORMAL_Z]], expected, atol=1e-12)
    # The first and the last segment have no outer end.
    assert len(contacts_of(plateau, point=np.array([-50.0, 0.0, -1e-3]))) == 1
    assert len(contacts_of(plateau, point=np.array([50.0, 0.0, top[1] - 1e-3]))) == 1


@pytest.mark.parametrize("slopes", [(0.0, 45.0), (45.0, 0.0), (0.0, 5.0), (-30.0, 10.0), (20.0, -60.0)])
@pytest.mark.parametrize("depth", [1e-4, 3e-3])
def test_a_point_never_loses_the_ground_in_a_corner(slopes: tuple[float, float], depth: float) -> None:
    """Swept through a corner at a constant depth below the surface, convex or concave, it is always pushed out, and by
    a force that does not jump."""
    first, second = (math.tan(math.radians(angle)) for angle in slopes)
    terrain = Terrain(np.array([[-1.0, -first], [0.0, 0.0], [1.0, second]]))
    spacing = 1e-6
    depths = []
    for x in np.arange(-1.5 * depth, 1.5 * depth, spacing):
        z = (first if x < 0.0 else second) * x - depth
        found = contacts_of(terrain, point=np.array([x, 0.0, z]))
        assert len(found) > 0, x
        pushed_out = found[:, [kernels.NORMAL_X, kernels.NORMAL_Z]] * -found[:, [kernels.GAP]]
        depths.append((*pushed_out.sum(axis=0), np.linalg.norm(pushed_out.sum(axis=0))))
    jumps = np.abs(np.diff(np.array(depths), axis=0))
    # At a convex corner the push changes its direction on the bisector, where both faces are equally near.
    assert jumps[:, 2].max() < 3.0 * spacing
    if slopes[1] > slopes[0]:
        assert jumps.max() < 3.0 * spacing


@pytest.mark.parametrize("scales", [(1.0, 0.25), (0.25, 1.0)])
def test_friction_scale_follows_the_segment(scales: tuple[float, float]) -> None:
    profile = np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, -1.0]])
    icy = Terrain(profile, friction_scale=np.array(scales))
    for x, expected in zip((-0.5, 0.5), scales, strict=True):
        point = np.array([x, 0.0, min(0.0, -x) - 1e-3])
        assert contacts_of(icy, point=point)[0, kernels.FRICTION_SCALE] == expected
    # On the crest itself, the more slippery of the two.
    axis = np.array([0.0, 1.0, 0.0])
    centre = np.array([RADIUS * math.sin(0.3), 0.0, RADIUS * math.cos(0.3) - 1e-3])
    on_crest = contacts_of(icy, centre=centre, axis=axis)
    assert len(on_crest) == 1
    assert on_crest[0, kernels.FRICTION_SCALE] == 0.25


def test_no_contact_is_dropped_however_many_there_are(m4_on_ground: FullModel) -> None:
    """All points and wheels of the robot in one valley, each against both of its faces."""
    robot = m4_on_ground.robot
    valley = Terrain(np.array([[-1.0, 0.02], [0.0, 0.0], [1.0, 0.02]]))
    model = FullModel.build(robot, valley)
    q = robot.posture("uas").configuration.copy()
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, 0.0, 0.5 * math.pi)).coeffs()
    q[2] = 0.15
    found = contacts_at(model, q, margin=10.0)
    per_owner = {owner: sum(contact.owner == owner for contact in found) for owner in {c.owner for c in found}}
    assert set(per_owner) == {w.joint for w in robot.wheels} | {p.name for p in robot.contact_points}
    assert all(count >= 1 for count in per_owner.values())


def test_contact_jacobian_is_the_velocity_of_the_material_point(m4: Robot, rng: np.random.Generator) -> None:
    model = FullModel.build(m4, incline_terrain(0.6))
    pinocchio_model, data = model.robot.model, model.robot.model.createData()
    kinds = set()
    for _ in range(20):
        q = random_configuration(pinocchio_model, rng, height=0.2)
        for contact in contacts_at(model, q)[:3]:
            kinds.add(contact.owner in {wheel.joint for wheel in model.robot.wheels})
            pin.forwardKinematics(pinocchio_model, data, q)
            on_body = data.oMi[contact.joint_id].actInv(contact.position_in_world)

            def position(q: Array, joint: int = contact.joint_id, on_body: Array = on_body) -> Array:
                pin.forwardKinematics(pinocchio_model, data, q)
                return np.array(data.oMi[joint].act(on_body))

            expected = configuration_jacobian(pinocchio_model, position, q)
            np.testing.assert_allclose(contact_jacobian(model, q, contact), expected, rtol=0.0, atol=1e-8)
    assert kinds == {True, False}


def test_contacts_at_names_owners_and_axes(m4_on_ground: FullModel) -> None:
    q = m4_on_ground.robot.posture("ugv").configuration.copy()
    wheel = m4_on_ground.robot.wheels[0]
    pin.forwardKinematics(m4_on_ground.robot.model, m4_on_ground.data, q)
    q[2] = wheel.radius - 1e-3 - m4_on_ground.data.oMi[wheel.joint_id].translation[2]
    found = contacts_at(m4_on_ground, q)
    assert [contact.owner for contact in found] == [wheel.joint for wheel in m4_on_ground.robot.wheels]
    for contact in found:
        assert contact.gap == pytest.approx(-1e-3, abs=1e-9)
        axes = np.vstack((contact.tangents_in_world, contact.normal_in_world))
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
        np.testing.assert_allclose(contact.normal_in_world, (0.0, 0.0, 1.0))


def test_wrong_input_is_refused_in_words(m4_on_ground: FullModel) -> None:
    q = m4_on_ground.robot.posture("ugv").configuration.copy()
    q[2] = 0.29
    contact = contacts_at(m4_on_ground, q)[0]
    for function in (lambda q: contacts_at(m4_on_ground, q), lambda q: contact_jacobian(m4_on_ground, q, contact)):
        with pytest.raises(InvalidSettingError, match="configuration q"):
            function(q[:-1])
        with pytest.raises(NonFiniteError, match="configuration q"):
            function(np.full_like(q, np.nan))
