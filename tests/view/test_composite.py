"""The picture of a climb shows true outlines, forces and instants."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
import xarray
from matplotlib.collections import PolyCollection
from matplotlib.image import imread
from matplotlib.patches import FancyArrowPatch

from m4_dynamics.errors import InvalidSettingError, ResultFileError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.composite import draw_climb, write_climb_picture
from m4_dynamics.view.silhouette import outlines_at, surface_points


@pytest.mark.parametrize(
    "geometry",
    [
        coal.Box(0.1, 0.2, 0.3),
        coal.Sphere(0.1),
        coal.Ellipsoid(0.1, 0.2, 0.3),
        coal.Capsule(0.05, 0.3),
        coal.Cylinder(0.1, 0.3),
        coal.Cone(0.1, 0.3),
    ],
    ids=lambda geometry: type(geometry).__name__,
)
def test_surface_points_span_the_body(geometry: coal.ShapeBase) -> None:
    geometry.computeLocalAABB()
    points = surface_points(geometry)
    np.testing.assert_allclose(points.min(axis=0), geometry.aabb_local.min_, atol=1e-6)
    np.testing.assert_allclose(points.max(axis=0), geometry.aabb_local.max_, atol=1e-6)


def test_a_half_space_has_no_outline() -> None:
    assert surface_points(coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)) is None


def test_a_wheel_seen_from_the_side_is_a_disc_of_its_radius(climb: xarray.Dataset, robot: Robot) -> None:
    configuration = climb.configuration.values[-1]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, configuration)
    wheel = robot.wheel(robot.balance.drive_wheels[0])
    centre = data.oMi[wheel.joint_id].translation[[0, 2]]
    directions = np.array([(np.cos(angle), np.sin(angle)) for angle in np.linspace(0.0, 2.0 * np.pi, 36)])
    reaches = [
        ((np.vstack(outline.polygons) - centre) @ directions.T).max(axis=0)
        for outline in outlines_at(robot, configuration)
    ]
    # Between two of the tyre's 24 lugs the rim is a few tenths of a per cent lower.
    assert any(np.allclose(reach, wheel.radius, rtol=1e-2) for reach in reaches)


def test_near_bodies_are_painted_over_far_ones(climb: xarray.Dataset, robot: Robot) -> None:
    depths = [outline.depth for outline in outlines_at(robot, climb.configuration.values[0])]
    assert np.all(np.diff(depths) < 1e-4)


def test_picture_is_written_and_not_blank(climb: xarray.Dataset, robot: Robot, tmp_path: Path) -> None:
    path = write_climb_picture(climb, robot, tmp_path / "climb.png")
    assert [file.name for file in tmp_path.iterdir()] == ["climb.png"]
    image = imread(path)
    assert len(np.unique(image.reshape(-1, image.shape[2]), axis=0)) > 500
    assert path.stat().st_size < 1e6


def test_poses_are_spread_evenly_along_the_way(climb: xarray.Dataset, robot: Robot) -> None:
    axes = draw_climb(climb, robot, poses=4).axes[0]
    bodies = [one for one in axes.collections if isinstance(one, PolyCollection)]
    assert len(bodies) == 4 * len(robot.visual_model.geometryObjects)
    shown = np.array([line.get_xydata()[0] for line in axes.lines if line.get_marker() == "o"])
    line = (shown[-1] - shown[0]) / np.linalg.norm(shown[-1] - shown[0])
    assert len(shown) == 4
    # At 0.3 m/s the robot moves 6 mm from one instant searched to the next.
    np.testing.assert_allclose(np.diff(shown @ line), np.ptp(shown @ line) / 3.0, atol=7e-3)
    np.testing.assert_allclose(shown[-1], climb.com_in_world.values[-1, [0, 2]], atol=1e-6)


def test_arrows_are_the_resultant_forces(climb: xarray.Dataset, robot: Robot) -> None:
    axes = draw_climb(climb, robot, poses=2).axes[0]
    arrows = [one for one in axes.patches if isinstance(one, FancyArrowPatch)]
    last = climb.isel(time=-1)
    expected = [
        last.contact_force_in_world.sum("wheel").values[[0, 2]],
        float(last.thrust.sum()) * np.array([np.cos(last.state.values[1]), -np.sin(last.state.values[1])]),
    ]
    spans = [np.subtract(arrow._posA_posB[1], arrow._posA_posB[0]) for arrow in arrows[-2:]]
    scale = np.linalg.norm(spans[0]) / np.linalg.norm(expected[0])
    for span, force in zip(spans, expected, strict=True):
        np.testing.assert_allclose(span, scale * force, atol=2e-4)


def test_equal_scale_on_both_axes(climb: xarray.Dataset, robot: Robot) -> None:
    figure = draw_climb(climb, robot)
    figure.canvas.draw()
    axes = figure.axes[0]
    box = axes.get_window_extent()
    across = box.width / np.diff(axes.get_xlim())[0]
    up = box.height / np.diff(axes.get_ylim())[0]
    assert across == pytest.approx(up, rel=1e-3)


def test_what_cannot_be_drawn_is_named(climb: xarray.Dataset, robot: Robot, tmp_path: Path) -> None:
    with pytest.raises(InvalidSettingError, match="poses"):
        write_climb_picture(climb, robot, tmp_path / "climb.png", poses=1)
    with pytest.raises(ResultFileError, match="terrain_x"):
        write_climb_picture(climb.drop_vars("terrain_x"), robot, tmp_path / "climb.png")
    assert list(tmp_path.iterdir()) == []
