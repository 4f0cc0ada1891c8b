"""Pages inside a notebook: the replay and the report of a run as objects that a notebook shows by themselves."""

from __future__ import annotations

import html
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.replay import replay_html
from m4_dynamics.view.report import climb_figures, report_html

if TYPE_CHECKING:
    import xarray

    from m4_dynamics.simulation.climb import ClimbResult

__all__ = ["InlineReplay", "InlineReport"]


@dataclass(frozen=True, slots=True, eq=False)
class InlineReplay:
    """The 3D replay of a run.

    Attributes:
        dataset: A trajectory.
        robot: The robot that made it.
        height: Of the frame in the notebook [px].
    """

    dataset: xarray.Dataset = field(repr=False)
    robot: Robot = field(repr=False)
    height: int = 520

    def _repr_html_(self) -> str:
        return _framed(replay_html(self.dataset, self.robot), "3D replay of the run", self.height)


@dataclass(frozen=True, slots=True, eq=False)
class InlineReport:
    """The report of a climb: verdict, figures, plots and replay.

    Attributes:
        result: What `run_climb` gave.
        robot: The robot.
        height: Of the frame in the notebook [px].
    """

    result: ClimbResult = field(repr=False)
    robot: Robot = field(repr=False)
    height: int = 800

    def _repr_html_(self) -> str:
        dataset, summary = self.result.dataset, self.result.summary
        replay = replay_html(dataset, self.robot) if dataset is not None else None
        page = report_html(dataset, summary.as_dict(), self.robot, table=climb_figures(summary), replay=replay)
        return _framed(page, "Report of the run", self.height)


def _framed(page: str, title: str, height: int) -> str:
    """A page in a frame of its own, so that its style and script are nobody else's."""
    return (
        f'<iframe title="{html.escape(title)}" srcdoc="{html.escape(page)}" '
        f'style="width: 100%; height: {height}px; border: 0"></iframe>'
    )
