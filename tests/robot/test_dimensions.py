"""Overall dimensions of the postures, against the paper's section II."""

from __future__ import annotations

import math

import coal
import numpy as np
import pinocchio as pin
import pytest

from m4_dynamics.errors import InvalidSettingError, NonFiniteError
from m4_dynamics.reduced.reduction import balance_frame
from m4_dynamics.robot.dimensions import extent, overall_dimensions, support
from m4_dynamics.robot.robot import Robot

PAPER_TOLERANCE = 0.015  # [m]


def placements(robot: Robot, posture: str) -> pin.Data:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.posture(posture).configuration)
    return data


def propeller_centres(robot: Robot, posture: str) -> np.ndarray:
    data = placements(robot, posture)
    return np.array([data.oMi[thruster.joint_id].act(thruster.position_in_joint) for thruster in robot.thrusters])


def test_ground_vehicle_is_as_long_wide_and_high_as_in_the_paper(m4: Robot) -> None:
    size = overall_dimensions(m4, m4.posture("ugv").configuration)
    assert size.length == pytest.approx(0.70, abs=PAPER_TOLERANCE)
    assert size.width == pytest.approx(0.35, abs=PAPER_TOLERANCE)
    assert size.height == pytest.approx(0.35, abs=PAPER_TOLERANCE)


def test_pendulum_is_as_tall_as_in_the_paper(m4: Robot) -> None:
    """From the ground under the drive wheels to the topmost point, with the pendulum's up axis vertical."""
    configuration = m4.posture("mip").configuration
    frame = balance_frame(m4, configuration)
    np.testing.assert_allclose(frame.up_in_base, [1.0, 0.0, 0.0], atol=1e-9)
    standing = overall_dimensions(m4, configuration, axes_in_world=frame.rotation_in_base)
    assert standing.height == pytest.approx(1.0, abs=PAPER_TOLERANCE)
    ground = float(frame.axle_in_base @ frame.up_in_base) - frame.wheel_radius
    lowest, _ = extent(m4, configuration, frame.up_in_base)
    assert lowest == pytest.approx(ground, abs=1e-12)  # nothing reaches below the drive wheels


def test_quadcopter_is_as_tall_as_in_the_paper(m4: Robot) -> None:
    size = overall_dimensions(m4, m4.posture("uas").configuration)
    assert size.height == pytest.approx(0.30, abs=PAPER_TOLERANCE)


def test_propeller_centres_are_as_far_apart_as_in_the_paper(m4: Robot) -> None:
    front_left, front_right, rear_left, _ = propeller_centres(m4, "uas")
    fore_aft = float(np.linalg.norm(front_left - rear_left))
    across = float(np.linalg.norm(front_left - front_right))
    assert max(fore_aft, across) == pytest.approx(0.45, abs=PAPER_TOLERANCE)
    assert max(fore_aft, across) <= 0.45


def test_leg_with_wheel_is_as_long_as_in_the_paper(m4: Robot) -> None:
    """From the hip's axis to the far side of the wheel, legs down."""
    lowest, _ = extent(m4, m4.posture("ugv").configuration, [0.0, 0.0, 1.0])
    hip = m4.joint_id("front_left_hip_frontal")
    height = placements(m4, "ugv").oMi[hip].translation[2]
    assert height - lowest == pytest.approx(0.30, abs=PAPER_TOLERANCE)


def test_wheel_is_as_large_as_in_the_paper(m4: Robot) -> None:
    assert {wheel.radius for wheel in m4.wheels} == {0.125}


def test_skids_are_lowest_before_the_robot_rises(m4: Robot) -> None:
    configuration = m4.posture("mip_sitting").configuration
    lowest, _ = extent(m4, configuration, [0.0, 0.0, 1.0])
    data = placements(m4, "mip_sitting")
    skids = [point for point in m4.contact_points if point.name.startswith("skid")]
    heights = [data.oMi[point.joint_id].act(point.position_in_joint)[2] for point in skids]
    np.testing.assert_allclose(heights, lowest, atol=1e-12)
    wheels = [data.oMi[wheel.joint_id].translation[2] - wheel.radius for wheel in m4.wheels if "rear" in wheel.joint]
    assert min(wheels) - lowest == pytest.approx(0.031, abs=1e-3)
    # The centre of mass lies between the skid ends, so that the robot rests on them.
    com = pin.centerOfMass(m4.model, data, configuration)
    ends = [point.position_in_joint[0] for point in skids]
    assert min(ends) + 0.05 < com[0] < max(ends) - 0.05


@pytest.mark.parametrize("posture", ["ugv", "crouch", "quadruped"])
def test_standing_postures_stand_on_four_wheels(m4: Robot, posture: str) -> None:
    configuration = m4.posture(posture).configuration
    data, geometry_data = m4.model.createData(), m4.collision_model.createData()
    pin.updateGeometryPlacements(m4.model, data, m4.collision_model, geometry_data, configuration)
    wheels = {wheel.joint_id for wheel in m4.wheels}
    lowest = {
        shape.parentJoint: placement.translation[2] - support(shape.geometry, placement.rotation.T @ [0.0, 0.0, -1.0])
        for shape, placement in zip(m4.collision_model.geometryObjects, geometry_data.oMg, strict=True)
        if shape.parentJoint in wheels
    }
    ground, _ = extent(m4, configuration, [0.0, 0.0, 1.0])
    np.testing.assert_allclose(list(lowest.values()), ground, atol=1e-12)
    assert set(lowest) == wheels


SHAPES = {
    "box": coal.Box(0.3, 0.2, 0.5),
    "sphere": coal.Sphere(0.2),
    "cylinder": coal.Cylinder(0.2, 0.5),
    "capsule": coal.Capsule(0.2, 0.5),
    "cone": coal.Cone(0.2, 0.5),
    "ellipsoid": coal.Ellipsoid(0.1, 0.2, 0.3),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_support_touches_the_plane_that_coal_finds_touching(kind: str) -> None:
    """A plane at the support's distance touches the shape: coal measures the distance to a half-space beyond it."""
    rng = np.random.default_rng(7)
    for direction in rng.normal(size=(20, 3)):
        d = direction / np.linalg.norm(direction)
        beyond = coal.Halfspace(-d, -5.0)  # all points with d . x >= 5
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        distance = coal.distance(SHAPES[kind], coal.Transform3s(), beyond, coal.Transform3s(), request, result)
        assert support(SHAPES[kind], d) == pytest.approx(5.0 - distance, abs=1e-6)


def test_support_of_meshes_and_planes() -> None:
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(4, 4)
    corners = np.array([[0.0, 0, 0], [1.0, 0, 0], [0, 2.0, 0], [0, 0, 3.0]])
    for triangle in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)):
        mesh.addTriangle(*corners[list(triangle)])
    mesh.endModel()
    mesh.buildConvexHull(True, "Qt")
    for shape in (mesh, mesh.convex):
        assert support(shape, [0.0, 0.0, 1.0]) == pytest.approx(3.0)
        assert support(shape, [0.0, -1.0, 0.0]) == pytest.approx(0.0)
    assert support(coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), [1.0, 0.0, 0.0]) == math.inf


def test_extent_of_a_turned_robot_is_exact(m4: Robot) -> None:
    """Turning the robot and turning the direction are the same."""
    configuration = np.array(m4.posture("quadruped").configuration)
    rotation = pin.rpy.rpyToMatrix(0.3, -0.4, 0.5)
    turned = configuration.copy()
    turned[3:7] = pin.Quaternion(rotation).coeffs()
    d = np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(extent(m4, turned, d), extent(m4, configuration, rotation.T @ d), atol=1e-12)


def test_wrong_configurations_are_refused(m4: Robot) -> None:
    with pytest.raises(InvalidSettingError, match="configuration"):
        extent(m4, np.zeros(3), [1.0, 0.0, 0.0])
    broken = np.array(m4.posture("ugv").configuration)
    broken[8] = math.nan
    with pytest.raises(NonFiniteError, match="entry 8"):
        overall_dimensions(m4, broken)
