"""The full-body model of one robot on one terrain: Pinocchio's model and data, packed for the kernels."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import M4Error, RobotDescriptionError
from m4_dynamics.full import kernels
from m4_dynamics.full.terrain import Terrain, flat_terrain
from m4_dynamics.robot.robot import Ground, Robot

__all__ = ["FullModel", "InputLayout", "pack_ground"]

Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]


def pack_ground(ground: Ground) -> Array:
    """Ground law as the kernels take it, shape (8,); entries are named in `kernels.py`."""
    packed = np.empty(kernels.GROUND_ENTRIES)
    packed[kernels.STIFFNESS] = ground.stiffness
    packed[kernels.DAMPING] = ground.damping
    packed[kernels.TRANSITION_WIDTH] = ground.transition_width
    packed[kernels.FRICTION_STATIC] = ground.friction_static
    packed[kernels.FRICTION_DYNAMIC] = ground.friction_static * ground.friction_dynamic_fraction
    packed[kernels.STICTION_SPEED] = ground.stiction_speed
    packed[kernels.STRIBECK_SPEED] = ground.stribeck_speed
    packed[kernels.VISCOUS] = ground.viscous_friction
    return packed


@dataclass(frozen=True, slots=True)
class InputLayout:
    """Where each input of the full model stands in u (paper, eq. eom_full_ss): servo torques, wheel torques, thrusts.

    Attributes:
        servos: Slice of the hip torques [N m].
        wheels: Slice of the wheel torques about the joint axes [N m].
        thrusters: Slice of the thrusts [N].
        labels: Names of the entries.
    """

    servos: slice
    wheels: slice
    thrusters: slice
    labels: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of inputs."""
        return len(self.labels)


@dataclass(frozen=True, slots=True, eq=False)
class FullModel:
    """A robot on a terrain, ready for dynamics and stepping.

    Build it with `FullModel.build`. The arrays are what the kernels take; `data` is scratch memory of this object, so
    one `FullModel` serves one thread.

    Attributes:
        robot: The robot.
        terrain: The ground profile.
        ground: The ground law, the robot's own unless another was given.
        data: Pinocchio's scratch data for `robot.model`.
        poses: Live view of the joint placements in `data.oMi`, shape (njoints, 12): rotation column-major, translation.
        support: support[joint, c] = 1 where velocity c moves the joint, shape (njoints, nv).
        parents: The velocity entry before each one on its way to the root, or -1, shape (nv,).
        tips: Last velocity entry that moves each joint, or -1, shape (njoints,).
        layout: Meaning of the input vector u.
    """

    robot: Robot
    terrain: Terrain
    ground: Ground
    data: pin.Data
    poses: Array = field(repr=False)
    support: NDArray[np.uint8] = field(repr=False)
    parents: IndexArray = field(repr=False)
    tips: IndexArray = field(repr=False)
    ground_packed: Array = field(repr=False)
    wheel_joints: IndexArray = field(repr=False)
    wheel_axes: Array = field(repr=False)
    wheel_radii: Array = field(repr=False)
    wheel_velocity_indices: IndexArray = field(repr=False)
    wheel_motor: Array = field(repr=False)
    point_joints: IndexArray = field(repr=False)
    point_positions: Array = field(repr=False)
    thruster_joints: IndexArray = field(repr=False)
    thruster_positions: Array = field(repr=False)
    thruster_directions: Array = field(repr=False)
    moment_ratios: Array = field(repr=False)
    servo_indices: IndexArray = field(repr=False)
    servo_gains: Array = field(repr=False)
    layout: InputLayout

    @classmethod
    def build(cls, robot: Robot, terrain: Terrain | None = None, *, ground: Ground | None = None) -> FullModel:
        """Pack a robot and a terrain.

        Args:
            robot: The robot; its root joint must be a free-flyer.
            terrain: The ground profile; level ground when None.
            ground: The ground law; the robot's own when None.

        Returns:
            The model.

        Raises:
            RobotDescriptionError: The root joint is not a free-flyer.
        """
        model = robot.model
        if model.njoints < 2 or model.joints[1].nv != 6:
            raise RobotDescriptionError(f"robot '{robot.name}' must have a free-flyer root joint to stand on a terrain")
        data = model.createData()
        ground = ground if ground is not None else robot.ground
        support = np.zeros((model.njoints, model.nv), dtype=np.uint8)
        for joint in range(1, model.njoints):
            for ancestor in model.supports[joint]:
                if ancestor > 0:
                    start = model.joints[ancestor].idx_v
                    support[joint, start : start + model.joints[ancestor].nv] = 1
        wheels, thrusters, points, servos = robot.wheels, robot.thrusters, robot.contact_points, robot.servos
        # k1 and k2 are stated for the two drive wheels together (paper, eq. motor_model). Wheels turn freely without.
        motor = robot.drive_motor
        per_wheel = (0.0, 0.0) if motor is None else (0.5 * motor.torque_constant, 0.5 * motor.back_emf_constant)
        labels = (
            *(f"torque of {servo.joint} [N m]" for servo in servos),
            *(f"torque of {wheel.joint} [N m]" for wheel in wheels),
            *(f"thrust of {thruster.frame} [N]" for thruster in thrusters),
        )
        first_thruster = len(servos) + len(wheels)
        return cls(
            robot=robot,
            terrain=terrain if terrain is not None else flat_terrain(),
            ground=ground,
            data=data,
            poses=_view_of_placements(model, data),
            support=support,
            parents=_indices(data.parents_fromRow),
            tips=_indices(joint.idx_v + joint.nv - 1 for joint in model.joints),
            ground_packed=pack_ground(ground),
            wheel_joints=_indices(wheel.joint_id for wheel in wheels),
            wheel_axes=_rows((wheel.axis_in_joint for wheel in wheels), 3),
            wheel_radii=np.array([wheel.radius for wheel in wheels], dtype=float),
            wheel_velocity_indices=_indices(wheel.index_v for wheel in wheels),
            wheel_motor=_rows((per_wheel for _ in wheels), 2),
            point_joints=_indices(point.joint_id for point in points),
            point_positions=_rows((point.position_in_joint for point in points), 3),
            thruster_joints=_indices(thruster.joint_id for thruster in thrusters),
            thruster_positions=_rows((thruster.position_in_joint for thruster in thrusters), 3),
            thruster_directions=_rows((thruster.direction_in_joint for thruster in thrusters), 3),
            moment_ratios=np.array([thruster.moment_ratio for thruster in thrusters], dtype=float),
            servo_indices=_rows(((s.index_q, s.index_v) for s in servos), 2).astype(np.int64),
            servo_gains=_rows(((s.stiffness, s.damping, s.effort_limit) for s in servos), 3),
            layout=InputLayout(
                servos=slice(0, len(servos)),
                wheels=slice(len(servos), first_thruster),
                thrusters=slice(first_thruster, first_thruster + len(thrusters)),
                labels=labels,
            ),
        )


def _indices(values: Iterable[int]) -> IndexArray:
    return np.array(list(values), dtype=np.int64)


def _rows(values: Iterable[ArrayLike], width: int) -> Array:
    return np.array([np.asarray(value, dtype=float) for value in values], dtype=np.float64).reshape(-1, width)


def _view_of_placements(model: pin.Model, data: pin.Data) -> Array:
    """View all of `data.oMi` as one array without copying (reading them one by one costs 0.4 microseconds each).

    Pinocchio keeps the placements in one vector, each as a column-major rotation followed by a translation; this is
    checked here, against the placements read through Pinocchio's own interface.
    """
    first = data.oMi[0].rotation
    strides = (data.oMi[1].rotation.ctypes.data - first.ctypes.data, 8)
    view = np.lib.stride_tricks.as_strided(first.T.reshape(-1), shape=(model.njoints, 12), strides=strides)
    pin.forwardKinematics(model, data, pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)))
    for joint in range(model.njoints):
        placement = data.oMi[joint]
        expected = np.concatenate((placement.rotation.ravel(order="F"), placement.translation))
        if not np.array_equal(view[joint], expected):
            raise M4Error(
                f"Pinocchio {pin.__version__} lays out joint placements differently from 4.1; install pin>=4.1,<4.2"
            )
    return view
