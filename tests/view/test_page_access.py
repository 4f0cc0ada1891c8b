"""Pages for everybody, measured in a browser: contrast, words for pictures, the keyboard, a phone's width.

Contrast is the one of WCAG 2: of every visible text against what lies behind it, at least 4.5 : 1, of large text 3 : 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import xarray

from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.replay import write_replay_html
from m4_dynamics.view.report import FigureTable, report_html

SUMMARY = {
    "verdict": "slipped",
    "reason": "a wheel slid for 0.3 s",
    "slope_deg": 45.0,
    "friction_static": 0.8,
    "controller": "default",
    "remarks": ["the thrust was at its bound"],
}
TABLE = FigureTable(
    "Figures", ("figure", "value", "unit", "limit"),
    (("pitch RMS", "0.3", "deg", "<= 1"), ("fastest slip", "9", "mm/s", "<= 5"), ("thrust", "14", "N", "")),
    (True, False, None),
)  # fmt: skip
SCHEMES = ("light", "dark")

#: Texts with too little contrast. Behind see-through cards may lie anything that the 3D scene shows: each text is held
#: against the backdrops given, and its worst contrast counts.
LOW_CONTRAST = """(backdrops) => {
  // Colours of every notation, color(srgb ...) among them, by what a canvas makes of them.
  const pixel = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  const parse = (text) => {
    pixel.clearRect(0, 0, 1, 1);
    pixel.fillStyle = text;
    pixel.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = pixel.getImageData(0, 0, 1, 1).data;
    return [r, g, b, a / 255];
  };
  const over = ([r, g, b, a], behind) => [r, g, b].map((one, k) => a * one + (1 - a) * behind[k]);
  const linear = (one) => (one / 255 <= 0.04045 ? one / 255 / 12.92 : ((one / 255 + 0.055) / 1.055) ** 2.4);
  const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  const ratio = (one, other) => {
    const [low, high] = [luminance(one), luminance(other)].sort((a, b) => a - b);
    return (high + 0.05) / (low + 0.05);
  };
  // What a gradient's stops are drawn over counts too: each stop is one more backdrop.
  const behind = (element) => {
    const layers = [];
    for (let at = element; at; at = at.parentElement) {
      layers.unshift(getComputedStyle(at));
      if (at.matches(".card, .label")) break; // it floats over the scene, which hides the page's own ground
    }
    let grounds = backdrops.map(parse);
    for (const style of layers) {
      const colour = parse(style.backgroundColor);
      grounds = grounds.map((ground) => over(colour, ground));
      const stops = style.backgroundImage.match(/rgba?\\([^)]*\\)/g);
      if (stops) grounds = stops.flatMap((stop) => grounds.map((ground) => over(parse(stop), ground)));
    }
    return grounds;
  };
  const opacity = (element) => {
    let product = 1;
    for (let at = element; at; at = at.parentElement) product *= Number(getComputedStyle(at).opacity);
    return product;
  };
  const found = [];
  let count = 0;
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.textContent.trim();
    const element = walker.currentNode.parentElement;
    if (!text || element.closest("script, style, noscript")) continue;
    const box = element.getBoundingClientRect();
    if (box.width < 2 || !element.checkVisibility({ visibilityProperty: true, opacityProperty: true })) continue;
    count += 1;
    const style = getComputedStyle(element);
    const colour = parse(element instanceof SVGElement ? style.fill : style.color);
    colour[3] *= opacity(element);
    const size = parseFloat(style.fontSize);
    const least = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700) ? 3 : 4.5;
    const worst = Math.min(...behind(element).map((ground) => ratio(over(colour, ground), ground)));
    if (worst < least) found.push(`${worst.toFixed(2)} of ${least}: ${text.slice(0, 40)} (${element.tagName})`);
  }
  return { count, found };
}"""

#: Pictures that say nothing to those who cannot see them.
WORDLESS = """() => [...document.querySelectorAll("img, svg, canvas, iframe")].filter((one) => {
  if (!one.checkVisibility() || one.closest("[aria-hidden=true]")) return false;
  const named = (at) => at.getAttribute("aria-label") || at.getAttribute("alt") || at.getAttribute("title");
  // A canvas may be named by the element that stands for it, if that says that it is a picture.
  const stand_in = one.closest("[role=img], [role=application]");
  return !(named(one) || (stand_in && named(stand_in)));
}).map((one) => one.outerHTML.slice(0, 120))"""

#: Controls without a name, by the markup.
NAMELESS = """() => [...document.querySelectorAll("button, a, input, select, summary, [tabindex]")].filter((one) =>
  one.checkVisibility() && !one.closest(".dg") && !(one.innerText || "").trim() && !one.getAttribute("aria-label")
  && !one.getAttribute("aria-labelledby") && !(one.labels && one.labels.length)
).map((one) => one.outerHTML.slice(0, 120))"""

#: Marks everything that can be clicked, with a number.
CLICKABLE = """() => {
  const all = [...document.querySelectorAll("button, a[href], input, select, summary, [tabindex='0']")].filter(
    (one) => one.checkVisibility({ visibilityProperty: true }) && !one.disabled && !one.closest(".dg"));
  all.forEach((one, k) => { one.dataset.stop = k; });
  // Whatever else invites a click: a pointing hand that no such element, nor its label, explains.
  const invites = [...document.body.querySelectorAll("*")].filter((one) =>
    one.checkVisibility() && getComputedStyle(one).cursor === "pointer" && !one.closest(".dg")
    && !one.closest("button, a[href], input, select, summary, label, [tabindex='0']"));
  return { count: all.length, others: invites.map((one) => one.outerHTML.slice(0, 120)) };
}"""

#: Where the focus is, and whether it shows: an outline of at least 2 px.
FOCUSED = """() => {
  const one = document.activeElement;
  const style = getComputedStyle(one);
  return { stop: one.dataset.stop ?? null,
           shows: style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 2 };
}"""


@pytest.fixture(scope="module")
def files(climb: xarray.Dataset, robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    page = report_html(climb, SUMMARY, robot, table=TABLE, command="m4 wair", replay="<p>the replay</p>")
    (folder / "report.html").write_text(page, encoding="utf-8")
    return {"report": folder / "report.html", "replay": write_replay_html(climb, robot, folder / "viewer.html")}


@pytest.fixture(scope="module")
def mission_files(
    mission_run: xarray.Dataset, robot: Robot, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("mission-pages")
    page = report_html(mission_run, {**SUMMARY, "mission": "short", "verdict": "completed"}, robot, table=TABLE)
    (folder / "report.html").write_text(page, encoding="utf-8")
    return {"report": folder / "report.html", "replay": write_replay_html(mission_run, robot, folder / "viewer.html")}


READY = {"report": "#panels svg path", "replay": "#readouts dd:not(:empty)"}
#: What a page may have behind what it draws itself: for the 3D scene's cards the worst there can be.
BACKDROPS = {"report": ["white"], "replay": ["black", "#4a545e", "white"]}


@pytest.fixture
def show(browser: Any) -> Iterator[Any]:
    """Opens a page, in a colour scheme and size."""
    contexts = []

    def opened(kind: str, file: Path, *, scheme: str = "light", width: int = 1280, height: int = 800) -> Any:
        # Nothing moves, so that the page is measured rather than a moment of it.
        contexts.append(
            browser.new_context(
                color_scheme=scheme, viewport={"width": width, "height": height}, reduced_motion="reduce"
            )
        )
        page = contexts[-1].new_page()
        page.goto(file.as_uri())
        page.wait_for_selector(READY[kind])
        return page

    yield opened
    for context in contexts:
        context.close()


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("kind", READY)
def test_every_text_stands_out_from_its_ground(
    show: Any, files: dict[str, Path], mission_files: dict[str, Path], kind: str, scheme: str
) -> None:
    for some in (files, mission_files):
        page = show(kind, some[kind], scheme=scheme)
        measured = page.evaluate(LOW_CONTRAST, BACKDROPS[kind])
        assert measured["count"] > 30
        assert measured["found"] == []
    # The measure itself can fail.
    page.evaluate("document.querySelector('h1').style.opacity = 0.3")
    (low,) = page.evaluate(LOW_CONTRAST, BACKDROPS[kind])["found"]
    assert low.endswith("(H1)")


@pytest.mark.parametrize("kind", READY)
def test_pictures_and_controls_have_words(show: Any, mission_files: dict[str, Path], kind: str) -> None:
    page = show(kind, mission_files[kind])
    assert page.evaluate(WORDLESS) == []
    assert page.evaluate(NAMELESS) == []
    page.evaluate("document.body.append(document.createElement('button'), document.createElement('canvas'))")
    assert len(page.evaluate(WORDLESS)) == len(page.evaluate(NAMELESS)) == 1


@pytest.mark.parametrize("kind", READY)
def test_everything_that_can_be_clicked_is_reached_by_keyboard_and_shows_it(
    show: Any, mission_files: dict[str, Path], kind: str
) -> None:
    page = show(kind, mission_files[kind])
    clickable = page.evaluate(CLICKABLE)
    assert clickable["count"] >= 10
    assert clickable["others"] == []
    reached = set()
    # Once around; meshcat's own controls may come in between.
    for _ in range(2 * clickable["count"] + 40):
        page.keyboard.press("Tab")
        focus = page.evaluate(FOCUSED)
        if focus["stop"] is not None:
            assert focus["shows"], page.evaluate("document.activeElement.outerHTML.slice(0, 120)")
            reached.add(int(focus["stop"]))
        if len(reached) == clickable["count"]:
            break
    missed = sorted(set(range(clickable["count"])) - reached)
    assert [
        page.evaluate(f"document.querySelector('[data-stop=\"{k}\"]').outerHTML.slice(0, 120)") for k in missed
    ] == []


@pytest.mark.parametrize("kind", READY)
def test_nothing_is_cut_off_on_a_phone(show: Any, mission_files: dict[str, Path], kind: str) -> None:
    page = show(kind, mission_files[kind], width=390, height=844)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    cards = page.evaluate(
        "() => [...document.querySelectorAll('header, main, .card')].filter((one) => one.checkVisibility())"
        ".map((one) => one.getBoundingClientRect()).map((box) => [box.left, box.right])"
    )
    assert cards
    assert all(left >= 0 and right <= 390 for left, right in cards)
