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
from m4_dynamics.simulation.verdict import Verdict
from m4_dynamics.view.map_page import write_map_page

SLOPES, THRUSTS, FRICTIONS = (10.0, 30.0, 50.0), (4.0, 16.0, 28.0, 40.0), (0.4, 0.8)


class Opened:
    """A page in the browser, with its errors and what it asked the network for."""

    def __init__(self, browser: Any, path: Path) -> None:
        self.problems: list[str] = []
        self.asked: list[str] = []
        self.page = browser.new_page(viewport={"width": 1200, "height": 950})
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on(
            "request", lambda asked: None if asked.url.startswith("file:") else self.problems.append(asked.url)
        )
        self.page.goto(path.as_uri())
        self.page.wait_for_selector(".plotly .heatmaplayer image")

    def require_quiet(self) -> None:
        """No error, and nothing asked of the network."""
        assert self.problems == []
        assert [url for url in self.asked if not url.startswith(("file:", "blob:", "data:"))] == []

    def slide_to(self, sheet: int) -> None:
        """Move the slider, and with it the sheet in sight, as its steps do."""
        self.page.evaluate(
            """async (k) => {
              const plot = document.querySelector('.js-plotly-plot');
              await Plotly.update(plot, plot.layout.sliders[0].steps[k].args[0], {'sliders[0].active': k});
            }""",
            sheet,
        )

    def click(self, x: float, y: float, cell: str) -> None:
        """Click a place on the axes as a hand does: plotly takes the cell that the pointer rests on."""
        self.page.mouse.move(*self.at(x, y))
        self.page.locator(".hovertext", has_text=cell).wait_for()
        self.page.mouse.click(*self.at(x, y))

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


def test_a_click_on_a_cell_gives_the_commands_for_its_replay(
    closed_loop: xarray.Dataset, browser: Any, tmp_path: Path
) -> None:
    opened = Opened(
        browser, write_map_page(closed_loop, tmp_path / "map.html", subject="'runs/my <b>map</b>' --robot a.toml")
    )
    page = opened.page
    assert page.get_by_text("Click a cell").count() == 1
    for slider in (0, 1):
        opened.slide_to(slider)
        page.mouse.move(5, 5)
        opened.click(31.0, 15.0, "slope 30.00 deg, thrust 16.00 N")
        page.wait_for_function(
            "(text) => document.querySelector('#cell').innerText.includes(text)",
            arg=f"30°, 16 N, μₛ {FRICTIONS[slider]:g}",
        )
        assert page.locator("#cell a").count() == 0
        said = [shlex.split(line) for line in page.locator("#cell code").all_inner_texts()]
        assert [words[:3] for words in said] == [["m4", "map", "replay"], ["m4", "view", "runs/my <b>map</b>"]]
        replay = build_parser("map").parse_args(said[0][1:])
        view = build_parser("view").parse_args(said[1][1:])
        assert replay.map == view.subject == Path("runs/my <b>map</b>")
        for parsed in (replay, view):
            assert parsed.robot == "a.toml"
            assert (parsed.slope, parsed.thrust, parsed.friction) == (pytest.approx(30.0), 16.0, FRICTIONS[slider])
    opened.require_quiet()


def test_of_several_starts_the_command_takes_the_one_that_ended_worst(
    closed_loop: xarray.Dataset, browser: Any, tmp_path: Path
) -> None:
    several = xarray.concat([closed_loop, closed_loop, closed_loop], "start", data_vars="minimal")
    several["verdict"][1, 1, 1] = [0, VERDICTS.index(Verdict.FELL), VERDICTS.index(Verdict.SLIPPED)]
    several["trim_pitch"][1, 2, 3] = np.nan
    opened = Opened(browser, write_map_page(several, tmp_path / "map.html", subject="runs/map"))
    opened.click(30.0, 16.0, "slope 30.00 deg, thrust 16.00 N")
    opened.page.get_by_text("--start 1").first.wait_for()
    opened.click(50.0, 40.0, "slope 50.00 deg, thrust 40.00 N")
    opened.page.get_by_text("there is nothing to replay").wait_for()
    assert opened.page.locator("#cell code").count() == 0
    opened.require_quiet()


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
