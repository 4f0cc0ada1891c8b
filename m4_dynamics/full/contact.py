"""Contacts between the robot and the ground: where they are, their Jacobians, the ground law as functions.

Normal force f_n = s(d, w) (k d + c d') and Stribeck friction |f_t| = mu(v) f_n. The law's figures are those of
`robot.Ground`. The kernels behind these functions are in `full/kernels.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import require_finite, require_shape
from m4_dynamics.full import kernels
from m4_dynamics.full.model import FullModel, pack_ground
from m4_dynamics.robot.robot import Ground

__all__ = ["Contact", "contact_jacobian", "contacts_at", "find_contacts", "friction_coefficient", "normal_force"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """One contact between a wheel or contact point and the ground.

    Attributes:
        owner: Joint name of the wheel, or frame name of the contact point.
        joint_id: Pinocchio joint that carries it.
        position_in_world: Contact point on the robot, shape (3,) [m].
        normal_in_world: Out of the ground, shape (3,).
        tangents_in_world: Uphill and sideways directions, shape (2, 3).
        gap: Distance to the ground [m]; negative when pressed in.
        friction_scale: Factor of the terrain on the friction.
    """

    owner: str
    joint_id: int
    position_in_world: Array
    normal_in_world: Array
    tangents_in_world: Array
    gap: float
    friction_scale: float


def find_contacts(model: FullModel, *, margin: float) -> tuple[Array, NDArray[np.int64], NDArray[np.int64], int]:
    """Contact table at the placements that `model.data` holds now.

    Args:
        model: The full model; call `pinocchio.computeJointJacobians` (or forward kinematics) on its data before.
        margin: Contacts with a gap below this are listed [m].

    Returns:
        (table (capacity, 7), joint indices, owner indices, number of contacts); columns are named in `kernels.py`.
    """
    capacity = (len(model.wheel_joints) + len(model.point_joints)) * len(model.terrain.segments)
    contacts = np.empty((capacity, kernels.CONTACT_COLUMNS))
    joints, owners = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    count = kernels.find_contacts(
        model.poses, model.wheel_joints, model.wheel_axes, model.wheel_radii, model.point_joints,
        model.point_positions, model.terrain.segments, margin, contacts, joints, owners,
    )  # fmt: skip
    return contacts, joints, owners, int(count)


def contacts_at(model: FullModel, q: ArrayLike, *, margin: float = 0.0) -> list[Contact]:
    """Contacts of wheels and contact points with the terrain at a configuration.

    Args:
        model: The full model.
        q: Configuration, shape (nq,).
        margin: List contacts with a gap below this [m]; 0 lists those that touch.

    Returns:
        The contacts, wheels first.

    Raises:
        InvalidSettingError: The shape of q is wrong.
        NonFiniteError: An entry is NaN or infinite.
    """
    configuration = _check_configuration(model, q)
    pin.computeJointJacobians(model.robot.model, model.data, configuration)
    table, joints, owners, count = find_contacts(model, margin=margin)
    names = [wheel.joint for wheel in model.robot.wheels] + [point.name for point in model.robot.contact_points]
    found = []
    for row, joint, owner in zip(table[:count], joints[:count], owners[:count], strict=True):
        nx, nz = row[kernels.NORMAL_X], row[kernels.NORMAL_Z]
        found.append(
            Contact(
                owner=names[owner],
                joint_id=int(joint),
                position_in_world=row[:3].copy(),
                normal_in_world=np.array([nx, 0.0, nz]),
                tangents_in_world=np.array([[nz, 0.0, -nx], [0.0, 1.0, 0.0]]),
                gap=float(row[kernels.GAP]),
                friction_scale=float(row[kernels.FRICTION_SCALE]),
            )
        )
    return found


def contact_jacobian(model: FullModel, q: ArrayLike, contact: Contact) -> Array:
    """Jacobian of the body's material point at a contact, LOCAL_WORLD_ALIGNED, linear part, shape (3, nv).

    Args:
        model: The full model.
        q: Configuration at which the contact was found, shape (nq,).
        contact: The contact.

    Returns:
        J with velocity_of_contact_point_in_world = J v.

    Raises:
        InvalidSettingError: The shape of q is wrong.
        NonFiniteError: An entry is NaN or infinite.
    """
    configuration = _check_configuration(model, q)
    pin.computeJointJacobians(model.robot.model, model.data, configuration)
    row = np.zeros(kernels.CONTACT_COLUMNS)
    row[:3] = contact.position_in_world
    row[kernels.NORMAL_X], row[kernels.NORMAL_Z] = contact.normal_in_world[0], contact.normal_in_world[2]
    in_contact = np.empty((3, model.robot.model.nv))
    kernels.contact_jacobian(model.data.J, model.support, row, contact.joint_id, in_contact)
    axes = np.vstack((contact.tangents_in_world, contact.normal_in_world))
    return np.asarray(axes.T @ in_contact)


def _check_configuration(model: FullModel, q: ArrayLike) -> Array:
    configuration = np.asarray(q, dtype=float)
    require_shape("configuration q", configuration, (model.robot.model.nq,))
    require_finite("configuration q", configuration)
    return configuration


def friction_coefficient(ground: Ground, sliding_speed: ArrayLike) -> Array:
    """Stribeck friction coefficient mu(v) of a ground law; its peak is exactly mu_s, at the stiction speed.

    Args:
        ground: The ground law.
        sliding_speed: Speed of the contact point along the ground, any shape [m/s].

    Returns:
        The coefficient, same shape.

    Raises:
        NonFiniteError: An entry is NaN or infinite.
    """
    packed = pack_ground(ground)
    speeds = np.asarray(sliding_speed, dtype=float)
    require_finite("sliding speed", speeds)
    values = [kernels.friction_coefficient(float(speed), packed, 1.0)[0] for speed in np.abs(speeds).ravel()]
    return np.array(values).reshape(speeds.shape)


def normal_force(ground: Ground, depth: ArrayLike, depth_rate: ArrayLike) -> Array:
    """Compliant normal force f_n(d, d') >= 0 of a ground law.

    Args:
        ground: The ground law.
        depth: Penetration, positive into the ground, any shape [m].
        depth_rate: Its rate, same shape [m/s].

    Returns:
        The force [N], same shape.

    Raises:
        NonFiniteError: An entry is NaN or infinite.
    """
    packed = pack_ground(ground)
    depths, rates = np.broadcast_arrays(np.asarray(depth, dtype=float), np.asarray(depth_rate, dtype=float))
    require_finite("depth", depths)
    require_finite("depth rate", rates)
    pairs = zip(depths.ravel(), rates.ravel(), strict=True)
    values = [kernels.normal_force(float(d), float(rate), packed)[0] for d, rate in pairs]
    return np.array(values).reshape(depths.shape)
