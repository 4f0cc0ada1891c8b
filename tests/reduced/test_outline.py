"""The body's outline against exact distances of its collision shapes to the slope."""

from __future__ import annotations

import dataclasses
import math

import coal
import numpy as np
import pinocchio as pin
import pytest

from m4_dynamics.reduced.reduction import Reduction, configuration_on_slope, reduce_robot
from m4_dynamics.reduced.reduction.frame import drive_wheel_joints
from m4_dynamics.reduced.reduction.outline import body_outline
from m4_dynamics.reduced.trim_limits import ground_clearance
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot

SLOPE = math.radians(30.0)
NORMAL = np.array([-math.sin(SLOPE), 0.0, math.cos(SLOPE)])


def exact_clearance(robot: Robot, reduction: Reduction, pitch: float) -> float:
    """Least distance of any shape but the drive wheels' to the slope, by the collision library."""
    q = configuration_on_slope(robot, reduction, slope=SLOPE, pitch=pitch)
    data = robot.model.createData()
    geometry_data = robot.collision_model.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.collision_model, geometry_data, q)
    wheels = drive_wheel_joints(robot, reduction.frame)
    ground = coal.Halfspace(NORMAL, 0.0)
    distances = []
    for shape, placement in zip(robot.collision_model.geometryObjects, geometry_data.oMg, strict=True):
        if shape.parentJoint in wheels:
            continue
        where = coal.Transform3s(placement.rotation, placement.translation)
        result = coal.DistanceResult()
        distances.append(
            coal.distance(shape.geometry, where, ground, coal.Transform3s(), coal.DistanceRequest(), result)
        )
    return min(distances)


@pytest.mark.parametrize("pitch_deg", [-110.0, -60.0, -20.0, 0.0, 40.0])
def test_clearance_of_m4_is_that_of_its_shapes(m4: Robot, m4_reduction: Reduction, pitch_deg: float):
    pitch = math.radians(pitch_deg)
    found = ground_clearance(SLOPE, pitch, m4_reduction.outline_in_body, m4_reduction.parameters.wheel_radius)
    exact = exact_clearance(m4, m4_reduction, pitch)
    # Contact points and the thin rims of the upper wheels may lie a little outside the shapes, sampling inside.
    assert found == pytest.approx(exact, abs=1e-3)


@pytest.mark.parametrize(
    ("geometry", "half_width"),
    [
        (coal.Box(0.2, 0.4, 0.6), lambda c, s: 0.1 * abs(c) + 0.3 * abs(s)),
        (coal.Sphere(0.2), lambda c, s: 0.2),
        (coal.Cylinder(0.2, 0.6), lambda c, s: 0.2 * abs(c) + 0.3 * abs(s)),
        (coal.Capsule(0.2, 0.6), lambda c, s: 0.2 + 0.3 * abs(s)),
        (coal.Ellipsoid(0.1, 0.2, 0.3), lambda c, s: 0.1 * abs(c) + 0.3 * abs(s)),  # taken as its box
    ],
)
def test_outline_of_each_kind_of_shape(scooter_description, geometry, half_width):
    """The reach of the outline in a direction is the shape's own, for a shape centred at the frame's origin."""
    robot = load_robot(scooter_description)
    reduction = reduce_robot(robot)
    shapes = pin.GeometryModel()
    shapes.addGeometryObject(pin.GeometryObject("shape", 1, pin.SE3.Identity(), geometry))
    outline = body_outline(dataclasses.replace(robot, collision_model=shapes), reduction.frame, reduction.configuration)
    from_origin = outline + np.array([0.0, reduction.frame.axle_in_base[2]])  # forward is base x, up is base z
    for angle in np.linspace(0.0, math.pi, 13):
        c, s = math.cos(angle), math.sin(angle)
        assert np.max(from_origin @ [c, s]) == pytest.approx(half_width(c, s), rel=3e-3)


def test_mesh_keeps_its_corners_and_scale(scooter_description, tmp_path):
    (tmp_path / "wedge.obj").write_text("v 0 0 0\nv 2 0 0\nv 0 0 2\nv 0 1 0\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    urdf = scooter_description.with_suffix(".urdf").read_text()
    mesh = '<mesh filename="wedge.obj" scale="0.5 0.5 0.5"/>'
    box = '<collision><origin xyz="0 0 0.3"/><geometry><box size="0.2 0.3 0.6"/></geometry></collision>'
    assert box in urdf
    (tmp_path / "scooter.urdf").write_text(urdf.replace(box, f"<collision><geometry>{mesh}</geometry></collision>"))
    for suffix in (".srdf", ".toml"):
        (tmp_path / f"scooter{suffix}").write_text(scooter_description.with_suffix(suffix).read_text())
    outline = reduce_robot(load_robot(tmp_path / "scooter.toml")).outline_in_body
    assert sorted((round(x, 6), round(z, 6)) for x, z in outline) == [(0.0, 0.05), (0.0, 1.05), (1.0, 0.05)]


def test_robot_without_shapes_has_no_outline(scooter_description):
    robot = dataclasses.replace(load_robot(scooter_description), collision_model=pin.GeometryModel())
    reduction = reduce_robot(robot)
    assert reduction.outline_in_body is None
    assert ground_clearance(0.3, [0.1, 0.2], None, 0.1).tolist() == [math.inf, math.inf]
