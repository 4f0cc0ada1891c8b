"""The live view: it shows the run as it happens, changes nothing of it, and leaves nothing behind."""

from __future__ import annotations

import io
import math
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import ClimbResult, ClimbSettings, run_climb
from m4_dynamics.view.live import LiveView
from m4_dynamics.view.overlays import REDUCED_COLOUR

SETTINGS = ClimbSettings(slope=math.radians(30.0), duration=4.0, ramp_time=1.0, hold_time=0.5)


def is_open(url: str) -> bool:
    parts = urlsplit(url)
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex((parts.hostname, parts.port)) == 0


def picture(page: Any) -> np.ndarray:
    """The canvas with what is laid over it."""
    return np.asarray(Image.open(io.BytesIO(page.locator("#pane").screenshot())).convert("RGB"), dtype=int)


def count_pixels(pixels: np.ndarray, colour: str) -> int:
    wanted = [int(colour[first : first + 2], 16) for first in (1, 3, 5)]
    return int((np.abs(pixels - wanted).max(axis=2) < 12).sum())


def test_pixels_move_while_it_runs_and_the_run_stays_the_same(
    browser: Any, robot: Robot, keep_picture: Callable[[Any, str], None]
) -> None:
    plain = run_climb(robot, SETTINGS).dataset
    results: list[ClimbResult] = []
    messages: list[str] = []
    with LiveView(robot) as view:
        page = browser.new_page(viewport={"width": 900, "height": 640})
        page.on("console", lambda message: messages.append(message.text))
        page.on("pageerror", lambda error: messages.append(str(error)))
        page.on(
            "request", lambda asked: None if asked.url.startswith((view.url, "data:")) else messages.append(asked.url)
        )
        page.goto(view.url)
        assert view.wait_for_viewer(10.0)
        started = time.monotonic()
        runner = threading.Thread(
            target=lambda: results.append(run_climb(robot, SETTINGS, warm_up=False, observer=view.observe))
        )
        runner.start()
        page.wait_for_function("() => now > 0.5")
        before = picture(page)
        page.wait_for_function("() => now > 2.0")
        after = picture(page)
        told = page.locator("#readouts").inner_text()
        expected = r"time\s\d+\.\d\d s\sground\s30°\spitch\s-?\d+\.\d°\sthrust\s\d+\.\d N\sfriction use\s\d+ %"
        assert re.fullmatch(expected, told), told
        offered = page.locator("#legend li").all_inner_texts()
        assert [text.strip() for text in offered] == [
            "thrust on the robot", "ground on a wheel", "friction cone", "centre of mass", "its trail",
            "reduced model", "reference",
        ]  # fmt: skip
        for text in ("reduced model", "reference"):
            page.locator("#legend label", has_text=text).click()
        keep_picture(page, "live_view")
        with_it = count_pixels(picture(page), REDUCED_COLOUR)
        page.locator("#legend label", has_text="reduced model").click()
        assert count_pixels(picture(page), REDUCED_COLOUR) < 0.2 * with_it  # the legend hides it
        assert with_it > 100
        runner.join()
        elapsed = time.monotonic() - started
    page.wait_for_function("() => ended")
    page.close()
    assert messages == []
    assert not is_open(view.url)
    assert len(np.unique(after.reshape(-1, 3), axis=0)) > 200
    assert (np.abs(after - before).max(axis=2) > 40).sum() > 500
    assert elapsed >= SETTINGS.duration - 0.1  # the pace of real time
    (live,) = results
    assert plain is not None
    assert live.summary.verdict == "climbed"
    assert live.dataset is not None
    for name in set(plain.data_vars) - {"control_time"}:
        # The optimiser repeats to rounding, whether somebody watches or not.
        np.testing.assert_allclose(live.dataset[name].values, plain[name].values, atol=1e-6, err_msg=str(name))
    assert live.summary.real_time_factor is not None
    assert live.summary.real_time_factor > 2.0  # the simulation's own, not the show's


def test_a_port_that_is_taken_is_refused(robot: Robot) -> None:
    with LiveView(robot) as view:
        with pytest.raises(InvalidSettingError, match="free here"):
            LiveView(robot, port=int(urlsplit(view.url).port or 0))
        assert is_open(view.url)
    assert not is_open(view.url)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_nothing_is_left_when_the_command_is_stopped(tmp_path: Path, how: signal.Signals) -> None:
    arguments = ["wair", "--slope", "15", "--live", "--no-browser", "--duration", "60", "--out", str(tmp_path)]
    command = subprocess.Popen(
        [sys.executable, "-m", "m4_dynamics.cli.main", *arguments],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env={**os.environ, "DISPLAY": ""},
    )  # fmt: skip
    try:
        assert command.stderr is not None
        found = re.search(r"http://127\.0\.0\.1:\d+/", command.stderr.readline())
        assert found
        assert is_open(found.group())
        time.sleep(1.5)
        command.send_signal(how)
        command.wait(timeout=60)
    finally:
        command.kill()
        command.wait()
        command.stderr.close()
    assert not is_open(found.group())
