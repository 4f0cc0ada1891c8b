"""The robot as a rover beside the robot on two wheels, on the same slopes: a table and a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.table import Table

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import ClimbResult
from m4_dynamics.simulation.rover import RoverOutcome, RoverRun
from m4_dynamics.view.ground import clip_profile
from m4_dynamics.view.render.camera import Camera
from m4_dynamics.view.render.picture import Frame, draw_picture
from m4_dynamics.view.render.solids import GroundSlab, RobotShapes, Solid
from m4_dynamics.view.style import COLOURS, INK, dress_axes, new_figure, save_figure, title_figure
from m4_dynamics.view.tables import make_table

__all__ = ["RoverComparison", "draw_rover_comparison", "rover_table", "write_rover_picture"]

_VIEW = (-0.42, -1.0, 0.36)
_LANE = 0.42  # [m] from the middle of the ramp to each robot
_HALF_WIDTH = 0.85  # [m] of the ramp
_LOW, _HIGH = -1.15, 2.0  # [m] of the ground along x, and along the ramp
_PANEL_WIDTH, _PLOT_HEIGHT = 4.6, 2.5  # [inch]
_DOTS_PER_INCH = 150
_OUTCOME_COLOURS = {
    RoverOutcome.CLIMBED: COLOURS["green"],
    RoverOutcome.SLIPPED: COLOURS["vermilion"],
    RoverOutcome.TIPPED: COLOURS["purple"],
    RoverOutcome.STALLED: COLOURS["slate"],
}


@dataclass(frozen=True, slots=True)
class RoverComparison:
    """A drive as a rover and, on the same ground, a climb on two wheels.

    Attributes:
        slope: Of the ground [rad].
        friction_static: mu_s of the ground.
        speed: At which the rover drives [m/s].
        rover: The drive.
        climb: The climb with thrust, or None where it was not tried.
    """

    slope: float
    friction_static: float
    speed: float
    rover: RoverRun
    climb: ClimbResult | None


def rover_table(comparisons: Sequence[RoverComparison]) -> Table:
    """A table of drives and climbs."""
    rows: list[list[object]] = []
    for one in comparisons:
        rover, climb = one.rover, one.climb
        rows.append(
            [
                round(math.degrees(one.slope), 6),
                one.friction_static,
                one.speed,
                rover.outcome.value,
                round(rover.climbed, 2),
                round(rover.rolled, 2),
                round(math.degrees(rover.limits.slipping), 1),
                round(math.degrees(rover.limits.tipping), 1),
                "-" if climb is None else climb.summary.verdict,
                "-" if climb is None or climb.summary.climbed_m is None else round(climb.summary.climbed_m, 2),
                "-" if climb is None or climb.summary.trim_thrust_N is None else round(climb.summary.trim_thrust_N, 1),
            ]
        )
    columns = (
        "slope deg",
        "mu_s",
        "rover m/s",
        "rover",
        "got up m",
        "wheels rolled m",
        "slips beyond deg",
        "tips beyond deg",
        "on two wheels",
        "climbed m",
        "thrust N",
    )
    return make_table("On four wheels without thrust, and on two wheels with it", columns, rows)


def write_rover_picture(comparisons: Sequence[RoverComparison], robot: Robot, path: Path | str) -> Path:
    """Write the picture of drives and climbs; see `draw_rover_comparison`."""
    return save_figure(draw_rover_comparison(comparisons, robot), path)


def draw_rover_comparison(comparisons: Sequence[RoverComparison], robot: Robot) -> Figure:
    """Draw, slope by slope, where the rover and the robot on two wheels get to.

    Args:
        comparisons: At least one. The first of each slope is shown on the ramp; ways are drawn for all.
        robot: The robot.

    Returns:
        The figure: above the robots on their ramp, the rover in front, below the ways up the slope.

    Raises:
        InvalidSettingError: There is nothing to compare.
    """
    slopes = list(dict.fromkeys(one.slope for one in comparisons))
    if not slopes:
        raise InvalidSettingError("comparisons", len(comparisons), "one at least")
    shapes, camera = RobotShapes(robot), Camera(_VIEW)
    scenes = [_scene(next(one for one in comparisons if one.slope == slope), shapes) for slope in slopes]
    seen = [
        camera.project(np.concatenate([*(s.corners.reshape(-1, 3) for s in solids), *_points(ground)]))
        for solids, ground in scenes
    ]
    # One scale for all; each panel is as high as the steepest slope needs.
    width = max(float(np.ptp(points[:, 0])) for points in seen) + 0.1
    height = max(float(np.ptp(points[:, 1])) for points in seen) + 0.1
    scene_height = _PANEL_WIDTH * height / width
    figure = new_figure(width=len(slopes) * _PANEL_WIDTH, height=scene_height + _PLOT_HEIGHT + 0.8)
    grid = figure.add_gridspec(2, len(slopes), height_ratios=[scene_height, _PLOT_HEIGHT])
    for column, (slope, (solids, ground), points) in enumerate(zip(slopes, scenes, seen, strict=True)):
        low = points.min(axis=0) - 0.05
        frame = Frame(float(low[0]), float(low[0]) + width, float(low[1]), float(low[1]) + height)
        axes = figure.add_subplot(grid[0, column])
        draw_picture(axes, solids, ground, camera, frame, resolution=_PANEL_WIDTH / width * _DOTS_PER_INCH)
        cases = [one for one in comparisons if one.slope == slope]
        axes.set_title(
            f"{math.degrees(slope):g}°, friction {cases[0].friction_static:g}", loc="left", size=11, color=INK
        )
        axes.text(1.0, 0.0, _verdicts(cases[0]), transform=axes.transAxes, size=9.5, color=INK, ha="right", va="bottom")
        _draw_ways(figure.add_subplot(grid[1, column]), cases, first=column == 0)
    limits = comparisons[0].rover.limits
    subtitle = (
        f"a rover with friction {comparisons[0].friction_static:g} slips beyond {math.degrees(limits.slipping):.1f}°; "
        f"with any friction it tips beyond {math.degrees(limits.tipping):.1f}°"
    )
    title_figure(figure, f"{robot.name}: on four wheels without thrust, and on two wheels with it", subtitle)
    return figure


def _scene(case: RoverComparison, shapes: RobotShapes) -> tuple[list[Solid], GroundSlab]:
    """Robots at the beginning and the end of their ways, the rover nearer to the viewer."""
    solids: list[Solid] = []
    for dataset, lane in ((case.rover.dataset, -_LANE), (None if case.climb is None else case.climb.dataset, _LANE)):
        if dataset is not None:
            for sample in (0, dataset.sizes["time"] - 1):
                solids += shapes.at(dataset["configuration"].values[sample], (0.0, lane, 0.0))
    terrain = case.rover.dataset
    profile = clip_profile(
        terrain["terrain_x"].values, terrain["terrain_z"].values, low=_LOW, high=_HIGH * math.cos(case.slope)
    )
    return solids, GroundSlab(profile, near=-_HALF_WIDTH, far=_HALF_WIDTH)


def _points(ground: GroundSlab) -> list[NDArray[np.float64]]:
    return [part.reshape(-1, 3) for part in ground.triangles()]


def _verdicts(case: RoverComparison) -> str:
    words = f"rover: {case.rover.outcome.value}"
    return words if case.climb is None else f"{words}\non two wheels, behind it: {case.climb.summary.verdict}"


def _draw_ways(axes: Axes, cases: Sequence[RoverComparison], *, first: bool) -> None:
    """Ways up the slope over the ways that the wheels rolled: who slips rolls on without getting on."""
    for order, case in enumerate(cases):
        dataset, colour = case.rover.dataset, _OUTCOME_COLOURS[case.rover.outcome]
        label = f"rover, friction {case.friction_static:g}, {case.speed:g} m/s: {case.rover.outcome.value}"
        axes.plot(dataset["way_rolled"].values, dataset["way_up_slope"].values, color=colour, linewidth=1.8,
                  linestyle=("-", "--", "-.", ":")[order % 4], label=label)  # fmt: skip
    case = cases[0]
    if case.climb is not None and case.climb.dataset is not None:
        climb = case.climb.dataset
        angle = climb["state_estimated"].values[:, 0]  # from the encoders
        rolled = float(climb.attrs["wheel_radius_m"]) * (angle - angle[0])
        label = f"on two wheels, friction {case.friction_static:g}: {case.climb.summary.verdict}"
        axes.plot(rolled, climb["travel"].values, color=COLOURS["blue"], linewidth=1.8, label=label)
    dress_axes(axes, title="Way up the slope", ylabel="from its foot [m]" if first else "",
               xlabel="way that the wheels rolled [m]")  # fmt: skip
    axes.set_xlim(-0.1, 3.0)
    axes.set_ylim(-0.6, 3.4)
    axes.legend(loc="upper right", fontsize=7.5, frameon=False)
