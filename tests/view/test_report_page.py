"""The report of a run, in a real browser and offline."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from PIL import Image

from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.phases import phases_of
from m4_dynamics.view.replay import replay_html
from m4_dynamics.view.report import FigureTable, meets, report_html

SUMMARY = {
    "verdict": "climbed",
    "reason": "it climbed 0.9 m",
    "slope_deg": 45.0,
    "friction_static": 0.8,
    "remarks": ["an angle < 3 & more"],
}
TABLE = FigureTable(
    "Figures", ("figure", "value", "unit", "limit"),
    (("pitch RMS", "0.3", "deg", "<= 1"), ("fastest slip", "9", "mm/s", "<= 5"), ("thrust", "14", "N", "")),
    (True, False, None),
)  # fmt: skip


@pytest.fixture(scope="module")
def file(climb: xarray.Dataset, robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    page = report_html(
        climb, SUMMARY, robot, table=TABLE, command="m4 wair --slope 45", replay=replay_html(climb, robot)
    )
    path.write_text(page, encoding="utf-8")
    return path


def opened(browser: Any, file: Path, width: int, height: int) -> tuple[Any, list[str], list[str]]:
    page = browser.new_page(viewport={"width": width, "height": height})
    messages: list[str] = []
    requests: list[str] = []
    page.on("console", lambda message: messages.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: messages.append(f"error: {error}"))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(file.as_uri())
    page.wait_for_selector("#panels svg path")
    return page, messages, requests


@pytest.mark.parametrize(
    ("value", "limit", "met"),
    [(0.9, "< 1", True), (1.0, "< 1", False), (5.0, "<= 5", True), (0, "> 0", False), (30.0, ">= 25", True),
     (0, "0", True), (2, "0", False), (0.7, "mu_s 0.8", True), (0.9, "mu_s 0.8", False), (1.8, "goal 1.80", None),
     (None, "< 1", None), (1.0, "", None), ("17 / 90", "< 1", None)],
)  # fmt: skip
def test_limits_are_judged(value: object, limit: str, met: bool | None) -> None:
    assert meets(value, limit) is met


def test_same_run_gives_the_same_page_and_it_is_light(climb: xarray.Dataset, robot: Robot, file: Path) -> None:
    page = report_html(
        climb, SUMMARY, robot, table=TABLE, command="m4 wair --slope 45", replay=replay_html(climb, robot)
    )
    assert page == file.read_text("utf-8")
    assert len(page) < 1_000_000


def test_a_run_that_never_started_has_a_report_too(browser: Any, robot: Robot, tmp_path: Path) -> None:
    file = tmp_path / "report.html"
    summary = {**SUMMARY, "verdict": "infeasible", "reason": "no equilibrium"}
    file.write_text(report_html(None, summary, robot, table=TABLE), encoding="utf-8")
    page = browser.new_page()
    page.goto(file.as_uri())
    assert page.inner_text("#verdict").lower().startswith("infeasible no equilibrium.")
    assert page.locator("#plots").is_hidden()
    assert page.locator("#watch").is_hidden()
    page.close()


def test_plots_replay_and_links_between_them(
    browser: Any, climb: xarray.Dataset, file: Path, keep_picture: Callable[[Any, str], None]
) -> None:
    page, messages, requests = opened(browser, file, 1280, 800)
    assert "An angle < 3 & more." in page.inner_text("#verdict")
    assert [row.inner_text() for row in page.locator("tbody td:last-child").all()] == ["✓ met", "✗ missed", ""]
    assert page.locator("#panels svg").count() >= 8
    # The value under the cursor is the trajectory's.
    pitch = page.locator("figure", has_text="Pitch [°]")
    pitch.locator("svg").focus()
    page.keyboard.press("Home")
    start = float(pitch.locator("output").first.inner_text().replace("−", "-"))
    assert start == pytest.approx(np.degrees(float(climb.state[0, 1])), rel=1e-3)
    # Dragging zooms all panels, a double click undoes it.
    box = pitch.locator("svg").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 150, box["y"] + 80)
    page.mouse.down()
    page.mouse.move(box["x"] + 250, box["y"] + 80, steps=3)
    page.mouse.up()
    low, high = page.evaluate("shown")
    assert 0.0 < low < high < 3.9
    pitch.locator("svg").dblclick()
    assert page.evaluate("shown") == [0.0, pytest.approx(4.0)]
    # The replay starts on demand, is not blank, and goes where the cursor is.
    assert page.locator("iframe").count() == 0
    page.click("#start")
    replay = page.locator("iframe").element_handle().content_frame()
    replay.wait_for_function("() => viewer.animator.time > 0.05")
    picture = np.asarray(Image.open(io.BytesIO(page.locator("#stage").screenshot())).convert("RGB"))
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 200
    page.wait_for_function("() => cursor > 0.05")  # which the playing replay has moved
    replay.evaluate("animator.pause()")
    pitch.locator("svg").focus()
    page.keyboard.press("End")
    replay.wait_for_function("() => viewer.animator.time > 3.9")
    keep_picture(page, "report")
    assert messages == []
    assert [url for url in requests if not url.startswith(("data:", "blob:", "about:"))] == [file.as_uri()]
    page.close()


def test_report_fits_a_phone(browser: Any, file: Path, keep_picture: Callable[[Any, str], None]) -> None:
    page, messages, _ = opened(browser, file, 390, 780)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    keep_picture(page, "report_on_a_phone")
    assert messages == []
    page.close()


def test_phases_stand_behind_the_curves(
    browser: Any, mission_run: xarray.Dataset, robot: Robot, tmp_path: Path
) -> None:
    file = tmp_path / "report.html"
    summary = {**SUMMARY, "mission": "short"}
    file.write_text(report_html(mission_run, summary, robot, table=TABLE), encoding="utf-8")
    page, messages, _ = opened(browser, file, 1280, 800)
    phases = phases_of(mission_run)
    assert [one.inner_text() for one in page.locator("#phases button").all()] == [one.label for one in phases]
    assert page.locator("figure", has_text="Solver time").count() == 1
    page.locator("#phases button").nth(3).click()
    low, high = page.evaluate("shown")
    assert low == pytest.approx(phases[3].start, abs=1e-3)
    assert high == pytest.approx(phases[3].end, abs=1e-3)
    assert phases[3].label in page.inner_text("#clock")
    assert messages == []
    page.close()
