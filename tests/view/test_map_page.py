"""Pages of maps in a real browser, offline: hover values, slider, and the command that replays a cell."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

from m4_dynamics.cli.main import build_parser
from m4_dynamics.feasibility.attraction import (
    AttractionGrid,
    AttractionSettings,
    attraction_dataset,
    make_attraction_job,
)
from m4_dynamics.feasibility.cell import VERDICTS, RolloutSettings
from m4_dynamics.feasibility.closed_loop import closed_loop_dataset, make_job
from m4_dynamics.feasibility.grid import MapGrid
from m4_dynamics.feasibility.run import run_job
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.cell_reports import cell_folder, reports_beside
from m4_dynamics.view.map_page import write_map_page

SLOPES, THRUSTS, FRICTIONS = (10.0, 30.0, 50.0), (4.0, 16.0, 28.0, 40.0), (0.4, 0.8)


LOCAL = ("file:", "blob:", "data:")


class Opened:
    """A page in the browser, with its errors and what it asked the network for."""

    def __init__(self, browser: Any, path: Path) -> None:
        self.problems: list[str] = []
        self.page = browser.new_page(viewport={"width": 1200, "height": 950})
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("request", lambda asked: None if asked.url.startswith(LOCAL) else self.problems.append(asked.url))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector(".plotly .heatmaplayer image")

    def require_quiet(self) -> None:
        """No error, and nothing asked of the network."""
        assert self.problems == []

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Where a place on the axes is on the page."""
        return tuple(
            self.page.evaluate(
                """([x, y]) => {
                  const plot = document.querySelector('.js-plotly-plot'), box = plot.getBoundingClientRect();
                  const layout = plot._fullLayout;
                  return [box.left + layout.xaxis._offset + layout.xaxis.d2p(x),
                          box.top + layout.yaxis._offset + layout.yaxis.d2p(y)];
                }""",
                [x, y],
            )
        )


@pytest.fixture(scope="module")
def closed_loop(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> xarray.Dataset:
    grid = MapGrid(slope=np.radians(SLOPES), thrust=THRUSTS, friction=FRICTIONS)
    job = make_job(robot, grid, RolloutSettings(plant="mip"))
    return closed_loop_dataset(run_job(job, tmp_path_factory.mktemp("map") / "map.zarr", workers=0), job)


def test_a_click_on_a_cell_gives_the_command_for_its_replay(
    closed_loop: xarray.Dataset, browser: Any, tmp_path: Path
) -> None:
    opened = Opened(
        browser,
        write_map_page(closed_loop, tmp_path / "map.html", replay_arguments="'runs/my map' --robot a.toml"),
    )
    page = opened.page
    assert page.get_by_text("Click a cell").count() == 1
    said = []
    for slider in (0, 1):
        page.evaluate(
            "(k) => { Plotly.relayout(document.querySelector('.js-plotly-plot'), {'sliders[0].active': k}); }", slider
        )
        visible = page.evaluate("() => document.querySelector('.js-plotly-plot').layout.sliders[0].active")
        assert visible == slider
        page.mouse.click(*opened.at(31.0, 15.0))
        page.wait_for_selector("code")
        said += page.locator("code").all_inner_texts()
    opened.require_quiet()
    assert len(said) == 4
    for number, words in enumerate(map(shlex.split, said)):
        parsed = build_parser(words[1]).parse_args(words[1:])
        # First the command for a report, then the one to look at the cell.
        assert words[1:3] == ["map", "replay"] if number % 2 == 0 else words[1] == "view"
        assert (parsed.map if number % 2 == 0 else parsed.subject) == Path("runs/my map")
        assert parsed.robot == "a.toml"
        friction = FRICTIONS[number // 2]
        assert (parsed.slope, parsed.thrust, parsed.friction) == (pytest.approx(30.0), 16.0, friction)


def test_the_slider_shows_the_map_of_its_friction(closed_loop: xarray.Dataset, browser: Any, tmp_path: Path) -> None:
    opened = Opened(browser, write_map_page(closed_loop, tmp_path / "map.html"))
    page = opened.page
    assert page.get_by_text("Click a cell").count() == 0
    for m in range(len(FRICTIONS)):
        tick = page.locator(".slider-label", has_text=f"{FRICTIONS[m]:g}").last
        box = tick.bounding_box()
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] - 12)
        page.wait_for_function(f"() => document.querySelector('.js-plotly-plot').layout.sliders[0].active === {m}")
        worst = (
            closed_loop["verdict"]
            .isel(friction=m)
            .max("start")
            .sel(thrust=4.0, slope=math.radians(50.0), method="nearest")
        )
        page.mouse.move(*opened.at(50.0, 4.0))
        page.wait_for_selector(".hovertext")
        hover = page.locator(".hovertext").text_content()
        assert VERDICTS[int(worst)] in hover
        assert "slope 50.00 deg, thrust 4.00 N" in hover
        page.mouse.move(5, 5)
    opened.require_quiet()


def test_disagreements_are_marked(closed_loop: xarray.Dataset, browser: Any, tmp_path: Path) -> None:
    marked = closed_loop.copy(deep=True)
    marked["disagreement"][:] = 0
    marked["disagreement"][1, 2, 1] = 5
    page = Opened(browser, write_map_page(marked, tmp_path / "map.html")).page
    assert page.locator(".scatterlayer .point").count() == 1


def test_cells_with_reports_are_marked_and_lead_to_them(
    closed_loop: xarray.Dataset, browser: Any, tmp_path: Path
) -> None:
    cells = ((10.0, 4.0, 0.8), (30.0, 16.0, 0.4), (30.0, 16.0, 0.8))
    for slope, thrust, friction in cells:
        folder = tmp_path / cell_folder(math.radians(slope), thrust, friction, 0)
        folder.mkdir()
        (folder / "report.html").write_text(f"<title>{slope:g} {thrust:g} {friction:g}</title>", encoding="utf-8")
        (folder / "summary.json").write_text('{"verdict": "lagged"}' if friction == 0.8 else "{", encoding="utf-8")
    for name in ("cell-30-16-0.8-7", "cell-31-16-0.8-0", "cell-10-28-0.8-0"):  # no such start, no such cell, no report
        (tmp_path / name).mkdir()
    (tmp_path / "cell-30-16-0.8-7" / "report.html").write_text("", encoding="utf-8")
    (tmp_path / "cell-31-16-0.8-0" / "report.html").write_text("", encoding="utf-8")
    reports = reports_beside(closed_loop, tmp_path)
    assert {(round(math.degrees(one.slope), 9), one.thrust, one.friction) for one in reports} == set(cells)
    assert {one.friction: one.verdict for one in reports} == {0.4: "", 0.8: "lagged"}

    opened = Opened(browser, write_map_page(closed_loop, tmp_path / "map.html", replay_arguments="a", reports=reports))
    page = opened.page
    assert "there is a report" in page.locator("#words").inner_text()
    # With the friction 0.8 in sight two cells are marked; the disagreements have circles of their own.
    diamonds = "() => document.querySelectorAll('.scatterlayer .point[style*=\"rgb(31, 41, 51)\"]').length"
    assert page.evaluate(diamonds) == 2
    page.mouse.click(*opened.at(30.5, 15.5))
    anchor = page.locator("#cell a")
    anchor.wait_for()
    assert anchor.get_attribute("href") == "cell-30-16-0.8-0/report.html"
    assert page.locator("#cell code").all_inner_texts() == ["m4 view a --slope 30 --thrust 16 --friction 0.8"]
    listed = page.locator("#words details a")
    assert listed.count() == 3
    assert not listed.first.is_visible()
    page.locator("#words summary").focus()
    page.keyboard.press("Enter")
    assert listed.first.is_visible()
    anchor.click()
    page.wait_for_function("() => document.title === '30 16 0.8'")
    opened.require_quiet()


def test_a_region_of_attraction_has_a_page(robot: Robot, browser: Any, tmp_path: Path) -> None:
    grid = AttractionGrid((-0.3, 0.3), np.radians([-30.0, 0.0, 30.0]), np.radians([-100.0, 0.0, 100.0]))
    settings = AttractionSettings(slope=math.radians(30.0), plant="mip", duration=1.5)
    job = make_attraction_job(robot, grid, settings)
    dataset = attraction_dataset(run_job(job, tmp_path / "map.zarr", workers=0), job)
    opened = Opened(browser, write_map_page(dataset, tmp_path / "map.html"))
    opened.page.mouse.move(*opened.at(1.0, 2.0))
    opened.page.wait_for_selector(".hovertext")
    hover = opened.page.locator(".hovertext").text_content()
    assert "pitch 0.00 deg, pitch rate 0.00 deg/s" in hover
    assert "returned" in hover
    opened.require_quiet()
