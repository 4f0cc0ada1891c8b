"""Find what morphing buys: legs' angles and thrust chosen together for the least friction on a slope.

The rear legs carry the robot, the front ones its thrusters. Turning either moves the CoM, the point where the thrust
acts and the direction of the thrust against the line from axle to CoM. Postures in which bodies overlap are left out,
and so are equilibria in which the body or a leg touches the ground.

python analysis/morphing.py --slope 60 --out runs/analysis
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from m4_dynamics.errors import M4Error
from m4_dynamics.feasibility.curves import map_curves
from m4_dynamics.feasibility.grid import MapGrid
from m4_dynamics.feasibility.postures import posture_case, posture_configuration
from m4_dynamics.feasibility.static import static_map
from m4_dynamics.reduced.reduction import Reduction, configuration_on_slope, reduce_robot
from m4_dynamics.reduced.trim import Trim, select_trim
from m4_dynamics.reduced.trim_limits import TrimLimits
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.silhouette import outlines_at
from m4_dynamics.view.style import COLOURS, dress_axes, new_figure, save_figure, title_figure

REAR = ("rear_left_hip_sagittal", "rear_right_hip_sagittal")
METRES_PER_NEWTON = 0.006
FRONT = ("front_left_hip_sagittal", "front_right_hip_sagittal")


class Candidate(NamedTuple):
    """A posture and what it needs on the slope; angles in degrees."""

    rear: float
    front: float
    friction: float
    thrust: float
    collides: bool


def angles(rear: float, front: float) -> dict[str, float]:
    """Joint angles of a candidate [rad]."""
    return {**dict.fromkeys(REAR, math.radians(rear)), **dict.fromkeys(FRONT, math.radians(front))}


def judge(robot: Robot, slope: float, rear: float, front: float) -> Candidate:
    """Least friction of a posture with the best thrust; infinite if no equilibrium keeps the other limits."""
    reduction = reduce_robot(robot, configuration=posture_configuration(robot, angles(rear, front)))
    case = posture_case(robot, reduction)
    grid = MapGrid(slope=slope, thrust=np.linspace(0.0, reduction.thrust_max, 217), friction=1.0)
    curves = map_curves(static_map([case], grid)).squeeze()
    friction, thrust = float(curves["least_friction"]), float(curves["thrust_of_least_friction"])
    return Candidate(rear, front, friction if math.isfinite(friction) else math.inf, thrust, case.collides)


def steepest_slope(robot: Robot, friction: float, rear: float, front: float) -> float:
    """Steepest slope of a posture with the best thrust [deg]."""
    reduction = reduce_robot(robot, configuration=posture_configuration(robot, angles(rear, front)))
    thrust = np.linspace(0.0, reduction.thrust_max, 433)
    grid = MapGrid(slope=np.radians(np.linspace(0.0, 89.0, 891)), thrust=thrust, friction=friction)
    curves = map_curves(static_map([posture_case(robot, reduction)], grid))
    return math.degrees(float(curves["steepest_slope_best_thrust"].squeeze()))


def stand(robot: Robot, slope: float, one: Candidate) -> tuple[Reduction, Trim]:
    """The robot in a posture, standing where it needs the least friction."""
    reduction = reduce_robot(robot, configuration=posture_configuration(robot, angles(one.rear, one.front)))
    limits = reduction.trim_limits(friction_static=5.0)
    return reduction, select_trim(reduction.parameters, slope, limits=limits, criterion="least-friction")


def draw_robot(axes: Axes, robot: Robot, slope: float, one: Candidate, friction: float, title: str) -> None:
    """Draw the robot on the slope from the side, with CoM, thrust, ground force and friction cone."""
    reduction, trim = stand(robot, slope, one)
    pendulum = reduction.parameters
    q = configuration_on_slope(robot, reduction, slope=slope, pitch=trim.pitch)
    for layer, outline in enumerate(outlines_at(robot, q)):
        for polygon in outline.polygons:
            body = Polygon(polygon, facecolor=outline.colour, edgecolor=COLOURS["ink"], linewidth=0.5, zorder=2 + layer)
            axes.add_patch(body)
    ends = np.array([-1.2, 1.2])
    line = [ends * math.cos(slope), ends * math.sin(slope)]
    axes.fill_between(*line, -1.5, color=COLOURS["mist"], alpha=0.6, linewidth=0, zorder=0)
    axes.plot(*line, color=COLOURS["ink"], linewidth=1.5, zorder=1)
    contact = np.zeros(2)
    for side in (-1.0, 1.0):
        edge = slope + math.pi / 2.0 + side * math.atan(friction)
        axes.plot([0.0, 0.45 * math.cos(edge)], [0.0, 0.45 * math.sin(edge)], "--", color=COLOURS["green"], zorder=90)
    turn = np.array([[math.cos(trim.pitch), math.sin(trim.pitch)], [-math.sin(trim.pitch), math.cos(trim.pitch)]])
    axle = pendulum.wheel_radius * np.array([-math.sin(slope), math.cos(slope)])
    along, normal = np.array([math.cos(slope), math.sin(slope)]), np.array([-math.sin(slope), math.cos(slope)])
    ground = trim.friction_force * along + trim.normal_force * normal
    com = axle + pendulum.mass_body / pendulum.mass * (turn @ pendulum.com_in_body)
    for place, force, colour in (
        (axle + turn @ pendulum.thrust_point_in_body, trim.thrust * turn[:, 0], "vermilion"),
        (contact, ground, "green"),
        (com, pendulum.weight * np.array([0.0, -1.0]), "blue"),
    ):
        arrow = {"arrowstyle": "-|>", "color": COLOURS[colour], "linewidth": 2.0, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", place + METRES_PER_NEWTON * force, place, arrowprops=arrow, zorder=95)
    axes.plot(*com, marker="o", markersize=5, color=COLOURS["blue"], zorder=96)
    axes.set(xlim=(-0.85, 0.25), ylim=(-0.25, 0.8), aspect="equal")
    colours = f"red: thrust\nblue: weight\ngreen: ground force,\nfriction cone of {friction:g}"
    axes.text(0.02, 0.02, colours, transform=axes.transAxes, va="bottom", size=8.5, color=COLOURS["slate"])
    facts = f"{title}: needs {trim.friction_needed:.2f}, thrust {trim.thrust:.0f} N"
    dress_axes(axes, title=facts, xlabel="x [m]", ylabel="z [m]")
    axes.grid(False)


def main() -> None:
    """Search, draw, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slope", type=float, default=60.0, help="slope [deg] (default: 60)")
    parser.add_argument("--friction", type=float, default=0.8, help="static friction (default: 0.8)")
    parser.add_argument("--step", type=float, default=20.0, help="of the first search [deg] (default: 20)")
    parser.add_argument("--out", type=Path, default=Path("runs/analysis"), help="folder of the picture")
    options = parser.parse_args()
    slope = math.radians(options.slope)
    try:
        robot = load_robot()
        limit = math.floor(math.degrees(robot.model.upperPositionLimit[robot.servo(REAR[0]).index_q]))
        nominal_q = robot.posture(robot.require_balance().posture).configuration
        nominal_rear, nominal_front = (
            round(math.degrees(nominal_q[robot.servo(group[0]).index_q]), 1) for group in (REAR, FRONT)
        )
        tried: dict[tuple[float, float], Candidate] = {}

        def look(rear: float, front: float) -> Candidate:
            key = (min(max(rear, -limit), limit), min(max(front, -limit), limit))
            if key not in tried:
                tried[key] = judge(robot, slope, *key)
            return tried[key]

        nominal = look(nominal_rear, nominal_front)
        coarse = np.arange(-limit, limit + 0.5, options.step)
        best = min((look(float(r), float(f)) for r in coarse for f in coarse), key=lambda one: one.friction)
        rear_alone = min((look(float(r), nominal_front) for r in range(40, limit + 1, 5)), key=lambda one: one.friction)
        step = 0.5 * options.step
        while step >= 0.5:
            around = [look(best.rear + i * step, best.front + j * step) for i in (-1, 0, 1) for j in (-1, 0, 1)]
            better = min(around, key=lambda one: one.friction)
            if better.friction >= best.friction - 1e-9:
                step *= 0.5
            best = min(best, better, key=lambda one: one.friction)
        rows = [("as described", nominal), ("rear legs alone", rear_alone), ("both pairs of legs", best)]
        steepest = [steepest_slope(robot, options.friction, one.rear, one.front) for _, one in rows]
        trims = [stand(robot, slope, one)[1] for _, one in rows]
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")

    print(
        f"{len(tried)} postures; angles in deg, friction needed on {options.slope:g} deg, clearance of the legs in cm"
    )
    print(
        "posture              rear   front  friction  thrust [N]  pitch  clearance"
        f"  steepest slope at {options.friction:g} [deg]"
    )
    for (name, one), trim, angle in zip(rows, trims, steepest, strict=True):
        clearance = 100.0 * (trim.margins.clearance + TrimLimits().clearance_min)
        print(
            f"{name:18}  {one.rear:5.1f}  {one.front:6.1f}  {trim.friction_needed:8.3f}  {trim.thrust:10.1f}"
            f"  {math.degrees(trim.pitch):5.1f}  {clearance:9.1f}  {angle:10.1f}"
        )

    figure = new_figure(width=14.0, height=5.2)
    chart, before, after = figure.subplots(1, 3)
    searched = [one for one in tried.values() if math.isfinite(one.friction)]
    shade = chart.scatter(
        [one.rear for one in searched],
        [one.front for one in searched],
        c=[one.friction for one in searched],
        cmap="viridis_r",
        s=34,
    )
    collided = [one for one in tried.values() if one.collides]
    for group, marks in (
        (collided, {"marker": "x", "markersize": 4, "color": COLOURS["slate"], "label": "bodies overlap"}),
        ([nominal], {"marker": "s", "markersize": 11, "color": COLOURS["blue"], "label": "as described"}),
        ([best], {"marker": "o", "markersize": 12, "color": COLOURS["vermilion"], "label": "best"}),
    ):
        places = [one.rear for one in group], [one.front for one in group]
        chart.plot(*places, linestyle="", fillstyle="none", markeredgewidth=1.6, **marks)
    figure.colorbar(shade, ax=chart, label="least friction")
    dress_axes(chart, title="Postures", xlabel="rear legs [deg]", ylabel="front legs [deg]")
    chart.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, fontsize=9, frameon=False)
    draw_robot(before, robot, slope, nominal, options.friction, "As described")
    draw_robot(after, robot, slope, best, options.friction, "Best posture")
    title_figure(
        figure,
        f"What morphing buys on {options.slope:g}°",
        f"{robot.name}   ·   legs' sagittal angles and thrust chosen together for the least friction   ·   "
        f"steepest slope at μₛ {options.friction:g}: {steepest[0]:.1f}° as described, {steepest[2]:.1f}° at best",
    )
    options.out.mkdir(parents=True, exist_ok=True)
    print(f"wrote {save_figure(figure, options.out / 'morphing.png')}")


if __name__ == "__main__":
    main()
