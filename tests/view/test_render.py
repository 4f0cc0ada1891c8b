"""The renderer against what geometry says: projected areas, hidden surfaces, places of shadows, outlines of bodies."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest
import xarray
from matplotlib.path import Path as Polygon

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.render.camera import Camera
from m4_dynamics.view.render.kernels import rasterise
from m4_dynamics.view.render.picture import Frame, render_picture
from m4_dynamics.view.render.solids import GroundSlab, RobotShapes, Solid, _solid
from m4_dynamics.view.silhouette import outlines_at

RED, BLUE = np.array([0.9, 0.1, 0.1]), np.array([0.1, 0.1, 0.9])
OBLIQUE = (-0.4, -1.0, 0.5)


def rasterised(*triangles: list[tuple[float, float, float]], size: int = 40) -> tuple[np.ndarray, np.ndarray]:
    depth, nearest = np.full((size, size), np.inf), np.full((size, size), -1, dtype=np.int64)
    rasterise(np.array(triangles, dtype=float), depth, nearest)
    return depth, nearest


def shape(geometry: coal.CollisionGeometry, place: tuple[float, float, float], colour: np.ndarray = RED) -> Solid:
    solid = _solid(geometry, colour)
    assert solid is not None
    return solid.moved(np.eye(3), np.array(place))


def test_a_triangle_covers_the_pixels_whose_centres_lie_in_it() -> None:
    corners = [(3.2, 4.1, 1.0), (33.7, 9.4, 1.0), (12.3, 36.8, 1.0)]
    inside = Polygon([corner[:2] for corner in corners]).contains_points(
        [(column + 0.5, row + 0.5) for row in range(40) for column in range(40)]
    )
    for order in (corners, corners[::-1]):  # either way round
        _, nearest = rasterised(order)
        np.testing.assert_array_equal(nearest.ravel() == 0, inside)


def test_the_nearer_triangle_hides_the_farther_one_in_any_order() -> None:
    far = [(0.0, 0.0, 5.0), (40.0, 0.0, 5.0), (0.0, 40.0, 5.0)]
    slanted = [(0.0, 0.0, 0.0), (40.0, 0.0, 10.0), (0.0, 40.0, 0.0)]  # depth a quarter of the column
    for triangles, slanted_number in (((far, slanted), 1), ((slanted, far), 0)):
        depth, nearest = rasterised(*triangles)
        for column in (2, 10, 18, 22, 30):
            row = 3
            assert depth[row, column] == pytest.approx(min(5.0, (column + 0.5) / 4.0))
            assert (nearest[row, column] == slanted_number) == (column < 20)


def test_a_triangle_seen_edge_on_covers_nothing() -> None:
    _, nearest = rasterised([(0.0, 0.0, 0.0), (20.0, 20.0, 1.0), (40.0, 40.0, 2.0)])
    assert (nearest == -1).all()


def test_camera_axes() -> None:
    side = Camera()
    np.testing.assert_allclose(side.view([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.eye(3)[[0, 2, 1]])
    camera = Camera(OBLIQUE)
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(camera.axes) == pytest.approx(-1.0)  # right, up, away: away makes it left-handed
    points = np.random.default_rng(1).normal(size=(5, 3))
    np.testing.assert_allclose(camera.world(camera.view(points)), points, atol=1e-12)
    assert camera.project([0.0, 0.0, 1.0])[0] == pytest.approx(0.0)  # vertical stays vertical
    with pytest.raises(InvalidSettingError, match="towards_viewer"):
        Camera((0.0, 0.0, 1.0))


def test_a_box_covers_its_projected_area() -> None:
    sides = np.array([0.3, 0.5, 0.7])
    camera = Camera(OBLIQUE)
    # Turned, so that no edge runs along rows or columns, where all its pixels would be rounded the same way.
    rotation = pin.exp3(np.array([0.3, -0.5, 0.8]))
    box = shape(coal.Box(*sides), (0.0, 0.0, 0.0)).moved(rotation, np.zeros(3))
    image = render_picture([box], None, camera, Frame(-0.6, 0.6, -0.6, 0.6), resolution=150)
    faces = np.array([sides[1] * sides[2], sides[0] * sides[2], sides[0] * sides[1]])
    seen = faces @ np.abs(rotation.T @ camera.axes[2])
    assert image[..., 3].sum() / 150**2 == pytest.approx(seen, rel=2e-3)


def test_the_nearer_body_is_seen() -> None:
    near, far = shape(coal.Sphere(0.1), (0.0, -1.0, 0.0), RED), shape(coal.Sphere(0.2), (0.0, 1.0, 0.0), BLUE)
    for solids in ([near, far], [far, near]):
        image = render_picture(solids, None, Camera(), Frame(-0.3, 0.3, -0.3, 0.3), resolution=100)
        assert image[30, 30, 0] > image[30, 30, 2]  # red in the middle
        assert image[30, 45, 2] > image[30, 45, 0]  # blue around it


def test_the_shadow_falls_where_the_sun_sends_it() -> None:
    height, frame, resolution = 0.6, Frame(-0.2, 0.9, -0.2, 0.8), 150
    camera = Camera(OBLIQUE)
    ground = GroundSlab(np.array([[-2.0, 0.0], [2.0, 0.0]]), near=-2.0, far=2.0)
    ball = shape(coal.Sphere(0.08), (0.0, 0.0, height))
    lit = render_picture([], ground, camera, frame, resolution=resolution)
    shaded = render_picture([ball], ground, camera, frame, resolution=resolution)
    # Where the ground got darker but is still seen, far from the ball itself.
    darker = (lit[..., :3] - shaded[..., :3]).min(axis=2) > 0.1
    rows, columns = np.nonzero(darker)
    place = np.column_stack([frame.left + (columns + 0.5) / resolution, frame.top - (rows + 0.5) / resolution])
    ball_place = camera.project((0.0, 0.0, height))
    place = place[np.linalg.norm(place - ball_place, axis=1) > 0.1]
    sun = np.array([-0.45, -0.62, 1.0])
    expected = camera.project(np.array([0.0, 0.0, height]) - height * sun)
    np.testing.assert_allclose(place.mean(axis=0), expected, atol=0.01)


def test_tiles_are_a_quarter_of_a_metre_and_start_at_the_foot() -> None:
    slope = np.deg2rad(30.0)
    profile = np.array([[-1.0, 0.0], [0.0, 0.0], [np.cos(slope), np.sin(slope)]])
    camera = Camera((0.0, -1.0, 1.0))
    image = render_picture([], GroundSlab(profile), camera, Frame(-1.0, 1.0, -1.0, 1.0), resolution=200)

    def brightness(along: float, across: float) -> float:
        place = np.array([along, across, 0.0]) if along < 0 else np.array(
            [along * np.cos(slope), across, along * np.sin(slope)]
        )  # fmt: skip
        right, up = camera.project(place)
        return float(image[round((1.0 - up) * 200), round((right + 1.0) * 200), :3].sum())

    for start in (-0.5, 0.0, 0.5):
        light, dark = brightness(start + 0.125, 0.125), brightness(start + 0.375, 0.125)
        assert light > dark + 0.1
        assert brightness(start + 0.03, 0.22) == pytest.approx(light, abs=1e-6)
        assert brightness(start + 0.125, -0.125) == pytest.approx(dark, abs=1e-6)


def test_the_robot_covers_its_outlines(climb: xarray.Dataset, robot: Robot) -> None:
    configuration = climb.configuration.values[-1]
    outlines = [polygon for outline in outlines_at(robot, configuration) for polygon in outline.polygons]
    low, high = np.vstack(outlines).min(axis=0) - 0.02, np.vstack(outlines).max(axis=0) + 0.02
    frame, resolution = Frame(low[0], high[0], low[1], high[1]), 1200  # thin struts have many edges
    image = render_picture(RobotShapes(robot).at(configuration), None, Camera(), frame, resolution=resolution)
    rows, columns = image.shape[:2]
    x = low[0] + (np.arange(columns) + 0.5) / resolution
    z = high[1] - (np.arange(rows) + 0.5) / resolution
    inside = np.zeros((rows, columns), dtype=bool)
    for outline in outlines:
        # Only the pixels near a triangle need to be asked about it.
        left, right = np.searchsorted(x, outline[:, 0].min()), np.searchsorted(x, outline[:, 0].max())
        top, bottom = np.searchsorted(-z, -outline[:, 1].max()), np.searchsorted(-z, -outline[:, 1].min())
        centres = np.stack(np.meshgrid(x[left:right], z[top:bottom]), axis=-1)
        within = Polygon(outline).contains_points(centres.reshape(-1, 2)) if centres.size else np.empty(0, dtype=bool)
        inside[top:bottom, left:right] |= within.reshape(centres.shape[:2])
    drawn = image[..., 3] > 0.5
    assert (inside & drawn).sum() / (inside | drawn).sum() > 0.985


def test_a_wheel_without_a_body_is_a_disc(robot: Robot) -> None:
    import dataclasses

    bare = dataclasses.replace(robot, visual_model=pin.GeometryModel())
    configuration = pin.neutral(robot.model)
    solids = RobotShapes(bare).at(configuration, (1.0, 0.0, 0.0))
    assert len(solids) == len(robot.wheels)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, configuration)
    for solid, wheel in zip(solids, robot.wheels, strict=True):
        offsets = solid.corners.reshape(-1, 3) - np.array(data.oMi[wheel.joint_id].translation) - (1.0, 0.0, 0.0)
        np.testing.assert_allclose(np.hypot(offsets[:, 0], offsets[:, 2]).max(), wheel.radius, rtol=1e-6)
