"""A run as one labelled dataset: built from the recorder's raw samples, kept as NetCDF.

Everything that the closed loop does not need while it runs is computed here: true reduced state, errors, forces of the
reduced model. A reader of the file needs nothing else: units and meaning are in the attributes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics import __version__
from m4_dynamics.errors import ResultFileError
from m4_dynamics.full import kernels
from m4_dynamics.full.axle_path import AxlePath
from m4_dynamics.full.model import FullModel
from m4_dynamics.output import replacing
from m4_dynamics.reduced.ground_force import ground_force_in_slope
from m4_dynamics.reduced.reduction import Reduction
from m4_dynamics.simulation.balance import drive_wheels
from m4_dynamics.simulation.recorder import Recorder

if TYPE_CHECKING:
    import xarray

__all__ = ["TRACKING_WEIGHTS", "TrueMotion", "build_trajectory", "load_trajectory", "save_trajectory", "true_motion"]

Array = NDArray[np.float64]

#: Weights Q of the one metric e^T Q e by which all controllers are compared (paper, section V).
TRACKING_WEIGHTS = np.array([10.0, 1.0e4, 5.0, 25.0])


@dataclass(frozen=True, slots=True, eq=False)
class TrueMotion:
    """What really happened, from the full state (controllers do not see it).

    Attributes:
        travel: Of the axle along its way over the terrain, from the terrain's first corner, shape (n,) [m].
        slope: Under the wheels, shape (n,) [rad].
        state: (travel from the origin given / r, pitch, and their rates), shape (n, 4).
        heading: About the slope normal, positive left of uphill, shape (n,) [rad].
        axle_in_world: Middle of the axle, shape (n, 3) [m].
        com_in_world: Shape (n, 3) [m].
    """

    travel: Array
    slope: Array
    state: Array
    heading: Array
    axle_in_world: Array
    com_in_world: Array


def true_motion(
    model: FullModel, reduction: Reduction, configuration: Array, velocity: Array, *, origin: float | None = None
) -> TrueMotion:
    """True reduced state along a run.

    Args:
        model: The full model.
        reduction: Axes and drive wheels of the pendulum.
        configuration: q, shape (n, nq).
        velocity: v, shape (n, nv).
        origin: Travel at which the wheel angle is zero [m]; None takes that of the first sample.

    Returns:
        The motion.
    """
    robot = model.robot
    data = robot.model.createData()  # the model's own may be in use by a plant
    frame = reduction.frame
    wheels = drive_wheels(robot, frame)
    joints = [robot.wheels[index].joint_id for index in (wheels.left, wheels.right)]
    axes_in_base = frame.rotation_in_base
    count = len(configuration)
    axle, axle_velocity, com = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 3))
    axes, rates = np.empty((count, 3, 3)), np.empty((count, 3))
    for k in range(count):
        pin.centerOfMass(robot.model, data, configuration[k], velocity[k])
        com[k] = data.com[0]
        axle[k] = 0.5 * sum(data.oMi[joint].translation for joint in joints)
        # `data.v` is each joint's own twist in its own axes.
        axle_velocity[k] = 0.5 * sum(data.oMi[joint].rotation @ data.v[joint].linear for joint in joints)
        rotation = data.oMi[1].rotation
        axes[k] = (rotation @ axes_in_base).T
        rates[k] = rotation @ velocity[k, 3:6]
    forward, lateral, up = axes[:, 0], axes[:, 1], axes[:, 2]
    radius = reduction.parameters.wheel_radius
    path = AxlePath.over(model.terrain, radius)
    travel = np.array([path.length_at(point) for point in axle[:, [0, 2]]])
    slope = path.slope_at(travel)
    zero = np.zeros_like(slope)
    tangent = np.column_stack((np.cos(slope), zero, np.sin(slope)))
    normal = np.column_stack((-np.sin(slope), zero, np.cos(slope)))
    state = np.column_stack(
        (
            (travel - (travel[0] if origin is None else origin)) / radius,
            np.arctan2(-forward[:, 2], up[:, 2]),
            np.einsum("ki,ki->k", axle_velocity, tangent) / radius,
            np.einsum("ki,ki->k", rates, lateral),
        )
    )
    left_along = lateral - np.einsum("ki,ki->k", lateral, normal)[:, None] * normal
    heading = np.arctan2(-np.einsum("ki,ki->k", left_along, tangent), left_along[:, 1])
    return TrueMotion(travel, slope, state, heading, axle, com)


def build_trajectory(
    recorder: Recorder,
    reduction: Reduction,
    *,
    attributes: Mapping[str, str | float | int | list[str]],
) -> xarray.Dataset:
    """Label a run.

    Args:
        recorder: The raw samples.
        reduction: Axes and parameters of the pendulum.
        attributes: Provenance and settings for the dataset's attributes.

    Returns:
        The dataset; every variable has `units` and `long_name`.
    """
    import xarray

    n = recorder.count
    model = recorder.plant.model
    robot = model.robot
    motion = true_motion(model, reduction, recorder.configuration[:n], recorder.velocity[:n], origin=recorder.origin)
    statistics = recorder.statistics[:n]
    contact_force = recorder.contact_forces(slice(n))
    wheels = drive_wheels(robot, reduction.frame)
    on_drive_wheels = contact_force[:, [wheels.left, wheels.right]].sum(axis=1)
    rolling = np.ones(len(robot.wheels))
    rolling[[wheels.left, wheels.right]] = wheels.sign_left, wheels.sign_right
    cosine, sine = np.cos(motion.slope), np.sin(motion.slope)
    ground_simulated = np.column_stack(
        (cosine * on_drive_wheels[:, 0] + sine * on_drive_wheels[:, 2],
         -sine * on_drive_wheels[:, 0] + cosine * on_drive_wheels[:, 2])
    )  # fmt: skip
    applied = applied_inputs(recorder, reduction)
    ground_model = np.array(
        [
            ground_force_in_slope(reduction.parameters, float(motion.slope[k]), motion.state[k], applied[k])
            for k in range(n)
        ]
    ).reshape(n, 2)
    state_reference, inputs_reference = recorder.state_reference[:n], recorder.inputs_reference[:n]
    error = state_reference - motion.state
    sums = [kernels.SLIP_DISTANCE, kernels.SLIP_TIME, kernels.AIR_TIME]
    running = np.diff(statistics[:, :, sums], axis=0, prepend=np.zeros((1, len(robot.wheels), len(sums))))
    normal_min = statistics[:, :, kernels.NORMAL_FORCE_MIN]
    diagnostics = recorder.diagnostics[:n]
    wheel, thruster, servo, xyz = "wheel", "thruster", "servo", "xyz"
    reduced, inputs, along = "reduced_state", "reduced_input", "slope_axis"
    variables: dict[str, tuple[tuple[str, ...], NDArray[Any], str, str]] = {
        "configuration": (("time", "nq"), recorder.configuration[:n], "m, 1, rad", "configuration q (Pinocchio)"),
        "velocity": (("time", "nv"), recorder.velocity[:n], "m/s, rad/s", "velocity v (Pinocchio)"),
        "state": (("time", reduced), motion.state, "rad, rad, rad/s, rad/s", "true reduced state"),
        "state_estimated": (("time", reduced), recorder.state_estimated[:n], "rad, rad, rad/s, rad/s",
                            "reduced state that the controller saw"),
        "state_reference": (("time", reduced), state_reference, "rad, rad, rad/s, rad/s", "reference of the state"),
        "inputs": (("time", inputs), recorder.inputs[:n], "1, N", "motor duty and total thrust, commanded"),
        "inputs_reference": (("time", inputs), inputs_reference, "1, N", "motor duty and total thrust, reference"),
        "travel": (("time",), motion.travel, "m", "true travel of the axle along its way, from the foot of the slope"),
        "slope": (("time",), motion.slope, "rad", "slope of the ground under the wheels"),
        "phase": (("time",), recorder.phase[:n], "1", "index of the mission's phase"),
        "heading": (("time",), motion.heading, "rad", "true heading about the slope normal, left of uphill"),
        "heading_estimated": (("time",), recorder.heading_estimated[:n], "rad", "heading that the controller saw"),
        "differential_duty": (("time",), recorder.differential_duty[:n], "1", "duty of the heading hold"),
        "wheel_duty": (("time", wheel), rolling * recorder.wheel_duty[:n], "1",
                       "motor duty, positive drives a drive wheel forward, others about their joint axis"),
        "thrust": (("time", thruster), recorder.thrust[:n], "N", "thrust that the rotors give"),
        "servo_torque": (("time", servo), recorder.servo_torque[:n], "N m", "servo torque"),
        "contact_force_in_world": (("time", wheel, xyz), contact_force, "N",
                                   "force of the ground on the wheel, mean over the sample"),
        "contact_position_in_world": (("time", wheel, xyz), recorder.contact_position_in_world[:n], "m",
                                      "contact point of the wheel"),
        "slip_speed": (("time", wheel), statistics[:, :, kernels.SLIP_SPEED_MAX], "m/s",
                       "largest sliding speed of the contact point within the sample"),
        "slip_distance": (("time", wheel), running[:, :, 0], "m", "distance slid within the sample"),
        "slip_time": (("time", wheel), running[:, :, 1], "s", "time sliding faster than 5 mm/s within the sample"),
        "air_time": (("time", wheel), running[:, :, 2], "s", "time without contact within the sample"),
        "friction_use": (("time", wheel), statistics[:, :, kernels.FRICTION_USE_MAX], "1",
                         "largest |friction| / (mu_s normal force) within the sample"),
        "normal_force_min": (("time", wheel), np.where(np.isfinite(normal_min), normal_min, 0.0), "N",
                             "least normal force within the sample"),
        "ground_force_model": (("time", along), ground_model, "N", "ground force of the reduced model, both wheels"),
        "ground_force_simulated": (("time", along), ground_simulated, "N",
                                   "ground force on the drive wheels of the full model, mean over the sample"),
        "cost": (("time",), diagnostics[:, 0], "1", "cost of the controller's plan"),
        "slack": (("time",), diagnostics[:, 1], "N", "ground-constraint violation that the plan could not avoid"),
        "status": (("time",), diagnostics[:, 2], "1", "status of the control step (control.ControlStatus)"),
        "iterations": (("time",), diagnostics[:, 3], "1", "iterations of the optimiser"),
        "fallback": (("time",), diagnostics[:, 4], "1", "1 where the inputs come from the fallback"),
        "control_time": (("time",), recorder.control_seconds[:n], "s", "wall-clock time that the controller took"),
        "tracking_cost": (("time",), np.einsum("ki,i,ki->k", error, TRACKING_WEIGHTS, error), "1",
                          "e^T Q e of the true state with the paper's Q"),
        "axle_position_in_world": (("time", xyz), motion.axle_in_world, "m", "middle of the axle"),
        "com_in_world": (("time", xyz), motion.com_in_world, "m", "centre of mass of the robot"),
        "terrain_x": (("terrain_point",), model.terrain.profile_in_world[:, 0], "m", "terrain profile, x"),
        "terrain_z": (("terrain_point",), model.terrain.profile_in_world[:, 1], "m", "terrain profile, z"),
    }  # fmt: skip
    if len(recorder.battery):
        voltage, current, charge = recorder.battery[:n].T
        variables["battery_voltage"] = (("time",), voltage, "V", "voltage of the battery under load")
        variables["battery_current"] = (("time",), current, "A", "current drawn from the battery")
        variables["battery_charge"] = (("time",), charge, "1", "charge left in the battery")
    dataset = xarray.Dataset(
        {
            name: (dims, np.ascontiguousarray(values), {"units": units, "long_name": label})
            for name, (dims, values, units, label) in variables.items()
        },
        coords={
            "time": ("time", recorder.time[:n].copy(), {"units": "s", "long_name": "time"}),
            wheel: (wheel, [w.joint for w in robot.wheels]),
            thruster: (thruster, [t.frame for t in robot.thrusters]),
            servo: (servo, [s.joint for s in robot.servos]),
            reduced: (reduced, ["wheel_angle", "pitch", "wheel_rate", "pitch_rate"]),
            inputs: (inputs, ["duty", "thrust"]),
            along: (along, ["along", "normal"]),
            xyz: (xyz, ["x", "y", "z"]),
        },
    )
    dataset.attrs.update(
        {
            "robot": robot.name,
            "friction_static": model.ground.friction_static,
            "wheel_radius_m": reduction.parameters.wheel_radius,
            "weight_N": reduction.parameters.mass * reduction.parameters.gravity,
            "drive_wheels": [robot.wheels[index].joint for index in (wheels.left, wheels.right)],
            "fidelity": ", ".join(recorder.plant.fidelity.switches) or "ideal",
            "seed": recorder.plant.fidelity.seed,
            "version": __version__,
            **{f"sha256_{kind}": digest for kind, digest in robot.file_hashes.items()},
            **attributes,
        }
    )
    return dataset


def applied_inputs(recorder: Recorder, reduction: Reduction) -> Array:
    """Common duty and total balance thrust that the actuators really gave, shape (n, 2)."""
    n = recorder.count
    robot = recorder.plant.model.robot
    wheels = drive_wheels(robot, reduction.frame)
    duty = recorder.wheel_duty[:n]
    common = 0.5 * (wheels.sign_left * duty[:, wheels.left] + wheels.sign_right * duty[:, wheels.right])
    return np.column_stack((common, recorder.thrust[:n, reduction.thrust_shares > 0.0].sum(axis=1)))


def save_trajectory(dataset: xarray.Dataset, path: Path | str) -> Path:
    """Write a trajectory as NetCDF 4: beside its final name first, then renamed, so that no half file is left.

    Args:
        dataset: The trajectory.
        path: The file.

    Returns:
        The path.

    Raises:
        ResultFileError: The file cannot be written.
    """
    target = Path(path)
    encoding = {name: {"zlib": True, "complevel": 3} for name in dataset.data_vars}
    # In memory first: HDF5 crashes when the disk is full while it closes a file.
    content = dataset.to_netcdf(engine="h5netcdf", encoding=encoding)
    with replacing(target) as partial:
        partial.write_bytes(content)
    return target


def load_trajectory(path: Path | str) -> xarray.Dataset:
    """Read a trajectory into memory.

    Args:
        path: The file, or the folder of a run that holds `trajectory.nc`.

    Returns:
        The dataset.

    Raises:
        ResultFileError: The file is missing or is not a trajectory.
    """
    import xarray

    source = Path(path)
    if source.is_dir():
        source = source / "trajectory.nc"
    if not source.is_file():
        raise ResultFileError(f"no trajectory at {source}; give a run's folder or its trajectory.nc")
    try:
        with xarray.open_dataset(source, engine="h5netcdf") as dataset:
            loaded = dataset.load()
    except (OSError, ValueError, KeyError) as error:
        raise ResultFileError(f"{source} is not a readable trajectory: {error}") from error
    missing = {"configuration", "state", "ground_force_model"} - set(loaded.data_vars)
    if missing:
        raise ResultFileError(f"{source} is not a trajectory: it lacks {', '.join(sorted(missing))}")
    return loaded
