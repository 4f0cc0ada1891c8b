"""Take pictures of the browser's pages as the README shows them: a replay with the reduced model, and all postures.

python analysis/page_pictures.py runs/demo docs
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path

from m4_dynamics.errors import M4Error
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.simulation.trajectory import load_trajectory
from m4_dynamics.view.gallery import write_posture_html
from m4_dynamics.view.replay import write_replay_html

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# Software rendering, so that a machine without a screen takes the same pictures.
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
DRAWN = """() => new Promise((done) => {
  let left = 6;
  const next = () => (left-- ? requestAnimationFrame(next) : done());
  next();
})"""
NEARER = """(share) => {
  viewer.camera.position.sub(viewer.controls.target).multiplyScalar(share).add(viewer.controls.target);
  viewer.set_dirty();
}"""
LOWER = """(metres) => {
  for (const place of [viewer.camera.position, viewer.controls.target]) place.y -= metres;
  viewer.set_dirty();
}"""


def take_pictures(replay: Path, postures: Path, folder: Path, *, time: float) -> list[Path]:
    """Open the pages in a browser without a window and keep what it shows.

    Args:
        replay: A replay's page.
        postures: A page of postures.
        folder: Where to; it exists.
        time: Instant of the replay [s].

    Returns:
        The pictures.

    Raises:
        M4Error: There is no browser, or nothing to drive it with.
    """
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise M4Error("the pictures need the Python package playwright, which the extra 'test' brings") from None
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        raise M4Error(f"the pictures need a browser, but there is none of {', '.join(BROWSERS)}")
    taken = [folder / "viewer.png", folder / "postures.png"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        page = browser.new_page(viewport={"width": 1080, "height": 680})
        page.goto(replay.as_uri())
        page.wait_for_function("() => viewer.animator.time > 0")
        page.add_style_tag(content=".dg { visibility: hidden !important }")
        page.evaluate("(time) => { follow(); seek(time); }", time)
        page.get_by_label("reduced model").check()
        page.evaluate(NEARER, 0.76)
        page.evaluate(LOWER, -0.04)
        page.evaluate(DRAWN)
        page.evaluate("document.activeElement.blur()")
        page.screenshot(path=taken[0])
        page.set_viewport_size({"width": 1280, "height": 540})
        page.goto(postures.as_uri())
        page.add_style_tag(content=".card, .dg { visibility: hidden !important }")
        page.evaluate(NEARER, 0.80)
        page.evaluate(LOWER, 0.22)
        page.evaluate(DRAWN)
        page.screenshot(path=taken[1])
        browser.close()
    return taken


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of a run, with its trajectory.nc")
    parser.add_argument("out", type=Path, nargs="?", help="folder of the pictures (default: the run's)")
    parser.add_argument("--time", type=float, default=5.0, help="instant of the replay [s] (default: 5)")
    options = parser.parse_args()
    out = options.out or options.run
    try:
        robot = load_robot()
        with tempfile.TemporaryDirectory() as name:
            pages = Path(name)
            first = write_replay_html(load_trajectory(options.run), robot, pages / "replay.html")
            second = write_posture_html(robot, list(robot.postures), pages / "postures.html")
            out.mkdir(parents=True, exist_ok=True)
            for picture in take_pictures(first, second, out, time=options.time):
                print(f"wrote {picture}")
    except (M4Error, OSError) as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
