"""Where the planar pendulum is at the instants shown: the true reduced state, and its reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray
from numpy.typing import NDArray

from m4_dynamics.full.axle_path import AxlePath
from m4_dynamics.full.terrain import Terrain
from m4_dynamics.reduced.reduction import Reduction, reduce_robot
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.recorder import Recorder
from m4_dynamics.simulation.trajectory import true_motion
from m4_dynamics.view.frames import Frames
from m4_dynamics.view.phases import balancing_samples

__all__ = ["PlanarMotion", "ReducedMotion", "recorded_reduced", "sample_reduced"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PlanarMotion:
    """A planar pendulum at n instants; NaN where it is not to be seen.

    Attributes:
        axle: Middle of its axle in the world, shape (n, 3) [m].
        wheel_angle: Shape (n,) [rad].
        pitch: Shape (n,) [rad].
    """

    axle: Array
    wheel_angle: Array
    pitch: Array


@dataclass(frozen=True, slots=True, eq=False)
class ReducedMotion:
    """The reduced model beside the full one.

    Attributes:
        reduction: The pendulum and its axes on the robot.
        true: The state that the full model was in, as the pendulum has it.
        reference: The state that it should have been in, or None if the trajectory has no reference.
        thrust: Total thrust, shape (n,) [N].
    """

    reduction: Reduction
    true: PlanarMotion
    reference: PlanarMotion | None
    thrust: Array


def sample_reduced(dataset: xarray.Dataset, robot: Robot, frames: Frames) -> ReducedMotion | None:
    """The pendulum's motion at the instants of a replay.

    Args:
        dataset: The trajectory.
        robot: The robot that made it.
        frames: The instants.

    Returns:
        The motion while the robot balances; None for a robot that doesn't, or a trajectory without reduced state.
    """
    if robot.balance is None or robot.drive_motor is None:
        return None
    if not {"state", "axle_position_in_world"} <= set(dataset.variables):
        return None
    balancing = balancing_samples(dataset)
    if not balancing.any():
        return None
    time = np.asarray(dataset["time"].values, dtype=float)

    def at_frames(values: Array) -> Array:
        columns = [np.interp(frames.time, time, column) for column in np.where(balancing[:, None], values, np.nan).T]
        return np.column_stack(columns)

    reduction = reduce_robot(robot)
    state = at_frames(np.asarray(dataset["state"].values, dtype=float))
    axle = at_frames(np.asarray(dataset["axle_position_in_world"].values, dtype=float))
    true = PlanarMotion(axle, state[:, 0], state[:, 1])
    reference = None
    if "state_reference" in dataset:
        wanted = at_frames(np.asarray(dataset["state_reference"].values, dtype=float))
        profile = np.column_stack([dataset["terrain_x"].values, dataset["terrain_z"].values])
        path = AxlePath.over(Terrain(profile), reduction.parameters.wheel_radius)
        reference = _reference_motion(path, axle, state, wanted)
    return ReducedMotion(reduction, true, reference, _total_thrust(frames))


def recorded_reduced(recorder: Recorder, row: int, reduction: Reduction, frames: Frames) -> ReducedMotion:
    """The pendulum at one row of a run that still goes on.

    Args:
        recorder: The run.
        row: The row.
        reduction: The pendulum that the robot is reduced to.
        frames: The row as one instant.

    Returns:
        The motion, one instant of it; NaN where the robot does not balance.
    """
    rows = [row] if recorder.origin is not None else [0, row]  # the wheel angle counts from the first row
    model = recorder.plant.model
    motion = true_motion(
        model, reduction, recorder.configuration[rows], recorder.velocity[rows], origin=recorder.origin
    )
    hidden = np.nan if not recorder.balancing else 0.0
    axle, state = motion.axle_in_world[-1:] + hidden, motion.state[-1:] + hidden
    path = AxlePath.over(model.terrain, reduction.parameters.wheel_radius)
    return ReducedMotion(
        reduction,
        PlanarMotion(axle, state[:, 0], state[:, 1]),
        _reference_motion(path, axle, state, recorder.state_reference[row : row + 1] + hidden),
        _total_thrust(frames),
    )


def _reference_motion(path: AxlePath, axle: Array, state: Array, wanted: Array) -> PlanarMotion:
    """The pendulum in the states wanted, at the place that this is along the way from where the robot is."""
    place = np.full_like(axle, np.nan)
    for index in np.flatnonzero(np.isfinite(axle).all(axis=1) & np.isfinite(wanted).all(axis=1)).tolist():
        travel = path.length_at(axle[index, [0, 2]]) + path.radius * (wanted[index, 0] - state[index, 0])
        place[index, [0, 2]] = path.point_at(travel)
        place[index, 1] = axle[index, 1]
    return PlanarMotion(place, wanted[:, 0], wanted[:, 1])


def _total_thrust(frames: Frames) -> Array:
    lengths = (np.linalg.norm(force, axis=1) for force in frames.thrust_force.values())
    return np.asarray(sum(lengths, np.zeros(len(frames.time))))
