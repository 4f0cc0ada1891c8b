"""The replay page in a real browser, headless and offline."""

from __future__ import annotations

import dataclasses
import io
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
import xarray
from PIL import Image

from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.gallery import posture_html, write_posture_html
from m4_dynamics.view.phases import phases_of
from m4_dynamics.view.replay import write_replay_html
from m4_dynamics.view.serving import PageServer

# A slow machine draws a few frames a second, so tests wait for frames, not for a time.
FRAMES = """() => new Promise((done) => {
  let left = 4;
  const next = () => (left-- ? requestAnimationFrame(next) : done());
  next();
})"""

# Corners of every shape's bounding box in the world frame (z up), by node.
BOXES = """() => {
  const boxes = {};
  viewer.scene.updateMatrixWorld(true);
  const visit = (object, path) => {
    if (object.isMesh) {
      object.geometry.computeBoundingBox();
      const { min, max } = object.geometry.boundingBox;
      boxes[path] = [0, 1, 2, 3, 4, 5, 6, 7].map((corner) => {
        const place = new MeshCat.THREE.Vector3(
          corner & 1 ? max.x : min.x, corner & 2 ? max.y : min.y, corner & 4 ? max.z : min.z);
        place.applyMatrix4(object.matrixWorld);
        return [place.x, -place.z, place.y];
      });
    }
    object.children.forEach((child) => visit(child, child.isMesh ? path : `${path}/${child.name}`));
  };
  visit(viewer.scene_tree.find(["robot"]).object, "/robot");
  return boxes;
}"""


class Opened:
    """A page in the browser, with what it said and asked for."""

    def __init__(self, browser: Any, path: Path, width: int = 1280, height: int = 800) -> None:
        self.messages: list[str] = []
        self.requests: list[str] = []
        self.page = browser.new_page(viewport={"width": width, "height": height})
        self.page.on("console", lambda message: self.messages.append(f"{message.type}: {message.text}"))
        self.page.on("pageerror", lambda error: self.messages.append(f"error: {error}"))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.as_uri())
        # A gallery of postures does not move.
        self.page.wait_for_function("() => !moving || viewer.animator.time > 0.05")

    def seek(self, time: float) -> None:
        self.page.evaluate("(time) => seek(time)", time)
        self.settle()

    def settle(self) -> None:
        """Wait until the page has drawn what it was told."""
        self.page.evaluate(FRAMES)

    def show(self, visible: bool, *nodes: str) -> None:
        """Show or hide nodes of the scene."""
        for node in nodes:
            self.page.evaluate(
                "([node, on]) => { viewer.scene_tree.find([node]).object.visible = on }", [node, visible]
            )
        self.page.evaluate("viewer.set_dirty()")
        self.settle()

    def tick(self, entry: str) -> None:
        """Switch an entry of the legend by keyboard."""
        box = self.page.get_by_label(entry, exact=True)
        box.focus()
        box.press("Space")
        self.settle()

    def picture(self) -> np.ndarray:
        """The canvas alone, without words and controls."""
        self.page.add_style_tag(content=".card, .label { opacity: 0 } .dg { visibility: hidden !important }")
        return np.asarray(Image.open(io.BytesIO(self.page.screenshot())).convert("RGB"), dtype=int)


@pytest.fixture(scope="module")
def file(climb: xarray.Dataset, robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_replay_html(climb, robot, tmp_path_factory.mktemp("replay") / "viewer.html")


@pytest.fixture
def opened(browser: Any, file: Path) -> Iterator[Opened]:
    tab = Opened(browser, file)
    yield tab
    tab.page.close()


def corners_in_world(geometry: pin.GeometryObject, placement: pin.SE3) -> np.ndarray:
    """Corners of a geometry's own bounding box, by coal."""
    geometry.geometry.computeLocalAABB()
    box = geometry.geometry.aabb_local
    low, high = np.array(box.min_), np.array(box.max_)
    corners = np.array([[(low, high)[corner >> axis & 1][axis] for axis in range(3)] for corner in range(8)])
    return corners @ placement.rotation.T + placement.translation


def same_points(first: np.ndarray, second: np.ndarray) -> float:
    """Largest distance from a point of one set to the nearest of the other."""
    distance = np.linalg.norm(first[:, None] - second[None], axis=2)
    return float(max(distance.min(axis=0).max(), distance.min(axis=1).max()))


def changed(first: np.ndarray, second: np.ndarray, least: int = 24) -> np.ndarray:
    """Pixels that differ."""
    return np.abs(first - second).max(axis=2) > least


def test_page_loads_in_silence_and_offline(
    opened: Opened, file: Path, keep_picture: Callable[[Any, str], None]
) -> None:
    opened.seek(2.0)
    keep_picture(opened.page, "replay")
    assert opened.messages == []
    assert [url for url in opened.requests if not url.startswith(("data:", "blob:"))] == [file.as_uri()]


def test_canvas_shows_the_robot_and_it_moves(opened: Opened) -> None:
    opened.page.evaluate("overview()")
    opened.seek(0.5)
    before = opened.picture()
    opened.seek(3.5)
    after = opened.picture()
    opened.show(False, "robot")
    empty = opened.picture()
    assert len(np.unique(before.reshape(-1, 3), axis=0)) > 200
    robot_before = np.abs(before - empty).max(axis=2) > 60
    robot_after = np.abs(after - empty).max(axis=2) > 60
    # The comparison at the later time shows the robot's true pixels; those of the earlier time lie elsewhere.
    assert robot_after.sum() > 2000
    centre_before = np.argwhere(robot_before & ~robot_after).mean(axis=0)
    centre_after = np.argwhere(robot_after & ~robot_before).mean(axis=0)
    rows, columns = centre_after - centre_before
    assert columns > 30  # to the right
    assert rows < -30  # and up


def test_shapes_stand_where_pinocchio_puts_them(opened: Opened, climb: xarray.Dataset, robot: Robot) -> None:
    opened.seek(2.5)
    boxes = opened.page.evaluate(BOXES)
    data, visual_data = robot.model.createData(), robot.visual_model.createData()
    configuration = climb.configuration.sel(time=2.5, method="nearest").values
    pin.updateGeometryPlacements(robot.model, data, robot.visual_model, visual_data, configuration)
    for geometry, placement in zip(robot.visual_model.geometryObjects, visual_data.oMg, strict=True):
        shown = np.array(boxes[f"/robot/{robot.model.names[geometry.parentJoint]}/{geometry.name}"])
        assert same_points(shown, corners_in_world(geometry, placement)) < 1e-4, geometry.name


def test_every_kind_of_geometry_has_its_size_and_axes(
    browser: Any, climb: xarray.Dataset, robot: Robot, tmp_path: Path
) -> None:
    tetrahedron = coal.BVHModelOBBRSS()
    tetrahedron.beginModel(4, 4)
    vertices = np.array([[0.0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.1]])
    tetrahedron.addVertices(vertices)
    for corners in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)):
        tetrahedron.addTriangle(*(vertices[corner] for corner in corners))
    tetrahedron.endModel()
    shapes = {
        "box": coal.Box(0.1, 0.2, 0.3),
        "sphere": coal.Sphere(0.1),
        "ellipsoid": coal.Ellipsoid(0.1, 0.2, 0.3),
        "capsule": coal.Capsule(0.05, 0.3),
        "cylinder": coal.Cylinder(0.1, 0.3),
        "cone": coal.Cone(0.1, 0.3),
        "mesh": tetrahedron,
    }
    visual_model = pin.GeometryModel()
    for name, shape in shapes.items():
        placement = pin.SE3(pin.exp3(np.array([0.3, -0.5, 0.8])), np.array([0.1, 0.2, 0.3]))
        visual_model.addGeometryObject(pin.GeometryObject(name, 1, placement, shape))
    strange = dataclasses.replace(robot, visual_model=visual_model)
    tab = Opened(browser, write_replay_html(climb, strange, tmp_path / "viewer.html"))
    tab.seek(1.0)
    boxes = tab.page.evaluate(BOXES)
    assert tab.messages == []
    tab.page.close()
    data, visual_data = robot.model.createData(), visual_model.createData()
    configuration = climb.configuration.sel(time=1.0, method="nearest").values
    pin.updateGeometryPlacements(robot.model, data, visual_model, visual_data, configuration)
    for geometry, placement in zip(visual_model.geometryObjects, visual_data.oMg, strict=True):
        shown = np.array(boxes[f"/robot/{robot.model.names[1]}/{geometry.name}"])
        # A round body of flat faces reaches its true radius to within 1 - cos(pi / 28).
        assert same_points(shown, corners_in_world(geometry, placement)) < 3e-3, geometry.name
    # Wheels without a visual body of their own get a mark that shows them turn.
    assert sum(path.endswith("/spin_mark") for path in boxes) == len(robot.wheels)


def test_playback_pauses_scrubs_and_starts_over(opened: Opened) -> None:
    page = opened.page
    time = "() => viewer.animator.time"
    first = page.evaluate(time)
    page.wait_for_function(f"() => viewer.animator.time > {first} + 0.1")
    page.click("#play")
    paused = page.evaluate(time)
    opened.settle()
    assert page.evaluate(time) == paused
    assert page.get_attribute("#play", "aria-label") == "Play"
    height = "() => viewer.scene_tree.find(['robot', 'root_joint']).object.position.z"
    page.fill("#seek", "0")
    low = page.evaluate(height)
    page.fill("#seek", "3.5")
    assert page.evaluate(height) > low + 0.3
    assert page.evaluate(time) == pytest.approx(3.5)
    opened.settle()
    assert page.inner_text("#clock") == "3.50 / 4.00 s"
    page.click("#play")
    page.wait_for_function("() => viewer.animator.time < 1.0", timeout=10_000)
    assert page.evaluate("() => viewer.animator.playing")


def test_meshcat_controls_are_there_and_work(opened: Opened) -> None:
    page = opened.page
    page.click(".dg .close-button")  # they are folded away
    folder = page.locator(".dg li.cr.function", has_text="pause")
    folder.first.click()
    assert not page.evaluate("() => viewer.animator.playing")
    page.locator(".dg li.cr.function", has_text="play").first.click()
    assert page.evaluate("() => viewer.animator.playing")


def test_arrows_are_seen_and_idle_ones_are_not(opened: Opened, robot: Robot) -> None:
    opened.seek(2.0)
    with_arrows = opened.picture()
    opened.page.evaluate(
        "for (const one of ['thrust', 'contact']) viewer.scene_tree.find([one]).object.visible = false"
    )
    opened.page.evaluate("viewer.set_dirty()")
    opened.settle()
    without = opened.picture()
    drawn = with_arrows[np.abs(with_arrows - without).max(axis=2) > 40]
    for colour in ((0x00, 0x9E, 0x73), (0xCC, 0x79, 0xA7)):
        assert (np.abs(drawn - np.array(colour)).max(axis=1) < 12).sum() > 100


def test_every_entry_of_the_legend_switches_what_it_names(opened: Opened) -> None:
    page = opened.page
    opened.seek(2.0)
    boxes = page.locator("#legend input")
    names = [name.strip() for name in page.locator("#legend label").all_inner_texts()]
    assert len(names) == boxes.count() == 7
    before = [boxes.nth(order).is_checked() for order in range(7)]
    assert before == [name not in ("reduced model", "reference") for name in names]
    for name, shown in zip(names, before, strict=True):
        if name == "reference":  # where the robot is at its reference, the ghost gives way
            opened.seek(0.5)
        first = opened.picture()
        opened.tick(name)
        assert page.get_by_label(name, exact=True).is_checked() != shown
        second = opened.picture()
        assert changed(first, second).sum() > 60, name
        opened.tick(name)
        assert changed(first, opened.picture()).sum() < 20, name  # as before
    assert viewer_time(opened) == pytest.approx(0.5)  # the space bar meant the box, not the playback
    assert opened.messages == []


def viewer_time(opened: Opened) -> float:
    return float(opened.page.evaluate("viewer.animator.time"))


def test_cones_are_green_air_around_the_arrows(opened: Opened) -> None:
    opened.seek(2.0)
    with_cones = opened.picture()
    opened.tick("friction cone")
    without = opened.picture()
    seen = changed(with_cones, without, 8)
    assert seen.sum() > 4000
    # They colour what is behind and hide none of it: every pixel goes some way towards green.
    shift = (with_cones - without)[seen]
    assert (shift[:, 1] - shift[:, 0]).mean() > 15


def test_the_trail_grows(opened: Opened) -> None:
    opened.page.evaluate("overview()")
    drawn = []
    for time in (0.7, 2.0, 3.5):
        opened.seek(time)
        before = opened.picture()
        opened.tick("its trail")
        drawn.append(changed(before, opened.picture()).sum())
        opened.tick("its trail")
    assert drawn[0] < 0.5 * drawn[1] < 0.4 * drawn[2]


def test_the_reduced_model_and_the_reference_are_drawn_over_the_robot(
    opened: Opened, keep_picture: Callable[[Any, str], None]
) -> None:
    opened.seek(1.0)
    plain = opened.picture()
    opened.tick("reduced model")
    with_model = opened.picture()
    red = with_model[changed(plain, with_model)]
    assert (np.abs(red - [0xD0, 0x1C, 0x3F]).max(axis=1) < 16).sum() > 300
    opened.tick("reference")
    assert changed(with_model, opened.picture(), 8).sum() > 2000
    opened.page.add_style_tag(content=".card, .label { opacity: 1 }")
    keep_picture(opened.page, "replay_with_reduced_model")


def test_the_gallery_shows_every_posture(
    browser: Any, robot: Robot, tmp_path: Path, keep_picture: Callable[[Any, str], None]
) -> None:
    path = write_posture_html(robot, list(robot.postures), tmp_path / "gallery.html")
    tab = Opened(browser, path)
    tab.settle()
    keep_picture(tab.page, "gallery")
    assert tab.page.locator("#timeline").is_hidden()
    full = tab.picture()
    places = {}
    for order in range(len(robot.postures)):
        tab.show(False, f"posture_{order}")
        pixels = np.argwhere(changed(full, tab.picture(), 40))
        assert len(pixels) > 1500
        tab.show(True, f"posture_{order}")
        label = tab.page.locator(".label").nth(order)
        places[label.inner_text().splitlines()[0]] = (pixels.mean(axis=0), label.bounding_box())
    assert set(places) == {name.replace("_", " ") for name in robot.postures}
    for name, ((_, column), box) in places.items():
        assert 0.0 <= box["x"] <= 1280.0 - box["width"], name
        assert 0.0 <= box["y"] <= 800.0 - box["height"], name
        # Every robot stands above its own label; the shadow falls to the side.
        assert abs(box["x"] + 0.5 * box["width"] - column) < 70.0, name
    assert tab.messages == []
    tab.page.close()


def test_a_served_page_asks_for_nothing_else(browser: Any, robot: Robot) -> None:
    server = PageServer(posture_html(robot, ["mip"]))
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        tab = browser.new_page()
        asked: list[str] = []
        said: list[str] = []
        tab.on("request", lambda request: asked.append(request.url))
        tab.on("console", lambda message: said.append(message.text))
        tab.goto(server.url)
        tab.evaluate(FRAMES)
        assert said == []
        assert [url for url in asked if not url.startswith(("data:", "blob:"))] == [server.url]
        tab.close()
    finally:
        server.stop()
        thread.join(timeout=10)
    assert not thread.is_alive()


def test_following_keeps_the_robot_in_the_middle(opened: Opened) -> None:
    middle = """() => {
      const place = root_place().project(viewer.camera);
      return [place.x, place.y];
    }"""
    for time in (0.5, 3.5):
        opened.page.evaluate("if (!following) follow()")
        opened.seek(time)
        assert np.abs(opened.page.evaluate(middle)).max() < 0.05
    opened.page.evaluate("overview()")
    opened.seek(0.5)
    assert np.abs(opened.page.evaluate(middle)).max() > 0.1


def test_a_climb_shows_no_phases(opened: Opened) -> None:
    assert opened.page.locator("#phase").is_hidden()
    assert opened.page.locator("#phases").is_hidden()


def test_phases_are_named_as_they_play(browser: Any, mission_run: xarray.Dataset, robot: Robot, tmp_path: Path) -> None:
    tab = Opened(browser, write_replay_html(mission_run, robot, tmp_path / "viewer.html"))
    page = tab.page
    bars = page.locator("#phases button")
    phases = phases_of(mission_run)
    assert bars.count() == len(phases)
    for phase in phases:
        tab.seek(0.5 * (phase.start + phase.end))
        assert page.inner_text("#phase output") == phase.label
        assert page.locator("#phases [aria-current=true]").get_attribute("aria-label").startswith(phase.label)
    # Each bar is as long as its phase, and ends where the slider's thumb is at its end.
    boxes = [bars.nth(order).bounding_box() for order in range(len(phases))]
    track = boxes[-1]["x"] + boxes[-1]["width"] - boxes[0]["x"]
    for box, phase in zip(boxes, phases, strict=True):
        assert box["width"] / track == pytest.approx((phase.end - phase.start) / phases[-1].end, abs=0.01)
    bars.nth(3).click()
    tab.settle()
    assert page.evaluate("viewer.animator.time") == pytest.approx(phases[3].start, abs=1e-3)
    assert page.inner_text("#phase output") == "climb (MPC)"
    assert page.inner_text("#readouts dt:has-text('friction use') + dd") != "–"
    bars.nth(0).click()
    tab.settle()
    assert page.inner_text("#readouts dt:has-text('friction use') + dd") == "–"
    assert tab.messages == []
    page.close()


def test_page_fits_a_phone(browser: Any, file: Path) -> None:
    tab = Opened(browser, file, width=390, height=780)
    assert tab.page.locator("#legend input").first.is_hidden()
    tab.page.locator("#legend summary").focus()
    tab.page.keyboard.press("Enter")
    assert tab.page.locator("#legend input").first.is_visible()
    for card in ("#facts", "#legend", "#timeline"):
        box = tab.page.locator(card).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 390
        assert box["y"] + box["height"] <= 780
    assert tab.page.evaluate("() => document.documentElement.scrollWidth") <= 390
    assert tab.messages == []
    tab.page.close()
