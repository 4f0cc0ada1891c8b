"""A run that still goes on as one instant of the scene: what a replay would show at the recorder's last row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from m4_dynamics.reduced.reduction import reduce_robot
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.balance import drive_wheels
from m4_dynamics.simulation.recorder import Recorder
from m4_dynamics.view.arrows import round_scale
from m4_dynamics.view.frames import Frames, thrusts_in_world
from m4_dynamics.view.friction import friction_use_in_plane
from m4_dynamics.view.ground import TILE_LENGTH, clip_profile
from m4_dynamics.view.growing_trail import GrowingTrail
from m4_dynamics.view.overlays import COM_COLOUR, TRAIL, LegendEntry, Overlays, legend_entries
from m4_dynamics.view.reduced_motion import recorded_reduced
from m4_dynamics.view.scene import Bounds, placing_commands, scene_commands, scene_motions
from m4_dynamics.view.three import Command

__all__ = ["LiveScene"]

_GROUND_REACH = 8.0  # [m] of ground shown about the start
_LIT_REACH = 3.0  # [m] about the start that the sun's shadows cover


class LiveScene:
    """The scene of one run about the place where it started."""

    def __init__(self, robot: Robot, recorder: Recorder) -> None:
        """Build the scene.

        Args:
            robot: The robot.
            recorder: The run, with one row or more.
        """
        self._robot = robot
        self._recorder = recorder
        balances = robot.balance is not None and robot.drive_motor is not None
        self._reduction = reduce_robot(robot) if balances else None
        self._trail = GrowingTrail(TRAIL)
        plant = recorder.plant
        self._terrain = plant.model.terrain
        self._friction = plant.model.ground.friction_static
        # No force is known beforehand; the weight is a force of the size of those to come.
        self._metres_per_newton = round_scale([np.array([[0.0, 0.0, robot.mass * robot.gravity]])])
        frames, overlays = self._instant()
        x, y, z = (float(entry) for entry in recorder.configuration[0, :3])
        profile = self._terrain.profile_in_world
        shown = clip_profile(profile[:, 0], profile[:, 1], low=x - _GROUND_REACH, high=x + _GROUND_REACH)
        bounds = Bounds(
            (x - _LIT_REACH, y - _LIT_REACH, z - _LIT_REACH), (x + _LIT_REACH, y + _LIT_REACH, z + _LIT_REACH)
        )
        #: What sets the scene up.
        self.commands: list[Command] = [
            *scene_commands(robot, shown, bounds, frames, overlays),
            *self._trail.commands(COM_COLOUR),
        ]
        #: Lines of the legend.
        self.legend: tuple[LegendEntry, ...] = legend_entries(robot, overlays)
        #: Lengths that stand for forces and distances.
        self.scale = f"10 N: {1000.0 * self._metres_per_newton:.3g} cm, tiles: {100.0 * TILE_LENGTH:.3g} cm"

    def frame(self) -> list[Command]:
        """Commands that put every node where it was at the last row; the trail goes on to there."""
        frames, overlays = self._instant()
        self._trail.extend(frames.com[0])
        motions = scene_motions(self._robot, frames, overlays, metres_per_newton=self._metres_per_newton)
        return [*placing_commands(motions), *self._trail.placing_commands()]

    def readouts(self) -> list[tuple[str, str]]:
        """Figures of the last row, as (label, value with its unit)."""
        recorder = self._recorder
        row = recorder.count - 1
        slope = self._terrain.slope_at(float(recorder.configuration[row, 0]))
        readouts = [("time", f"{recorder.time[row]:.2f} s"), ("ground", f"{np.degrees(slope):.0f}°")]
        if recorder.balancing:
            readouts.append(("pitch", f"{np.degrees(recorder.state_estimated[row, 1]):.1f}°"))
        readouts.append(("thrust", f"{recorder.thrust[row].sum():.1f} N"))
        if recorder.balancing and self._reduction is not None:
            wheels = drive_wheels(self._robot, self._reduction.frame)
            force = recorder.contact_forces(slice(row, row + 1))[0, [wheels.left, wheels.right]].sum(axis=0)
            along = np.cos(slope) * force[0] + np.sin(slope) * force[2]
            normal = np.cos(slope) * force[2] - np.sin(slope) * force[0]
            (use,) = friction_use_in_plane(np.array([[along, normal]]), self._friction)
            readouts.append(("friction use", f"{100.0 * use:.0f} %" if np.isfinite(use) else "–"))
        return readouts

    def _instant(self) -> tuple[Frames, Overlays]:
        """The last row, and what is drawn over it."""
        robot, recorder = self._robot, self._recorder
        row = recorder.count - 1
        only = slice(row, row + 1)
        configuration = recorder.configuration[only].copy()
        thrusts = {one.frame: recorder.thrust[only, index] for index, one in enumerate(robot.thrusters)}
        com, thrust_position, thrust_force = thrusts_in_world(robot, configuration, thrusts)
        force, position = recorder.contact_forces(only), recorder.contact_position_in_world[only].copy()
        frames = Frames(
            time=recorder.time[only].copy(),
            configuration=configuration,
            thrust_force=thrust_force,
            thrust_position=thrust_position,
            contact_force={one.joint: force[:, index] for index, one in enumerate(robot.wheels)},
            contact_position={one.joint: position[:, index] for index, one in enumerate(robot.wheels)},
            com=com,
        )
        friction = self._friction if self._friction > 0.0 else None
        # The trail starts here; the pieces that it grows by are not the overlays' business.
        start = np.zeros(1, dtype=np.int64)
        overlays = Overlays(friction=friction, profile=self._terrain.profile_in_world, trail=start)
        if self._reduction is not None:
            overlays = replace(overlays, reduced=recorded_reduced(recorder, row, self._reduction, frames))
        return frames, overlays
