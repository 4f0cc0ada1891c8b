"""Draw the degrees of freedom of one leg: its joints with their positive turns, its thrust and the ground's force.

python analysis/joints_sketch.py docs/joints.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pinocchio as pin
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch
from numpy.typing import NDArray

from m4_dynamics import M4Error, Robot, load_robot
from m4_dynamics.view.gallery import standing_in_posture
from m4_dynamics.view.render.camera import Camera
from m4_dynamics.view.render.picture import Frame, draw_picture
from m4_dynamics.view.render.solids import GroundSlab, RobotShapes
from m4_dynamics.view.scene import CONTACT_COLOUR, THRUST_COLOUR
from m4_dynamics.view.style import COLOURS, new_figure, save_figure

INK = COLOURS["ink"]
FROM_THE_FRONT = (0.9, 0.22, 0.42)
RESOLUTION = 900.0  # pixels per metre
ARC, LINE, ARROW = 0.055, 0.12, 0.17  # [m] radius of a turn, half of an axis, length of a force
HALO = [patheffects.withStroke(linewidth=4.5, foreground="white")]


def leg_joints(robot: Robot, joint: int) -> list[int]:
    """Joints from the base to the one given."""
    chain = []
    while joint > 1:
        chain.append(joint)
        joint = int(robot.model.parents[joint])
    return chain[::-1]


def draw_turn(axes: Axes, camera: Camera, place: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """An axis with an arrow around it the positive way; returns where a word's line may end."""
    first = np.cross(axis, (0.3, -0.5, 1.0))
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    out = axis if camera.view(axis)[2] < 0.0 else -axis
    ends = camera.project(np.array([place - LINE * out, place + LINE * out]))
    axes.plot(*ends.T, color=INK, linewidth=1.4, linestyle=(0, (8, 3, 2, 3)), zorder=6, path_effects=HALO)
    angles = np.linspace(0.0, 1.5 * np.pi, 60)[:, None]
    centre = place + 0.75 * LINE * out
    arc = camera.project(centre + ARC * (np.cos(angles) * first + np.sin(angles) * second))
    axes.plot(*arc[:-3].T, color=INK, linewidth=2.2, zorder=7, path_effects=HALO)
    draw_arrow(axes, arc[-6], arc[-1], INK, linewidth=2.2)
    return np.asarray(arc[np.argmax(arc[:, 0])])


def draw_arrow(
    axes: Axes, tail: NDArray[np.float64], tip: NDArray[np.float64], colour: str, *, linewidth: float = 3.2
) -> None:
    """An arrow in the picture."""
    axes.add_patch(
        FancyArrowPatch(
            tuple(tail), tuple(tip), arrowstyle="-|>", mutation_scale=17, color=colour, linewidth=linewidth,
            shrinkA=0, shrinkB=0, zorder=8, path_effects=HALO,
        )
    )  # fmt: skip


def draw(axes: Axes, robot: Robot, posture: str) -> None:
    """The robot in a posture, seen from its front, with the joints of its first leg that has a thruster."""
    camera = Camera(FROM_THE_FRONT)
    configuration = standing_in_posture(robot, posture)
    solids = RobotShapes(robot).at(configuration)
    corners = np.concatenate([solid.corners.reshape(-1, 3) for solid in solids])
    low, high = corners.min(axis=0) - 0.06, corners.max(axis=0) + 0.06
    ground = GroundSlab(np.array([[low[0], 0.0], [high[0], 0.0]]), near=float(low[1]), far=float(high[1]))
    seen = camera.project(
        np.concatenate([corners, [[x, y, 0.0] for x in (low[0], high[0]) for y in (low[1], high[1])]])
    )
    (left, bottom), (right, top) = seen.min(axis=0) - 0.03, seen.max(axis=0) + 0.03
    right += 0.52 * (right - left)  # for the words
    draw_picture(axes, solids, ground, camera, Frame(left, right, bottom, top), resolution=RESOLUTION)

    data = robot.model.createData()
    pin.computeJointJacobians(robot.model, data, configuration)
    thruster = robot.thrusters[0]
    leg = leg_joints(robot, thruster.joint_id)
    wheels = [wheel for wheel in robot.wheels if leg[-1] in leg_joints(robot, wheel.joint_id)]
    words: list[tuple[str, str, NDArray[np.float64]]] = []  # text, colour, what it names
    for joint in [*leg, *(wheel.joint_id for wheel in wheels if wheel.joint_id not in leg)]:
        # What a unit speed of the joint turns the leg by: its column of the Jacobian, in the world's axes.
        axis = np.asarray(data.J)[3:6, robot.model.joints[joint].idx_v]
        words.append((robot.model.names[joint], INK, draw_turn(axes, camera, data.oMi[joint].translation, axis)))
    placement = data.oMi[thruster.joint_id]
    push = placement.rotation @ np.asarray(thruster.direction_in_joint)
    forces = [
        (f"thrust at {thruster.frame}", THRUST_COLOUR, placement.act(np.asarray(thruster.position_in_joint)), push)
    ]
    for wheel in wheels:
        contact = np.asarray(data.oMi[wheel.joint_id].translation) * (1.0, 1.0, 0.0)
        forces.append(("force of the ground", CONTACT_COLOUR, contact, np.array([0.0, 0.0, 1.0])))
    for word, colour, start, direction in forces:
        tail, tip = camera.project(np.array([start, start + ARROW * direction]))
        draw_arrow(axes, tail, tip, colour)
        words.append((word, colour, tip))

    words.sort(key=lambda entry: -entry[2][1])
    heights = np.linspace(top - 0.12 * (top - bottom), bottom + 0.12 * (top - bottom), len(words))
    for (word, colour, named), height in zip(words, heights, strict=True):
        axes.annotate(
            word, xy=tuple(named), xytext=(right - 0.01, height), color=INK, fontsize=10, va="center", ha="right",
            zorder=9, arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 1.2, "shrinkA": 2, "shrinkB": 1},
        )  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("picture", type=Path, nargs="?", default=Path("joints.png"), help="the picture's file")
    parser.add_argument("--robot", type=Path, help="a robot with thrusters (default: M4)")
    parser.add_argument("--posture", default="ugv", help="posture that it stands in (default: ugv)")
    options = parser.parse_args()

    figure = new_figure(width=7.4, height=4.2)
    try:
        robot = load_robot(options.robot)
        if not robot.thrusters:
            raise M4Error(f"robot '{robot.name}' has no thrusters; the picture shows a leg that carries one")
        draw(figure.add_subplot(), robot, options.posture)
        print(f"wrote {save_figure(figure, options.picture)}")
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
