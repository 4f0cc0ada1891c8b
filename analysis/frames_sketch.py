"""Draw the frames and signs of the planar pendulum on a slope, with M4's own lengths.

python analysis/frames_sketch.py docs/frames.png
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Polygon
from numpy.typing import NDArray

from m4_dynamics import M4Error, load_robot, reduce_robot
from m4_dynamics.reduced.pendulum import MipParameters, com_position, thrust_position, wheel_position
from m4_dynamics.view.scene import COM_COLOUR, CONTACT_COLOUR, THRUST_COLOUR
from m4_dynamics.view.style import COLOURS, new_figure, save_figure

SLOPE, PITCH = math.radians(30.0), math.radians(16.0)
INK, GREY, BLUE = COLOURS["ink"], COLOURS["slate"], COLOURS["blue"]


def direction(degrees_from_x: float) -> NDArray[np.float64]:
    """Unit vector in the x-z plane."""
    return np.array([math.cos(math.radians(degrees_from_x)), math.sin(math.radians(degrees_from_x))])


def arrow(
    axes: Axes, start: NDArray[np.float64], vector: NDArray[np.float64], text: str, colour: str, *, below: bool = False
) -> None:
    """An arrow with its name just beyond the tip, or below the tip."""
    tip = start + vector
    axes.add_patch(
        FancyArrowPatch(
            tuple(start), tuple(tip), arrowstyle="-|>", mutation_scale=14, color=colour, linewidth=1.8, shrinkA=0,
            shrinkB=0, zorder=6,
        )
    )  # fmt: skip
    beyond = tip + (np.array([0.01, -0.055]) if below else 0.05 * vector / np.linalg.norm(vector))
    axes.text(*beyond, text, color=colour, fontsize=11, ha="center", va="center", zorder=7)


def turn(axes: Axes, centre: NDArray[np.float64], radius: float, start: float, end: float, colour: str) -> None:
    """A curved arrow from one angle to a smaller one (clockwise: positive about +y) [deg from x]."""
    axes.add_patch(
        Arc(tuple(centre), 2 * radius, 2 * radius, theta1=end, theta2=start, color=colour, linewidth=1.5, zorder=6)
    )
    tip, before = centre + radius * direction(end), centre + radius * direction(end + 4.0)
    axes.add_patch(FancyArrowPatch(tuple(before), tuple(tip), arrowstyle="-|>", mutation_scale=11, color=colour))


def draw(axes: Axes, pendulum: MipParameters) -> None:
    """The pendulum on its slope, seen against +y: x to the right, z up."""
    state = np.array([0.0, PITCH, 0.0, 0.0])
    along, normal = direction(math.degrees(SLOPE)), direction(math.degrees(SLOPE) + 90.0)
    axle = np.asarray(wheel_position(pendulum, SLOPE, state))
    com, push = np.asarray(com_position(pendulum, SLOPE, state)), np.asarray(thrust_position(pendulum, SLOPE, state))
    contact = axle - pendulum.wheel_radius * normal
    forward, up = direction(-math.degrees(PITCH)), direction(90.0 - math.degrees(PITCH))

    foot, top = contact - 0.42 * along, contact + 0.78 * along
    corner = np.array([top[0], foot[1]])
    axes.add_patch(Polygon([foot, top, corner], facecolor="#E4E8EC", edgecolor="none"))
    axes.plot([foot[0], top[0]], [foot[1], top[1]], color="#7A8792", linewidth=2)
    axes.plot([foot[0], foot[0] + 0.3], [foot[1], foot[1]], color=GREY, linewidth=1)
    axes.add_patch(Arc(tuple(foot), 0.4, 0.4, theta1=0.0, theta2=math.degrees(SLOPE), color=GREY, linewidth=1.3))
    axes.text(*(foot + 0.25 * direction(13.0)), r"$\beta$", color=GREY, fontsize=13, ha="center", va="center")

    # The robot: wheel, body line, centre of mass, thrust.
    axes.add_patch(Circle(tuple(axle), pendulum.wheel_radius, facecolor="white", edgecolor=INK, linewidth=2.5))
    end = axle + 0.86 * up
    axes.plot([axle[0], end[0]], [axle[1], end[1]], color=INK, linewidth=7, alpha=0.18, solid_capstyle="round")
    axes.plot([axle[0], axle[0]], [axle[1], axle[1] + 0.66], color=GREY, linewidth=1, linestyle=(0, (5, 4)))
    turn(axes, axle, 0.58, 90.0, 90.0 - math.degrees(PITCH), INK)
    axes.text(*(axle + 0.63 * direction(83.5)), r"$\theta$", fontsize=13, color=INK, ha="center", va="center")
    turn(axes, axle, 0.085, 200.0, 60.0, BLUE)
    axes.text(*(axle + 0.045 * direction(150.0)), r"$\varphi$", fontsize=13, color=BLUE, ha="center", va="center")
    for point, text, colour in ((com, r"$\ell_b$", COM_COLOUR), (push, r"$\ell_t$", THRUST_COLOUR)):
        axes.plot([axle[0], point[0]], [axle[1], point[1]], color=colour, linewidth=1.2, linestyle=(0, (2, 2)))
        axes.text(*(axle + 0.62 * (point - axle) + 0.04 * forward), text, color=colour, fontsize=12)
    axes.plot(*com, "o", color=COM_COLOUR, markersize=10, zorder=7)
    axes.text(*(com - 0.045 * forward), "CoM", color=INK, fontsize=10, ha="right", va="center")
    arrow(axes, push, 0.26 * forward, r"$f_t$", THRUST_COLOUR)
    arrow(axes, axle + 0.86 * up, 0.17 * forward, "", INK)
    axes.text(*(axle + 0.86 * up + 0.19 * forward), "forward", color=INK, fontsize=11, ha="left", va="center")
    arrow(axes, axle + 0.86 * up, 0.17 * up, "up", INK)

    # Slope frame and ground force, world frame.
    arrow(axes, contact, 0.27 * along, r"$f_x$", CONTACT_COLOUR, below=True)
    arrow(axes, contact, 0.33 * normal, r"$f_n$", CONTACT_COLOUR)
    frame_s = contact + 0.53 * along
    arrow(axes, frame_s, 0.16 * along, "t", GREY, below=True)
    arrow(axes, frame_s, 0.16 * normal, "n", GREY)
    axes.text(*(frame_s - 0.055 * normal), "S", color=GREY, fontsize=11, ha="center", va="center", weight="bold")
    world = foot + np.array([-0.27, 0.0])
    arrow(axes, world, np.array([0.17, 0.0]), "x", INK)
    arrow(axes, world, np.array([0.0, 0.17]), "z", INK)
    axes.plot(*world, marker="x", color=INK, markersize=7)
    axes.plot(*world, marker="o", markerfacecolor="none", markeredgecolor=INK, markersize=12)
    axes.text(*(world - np.array([0.055, 0.045])), "W, y", color=INK, fontsize=11, ha="center", va="center")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("picture", type=Path, nargs="?", default=Path("frames.png"), help="the picture's file")
    options = parser.parse_args()

    figure = new_figure(width=6.4, height=5.6)
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    axes.set_axis_off()
    try:
        draw(axes, reduce_robot(load_robot()).parameters)
        print(f"wrote {save_figure(figure, options.picture)}")
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
