"""Pages inside another page, as a notebook shows them."""

from __future__ import annotations

import math
from typing import Any

from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import ClimbSettings, run_climb
from m4_dynamics.view.inline import InlineReplay, InlineReport


def test_replay_and_report_work_in_a_notebook(browser: Any, robot: Robot) -> None:
    settings = ClimbSettings(slope=math.radians(20.0), duration=4.0, ramp_time=1.0, hold_time=0.5)
    result = run_climb(robot, settings, warm_up=False)
    page = browser.new_page()
    messages: list[str] = []
    page.on("console", lambda message: messages.append(message.text))
    page.on("pageerror", lambda error: messages.append(str(error)))
    page.set_content(InlineReplay(result.dataset, robot)._repr_html_() + InlineReport(result, robot)._repr_html_())
    replay, report = (one.content_frame() for one in page.locator("iframe").element_handles())
    replay.wait_for_function("() => viewer.animator.time > 0.05")
    report.wait_for_selector("#panels svg path")
    assert "Climbed" in report.inner_text("#verdict").title()
    report.click("#start")
    report.wait_for_function("() => cursor > 0.05")  # the replay inside the report inside the page plays
    assert messages == []
    page.close()
