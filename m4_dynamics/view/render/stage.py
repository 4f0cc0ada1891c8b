"""A run on stage: poses of its robot, the ground under them and the forces on them, drawn from one camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch
from numpy.typing import NDArray

from m4_dynamics.errors import ResultFileError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.frames import Frames, sample_frames
from m4_dynamics.view.ground import clip_profile
from m4_dynamics.view.render.camera import Camera
from m4_dynamics.view.render.picture import Frame, draw_picture
from m4_dynamics.view.render.solids import GroundSlab, RobotShapes
from m4_dynamics.view.scene import COM_COLOUR, CONTACT_COLOUR, THRUST_COLOUR
from m4_dynamics.view.style import INK

__all__ = ["Pose", "Stage", "force_legend"]

Array = NDArray[np.float64]

#: A little from behind and from above, so that the ground of a slope is seen.
VIEW = (-0.16, -1.0, 0.27)
METRES_PER_NEWTON = 0.012
_LEAST_ARROW = 0.03  # [m]
_FULL_SIZE = 200.0  # pixels per metre from which on arrows and marks have their full size


@dataclass(frozen=True, slots=True)
class Pose:
    """The robot at one sample of its run.

    Attributes:
        sample: The sample.
        shift: How far along x it is drawn from where it was [m].
    """

    sample: int
    shift: float = 0.0


class Stage:
    """A run, ready to be drawn."""

    def __init__(
        self, dataset: xarray.Dataset, robot: Robot, towards_viewer: tuple[float, float, float] = VIEW
    ) -> None:
        """Put a run on stage.

        Args:
            dataset: A trajectory.
            robot: The robot that made it.
            towards_viewer: Direction from the scene to the viewer.

        Raises:
            ResultFileError: The trajectory cannot be shown with this robot.
        """
        if "axle_position_in_world" not in dataset:
            raise ResultFileError("the trajectory has no variable axle_position_in_world; the picture needs it")
        time = dataset["time"].values
        self.camera = Camera(towards_viewer)
        self.frames: Frames = sample_frames(dataset, robot, frames_per_second=round(1.0 / float(time[1] - time[0])))
        self.axle: Array = np.asarray(dataset["axle_position_in_world"].values, dtype=float)
        self._shapes = RobotShapes(robot)
        self._x, self._z = dataset["terrain_x"].values, dataset["terrain_z"].values

    def corners(self, pose: Pose) -> Array:
        """Every corner of the robot in a pose, in the world, shape (n, 3) [m]."""
        solids = self._shapes.at(self.frames.configuration[pose.sample], (pose.shift, 0.0, 0.0))
        return np.concatenate([solid.corners.reshape(-1, 3) for solid in solids])

    def thrust(self, sample: int) -> float:
        """Sum of all thrusts at a sample [N]."""
        return float(sum(np.linalg.norm(force[sample]) for force in self.frames.thrust_force.values()))

    def ground(self, low: float, high: float, *, half_width: float = 0.5) -> GroundSlab:
        """The ground between two positions along x [m]; level ground goes on where the terrain's level ends."""
        x, z = np.array(self._x, dtype=float), np.array(self._z, dtype=float)
        if z[0] == z[1]:
            x[0] = min(x[0], low)
        if z[-1] == z[-2]:
            x[-1] = max(x[-1], high)
        return GroundSlab(clip_profile(x, z, low=low, high=high), near=-half_width, far=half_width)

    def draw(
        self,
        axes: Axes,
        poses: Sequence[Pose],
        frame: Frame,
        ground: GroundSlab,
        *,
        resolution: float,
        forces: bool = True,
    ) -> None:
        """Draw poses on the ground, in axes whose coordinates become metres in the camera's plane.

        Args:
            axes: The axes.
            poses: What is shown.
            frame: What is in sight.
            ground: The ground.
            resolution: Pixels per metre.
            forces: Whether thrust and ground forces are drawn.
        """
        solids = []
        for pose in poses:
            solids += self._shapes.at(self.frames.configuration[pose.sample], (pose.shift, 0.0, 0.0))
        draw_picture(axes, solids, ground, self.camera, frame, resolution=resolution)
        size = float(np.clip(resolution / _FULL_SIZE, 0.4, 1.0))
        for pose in poses:
            centre = self.camera.project(self.frames.com[pose.sample] + (pose.shift, 0.0, 0.0))
            axes.plot(*centre, "o", color=COM_COLOUR, markeredgecolor="white", markersize=5.5 * size, zorder=9)
            if forces:
                self._draw_forces(axes, pose, size)

    def _draw_forces(self, axes: Axes, pose: Pose, size: float) -> None:
        frames, shift = self.frames, np.array([pose.shift, 0.0, 0.0])
        for places, vectors, colour in (
            (frames.contact_position, frames.contact_force, CONTACT_COLOUR),
            (frames.thrust_position, frames.thrust_force, THRUST_COLOUR),
        ):
            for name, force in vectors.items():
                place, arrow = places[name][pose.sample] + shift, METRES_PER_NEWTON * force[pose.sample]
                if np.isfinite(place).all() and np.linalg.norm(arrow) > _LEAST_ARROW:
                    start, end = self.camera.project(place), self.camera.project(place + arrow)
                    patch = FancyArrowPatch(
                        (float(start[0]), float(start[1])), (float(end[0]), float(end[1])), shrinkA=0, shrinkB=0,
                        arrowstyle=f"-|>,head_length={4.0 * size},head_width={2.2 * size}", linewidth=1.7 * size,
                        zorder=8,
                    )  # fmt: skip
                    patch.set_color(colour)
                    axes.add_patch(patch)


def force_legend() -> list[Line2D]:
    """Handles for a legend: thrust, ground forces, centre of mass."""
    arrow = {"linewidth": 1.9, "marker": ">", "markersize": 6}
    handles = [
        Line2D([], [], color=THRUST_COLOUR, label="thrust", **arrow),  # type: ignore[arg-type]
        Line2D([], [], color=CONTACT_COLOUR, label="ground on a wheel", **arrow),  # type: ignore[arg-type]
        Line2D([], [], color=COM_COLOUR, linestyle="none", marker="o", markeredgecolor="white", label="centre of mass"),
    ]
    for handle in handles:
        handle.set_markeredgecolor(INK if handle.get_linestyle() == "None" else handle.get_color())
    return handles
