"""A trajectory at the instants that a replay shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import xarray
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError, ResultFileError, require_finite
from m4_dynamics.robot.robot import Robot

__all__ = ["Frames", "sample_frames", "thrusts_in_world"]

_NEEDED = ("configuration", "thrust", "contact_force_in_world", "contact_position_in_world", "terrain_x", "terrain_z")


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """What is shown at n instants.

    Attributes:
        time: The trajectory's time, shape (n,) [s].
        configuration: Configurations, shape (n, nq).
        thrust_force: Thruster's frame -> force on the robot, in the world, shape (n, 3) [N].
        thrust_position: Thruster's frame -> where that force acts, in the world, shape (n, 3) [m].
        contact_force: Wheel's joint -> force of the ground on it, in the world, shape (n, 3) [N].
        contact_position: Wheel's joint -> where that force acts, in the world, shape (n, 3) [m]; NaN without contact.
        com: Centre of mass in the world, shape (n, 3) [m].
    """

    time: NDArray[np.float64]
    configuration: NDArray[np.float64]
    thrust_force: dict[str, NDArray[np.float64]]
    thrust_position: dict[str, NDArray[np.float64]]
    contact_force: dict[str, NDArray[np.float64]]
    contact_position: dict[str, NDArray[np.float64]]
    com: NDArray[np.float64]

    @property
    def elapsed(self) -> NDArray[np.float64]:
        """Time since the first instant, shape (n,) [s]."""
        return np.asarray(self.time - self.time[0])


def sample_frames(dataset: xarray.Dataset, robot: Robot, *, frames_per_second: float) -> Frames:
    """Interpolate a trajectory at a regular rate, its last sample included.

    Args:
        dataset: A trajectory.
        robot: The robot that made it.
        frames_per_second: Rate [1/s].

    Returns:
        The frames. Configurations are interpolated on their manifold, everything else linearly.

    Raises:
        InvalidSettingError: The rate is not positive.
        ResultFileError: A variable is missing or the trajectory is another robot's.
        NonFiniteError: A configuration holds NaN or infinity.
    """
    if not 0.0 < frames_per_second <= 1000.0:
        raise InvalidSettingError("frames_per_second", frames_per_second, "a rate above 0, up to 1000")
    time = _check(dataset, robot)
    duration = float(time[-1] - time[0])
    instants = time[0] + np.arange(int(np.floor(duration * frames_per_second + 1e-9)) + 1) / frames_per_second
    if time[-1] - instants[-1] > 1e-9:
        instants = np.append(instants, time[-1])
    configuration = _interpolate_configurations(robot, time, dataset["configuration"].values, instants)

    def linear(values: NDArray[np.float64]) -> NDArray[np.float64]:
        flat = np.asarray(values, dtype=float).reshape(len(time), -1)
        sampled = np.empty((len(instants), flat.shape[1]))
        for column in range(flat.shape[1]):
            sampled[:, column] = np.interp(instants, time, flat[:, column])
        return sampled.reshape(len(instants), *values.shape[1:])

    force = linear(dataset["contact_force_in_world"].values)
    position = linear(dataset["contact_position_in_world"].values)
    wheels = [str(name) for name in dataset["wheel"].values]
    thrust = linear(dataset["thrust"].values)
    thrusts = {str(name): thrust[:, index] for index, name in enumerate(dataset["thruster"].values)}
    com, thrust_position, thrust_force = thrusts_in_world(robot, configuration, thrusts)
    return Frames(
        time=instants,
        configuration=configuration,
        thrust_force=thrust_force,
        thrust_position=thrust_position,
        contact_force={name: force[:, index] for index, name in enumerate(wheels)},
        contact_position={name: position[:, index] for index, name in enumerate(wheels)},
        com=com,
    )


def thrusts_in_world(
    robot: Robot, configuration: NDArray[np.float64], thrusts: dict[str, NDArray[np.float64]]
) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]]:
    """Centre of mass, and point and force of every thruster, in the world along the configurations.

    Args:
        robot: The robot.
        configuration: Shape (n, nq).
        thrusts: Thruster's frame -> its thrust, shape (n,) [N].

    Returns:
        Centre of mass, shape (n, 3) [m]; frame -> point of application, shape (n, 3) [m]; frame -> force on the robot,
        shape (n, 3) [N].
    """
    data = robot.model.createData()
    thrusters = [robot.thruster(frame) for frame in thrusts]
    com = np.empty((len(configuration), 3))
    position = {frame: np.empty((len(configuration), 3)) for frame in thrusts}
    force = {frame: np.empty((len(configuration), 3)) for frame in thrusts}
    for index, one in enumerate(configuration):
        com[index] = pin.centerOfMass(robot.model, data, one)
        for thruster in thrusters:
            placement = data.oMi[thruster.joint_id]
            position[thruster.frame][index] = placement.act(thruster.position_in_joint)
            direction = placement.rotation @ thruster.direction_in_joint
            force[thruster.frame][index] = thrusts[thruster.frame][index] * direction
    return com, position, force


def _check(dataset: xarray.Dataset, robot: Robot) -> NDArray[np.float64]:
    """The trajectory's time, after making sure that it can be shown with this robot."""
    missing = [name for name in ("time", "wheel", "thruster", *_NEEDED) if name not in dataset.variables]
    if missing:
        raise ResultFileError(f"the trajectory has no variable {', '.join(missing)}; a replay needs it")
    time = np.asarray(dataset["time"].values, dtype=float)
    if len(time) < 2 or not (np.diff(time) > 0.0).all():
        raise ResultFileError("the trajectory's time must increase over two samples or more")
    width = dataset["configuration"].shape[1]
    if width != robot.model.nq:
        raise ResultFileError(
            f"the trajectory has configurations of {width} entries but robot '{robot.name}' has {robot.model.nq}: "
            "it was made with another robot"
        )
    require_finite("configuration", dataset["configuration"].values)
    return time


def _interpolate_configurations(
    robot: Robot, time: NDArray[np.float64], configuration: NDArray[np.float64], instants: NDArray[np.float64]
) -> NDArray[np.float64]:
    after = np.clip(np.searchsorted(time, instants, side="right"), 1, len(time) - 1)
    share = (instants - time[after - 1]) / (time[after] - time[after - 1])
    rows = zip(after, np.clip(share, 0.0, 1.0), strict=True)
    return np.array(
        [pin.interpolate(robot.model, configuration[row - 1], configuration[row], float(part)) for row, part in rows]
    )
