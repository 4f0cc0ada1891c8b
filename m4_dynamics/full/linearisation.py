"""Linearisation of the full model on its compliant ground: x' = f(x, u) about any state and input.

The state's deviation is (dq, dv) with dq in the tangent space of q: q_deviated = pinocchio.integrate(q, dq). A ground
that sticks within 1e-4 m/s makes A very stiff: eigenvalues of -1e5 1/s and beyond belong to sticking contacts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.full import kernels
from m4_dynamics.full.contact import find_contacts
from m4_dynamics.full.dynamics import check_state, generalised_force, input_map
from m4_dynamics.full.model import FullModel

__all__ = ["FullLinearisation", "linearise_full"]

Array = NDArray[np.float64]

#: Step of the differences in q [m, rad]: small against the ground's transition width, large against rounding.
_STEP = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class FullLinearisation:
    """d/dt (dq, dv) = A (dq, dv) + B du.

    Attributes:
        A: Shape (2 nv, 2 nv).
        B: Shape (2 nv, inputs), columns as `FullModel.layout`.
    """

    A: Array
    B: Array


def linearise_full(model: FullModel, q: ArrayLike, v: ArrayLike, inputs: ArrayLike) -> FullLinearisation:
    """Linearise the paper's x' = f(x, u) (eq. eom_full_ss), ground included, about a state and an input.

    Rigid-body terms are analytic (Carpentier and Mansard, Analytical derivatives of rigid body dynamics algorithms,
    2018), as is the ground's dependence on velocity; how ground and thrust forces change with q is found by central
    differences. Beside a kink of the ground law (touch-down, a damper about to pull) the derivative is one side's.

    Args:
        model: The full model.
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,) [m/s, rad/s].
        inputs: Servo torques, wheel torques [N m], thrusts [N], see `model.layout`.

    Returns:
        A and B. The upper left block of A is not zero for a moving base: dq is measured in axes that turn with it.

    Raises:
        InvalidSettingError: A shape is wrong.
        NonFiniteError: An entry is NaN or infinite.
    """
    configuration, velocity = check_state(model, q, v)
    pinocchio_model, data, nv = model.robot.model, model.data, model.robot.model.nv
    force = generalised_force(model, configuration, velocity, inputs)
    by_velocity = _ground_damping(model, configuration, velocity)
    by_configuration = np.empty((nv, nv))
    for column, direction in enumerate(np.eye(nv)):
        ahead, behind = (
            generalised_force(model, pin.integrate(pinocchio_model, configuration, step * direction), velocity, inputs)
            for step in (_STEP, -_STEP)
        )
        by_configuration[:, column] = (ahead - behind) / (2.0 * _STEP)
    mapped = input_map(model, configuration)
    pin.computeABADerivatives(pinocchio_model, data, configuration, velocity, force)
    inverse = np.triu(data.Minv)
    inverse += np.triu(inverse, 1).T

    a, b = np.zeros((2 * nv, 2 * nv)), np.zeros((2 * nv, mapped.shape[1]))
    a[:nv, :nv] = _rate_of_transport(pinocchio_model, configuration, velocity)
    a[:nv, nv:] = np.eye(nv)
    a[nv:, :nv] = data.ddq_dq + inverse @ by_configuration
    a[nv:, nv:] = data.ddq_dv + inverse @ by_velocity
    b[nv:] = inverse @ mapped
    return FullLinearisation(A=a, B=b)


def _ground_damping(model: FullModel, q: Array, v: Array) -> Array:
    """Derivative of the ground's generalised force in v: sum of J^T (df/dv_contact) J, shape (nv, nv)."""
    pin.computeJointJacobians(model.robot.model, model.data, q)
    contacts, joints, _, count = find_contacts(model, margin=0.0)
    total = np.zeros((v.size, v.size))
    rows, force, gradient = np.empty((3, v.size)), np.empty(3), np.empty((3, 3))
    for contact, joint in zip(contacts[:count], joints[:count], strict=True):
        kernels.contact_jacobian(model.data.J, model.support, contact, joint, rows)
        v1, v2, vn = rows @ v
        gap, scale = contact[kernels.GAP], contact[kernels.FRICTION_SCALE]
        kernels.contact_law(v1, v2, vn, gap, scale, model.ground_packed, 0.0, force, gradient)
        total += rows.T @ gradient @ rows
    return total


def _rate_of_transport(model: pin.Model, q: Array, v: Array) -> Array:
    """Rate at which a fixed deviation turns in the axes of a moving base: -ad_v, for any joint, shape (nv, nv)."""
    ahead, behind = (pin.dIntegrate(model, q, step * v, pin.ArgumentPosition.ARG0) for step in (1e-5, -1e-5))
    return np.asarray((ahead - behind) / 2e-5)
