"""Pinocchio, Drake and MuJoCo on the same URDF, answering in the same coordinates.

Each engine has its own velocity of a floating base, v_engine = S(q) v with v as Pinocchio has it (linear and angular
velocity in base axes, linear first). From M_e v_e' + h_e = tau_e follow M = S^T M_e S and h = S^T (h_e + M_e S' v), and
J = J_e S for a Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """A robot's state, free of any engine's conventions.

    Attributes:
        position: Of the base in the world, shape (3,) [m].
        rotation: Of the base in the world, shape (3, 3).
        angles: Joint -> angle or displacement.
        linear: Velocity of the base in base axes, shape (3,) [m/s].
        angular: Angular velocity of the base in base axes, shape (3,) [rad/s].
        rates: Joint -> rate.
    """

    position: Array
    rotation: Array
    angles: dict[str, float]
    linear: Array
    angular: Array
    rates: dict[str, float]


@dataclass(frozen=True)
class Answer:
    """What an engine says about a state, in Pinocchio's coordinates."""

    mass_matrix: Array
    bias: Array
    gravity: Array
    jacobians: dict[str, Array]


def without_shapes(urdf: Path, folder: Path) -> tuple[Path, Path]:
    """Copies of a URDF that need no meshes: one for all, one with MuJoCo's options.

    MuJoCo would otherwise merge fixed links into their parents (and the root into the world) and mend inertias.
    """
    root = etree.parse(str(urdf)).getroot()
    for element in list(root.iter("visual", "collision")):
        element.getparent().remove(element)
    for element in list(root):
        if element.tag not in ("link", "joint"):
            root.remove(element)
    plain = folder / "plain.urdf"
    plain.write_bytes(etree.tostring(root))
    options = {"fusestatic": "false", "balanceinertia": "false", "boundmass": "0", "boundinertia": "0"}
    etree.SubElement(etree.SubElement(root, "mujoco"), "compiler", options)
    for_mujoco = folder / "mujoco.urdf"
    for_mujoco.write_bytes(etree.tostring(root))
    return plain, for_mujoco


def random_state(model: pin.Model, rng: np.random.Generator) -> State:
    """A state with the base anywhere and every joint within its limits."""
    angles, rates = {}, {}
    for joint_id in range(2, model.njoints):
        joint = model.joints[joint_id]
        low, high = -np.pi, np.pi
        if joint.nq == 1:
            low = max(low, float(model.lowerPositionLimit[joint.idx_q]))
            high = min(high, float(model.upperPositionLimit[joint.idx_q]))
        angles[model.names[joint_id]] = float(rng.uniform(low, high))
        rates[model.names[joint_id]] = float(rng.normal())
    quaternion = rng.normal(size=4)
    rotation = pin.Quaternion(quaternion / np.linalg.norm(quaternion)).toRotationMatrix()
    return State(rng.uniform(-1, 1, 3), rotation, angles, rng.normal(size=3), rng.normal(size=3), rates)


class PinocchioPeer:
    """Pinocchio, whose coordinates are the common ones."""

    def __init__(self, urdf: Path) -> None:
        self.model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
        self.data = self.model.createData()
        self.joints = list(self.model.names)[2:]
        self.indices = {name: int(self.model.joints[self.model.getJointId(name)].idx_v) for name in self.joints}
        self.links = [frame.name for frame in self.model.frames if frame.type == pin.FrameType.BODY]

    def answer(self, state: State, links: list[str]) -> Answer:
        model, data = self.model, self.data
        q, v = pin.neutral(model), np.zeros(model.nv)
        q[:3] = state.position
        q[3:7] = pin.Quaternion(state.rotation).coeffs()
        v[:3], v[3:6] = state.linear, state.angular
        for name in self.joints:
            joint = model.joints[model.getJointId(name)]
            angle = state.angles[name]
            q[joint.idx_q : joint.idx_q + joint.nq] = [np.cos(angle), np.sin(angle)] if joint.nq == 2 else [angle]
            v[joint.idx_v] = state.rates[name]
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        bias = np.array(pin.nonLinearEffects(model, data, q, v))
        gravity = np.array(pin.computeGeneralizedGravity(model, data, q))
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        jacobians = {}
        for link in links:
            frame = model.getFrameId(link, pin.FrameType.BODY)
            jacobians[link] = np.array(pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED))
        return Answer(mass, bias, gravity, jacobians)


def _to_common(reference: PinocchioPeer, state: State, linear: slice, angular: slice, world_angular: bool,
               indices: dict[str, int]) -> tuple[Array, Array]:  # fmt: skip
    """S and S' v for an engine whose linear base velocity is in world axes."""
    nv = reference.model.nv
    s = np.zeros((nv, nv))
    s[linear, :3] = state.rotation
    s[angular, 3:6] = state.rotation if world_angular else np.eye(3)
    for name, index in indices.items():
        s[index, reference.indices[name]] = 1.0
    s_dot_v = np.zeros(nv)
    s_dot_v[linear] = state.rotation @ np.cross(state.angular, state.linear)
    return s, s_dot_v


def _in_common(s: Array, s_dot_v: Array, mass: Array, bias: Array, gravity: Array,
               jacobians: dict[str, Array]) -> Answer:  # fmt: skip
    return Answer(
        mass_matrix=s.T @ mass @ s,
        bias=s.T @ (bias + mass @ s_dot_v),
        gravity=s.T @ gravity,
        jacobians={link: jacobian @ s for link, jacobian in jacobians.items()},
    )


class DrakePeer:
    """Drake: base velocity in world axes, angular first."""

    def __init__(self, urdf: Path, reference: PinocchioPeer) -> None:
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.multibody.tree import JacobianWrtVariable

        self.reference = reference
        self.wrt_velocity = JacobianWrtVariable.kV
        self.plant = MultibodyPlant(0.0)
        Parser(self.plant).AddModels(str(urdf))
        self.plant.Finalize()
        self.context = self.plant.CreateDefaultContext()
        (root,) = self.plant.GetFloatingBaseBodies()
        self.root = self.plant.get_body(root)
        self.indices = {name: self.plant.GetJointByName(name).velocity_start() for name in reference.joints}

    def answer(self, state: State, links: list[str]) -> Answer:
        from pydrake.math import RigidTransform, RotationMatrix

        plant, context, rotation = self.plant, self.context, state.rotation
        plant.SetFreeBodyPose(context, self.root, RigidTransform(RotationMatrix(rotation), state.position))
        positions, velocities = plant.GetPositions(context), np.zeros(plant.num_velocities())
        for name in self.reference.joints:
            joint = plant.GetJointByName(name)
            positions[joint.position_start()] = state.angles[name]
            velocities[joint.velocity_start()] = state.rates[name]
        start = self.root.floating_velocities_start_in_v()
        velocities[start : start + 3] = rotation @ state.angular
        velocities[start + 3 : start + 6] = rotation @ state.linear
        plant.SetPositions(context, positions)
        plant.SetVelocities(context, velocities)
        gravity = -plant.CalcGravityGeneralizedForces(context)
        world = plant.world_frame()
        jacobians = {}
        for link in links:
            frame = plant.GetBodyByName(link).body_frame()
            jacobian = plant.CalcJacobianSpatialVelocity(
                context, self.wrt_velocity, frame, np.zeros((3, 1)), world, world
            )
            jacobians[link] = np.vstack([jacobian[3:], jacobian[:3]])
        s, s_dot_v = _to_common(
            self.reference, state, slice(start + 3, start + 6), slice(start, start + 3), True, self.indices
        )
        bias = plant.CalcBiasTerm(context) + gravity
        return _in_common(s, s_dot_v, plant.CalcMassMatrix(context), bias, gravity, jacobians)


class MujocoPeer:
    """MuJoCo: linear base velocity in world axes, angular in base axes."""

    def __init__(self, mujoco: Any, urdf: Path, reference: PinocchioPeer) -> None:
        self.mujoco = mujoco
        self.reference = reference
        spec = mujoco.MjSpec.from_file(str(urdf))
        spec.worldbody.first_body().add_freejoint()  # a URDF's root is welded to the world otherwise
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.indices = {name: int(self.model.joint(name).dofadr[0]) for name in reference.joints}

    def answer(self, state: State, links: list[str]) -> Answer:
        mujoco, model, data = self.mujoco, self.model, self.data
        x, y, z, w = pin.Quaternion(state.rotation).coeffs()
        data.qpos[:7] = [*state.position, w, x, y, z]
        data.qvel[:3], data.qvel[3:6] = state.rotation @ state.linear, state.angular
        for name, index in self.indices.items():
            data.qpos[model.joint(name).qposadr[0]] = state.angles[name]
            data.qvel[index] = state.rates[name]
        mujoco.mj_forward(model, data)
        bias = data.qfrc_bias.copy()
        mass = np.zeros((model.nv, model.nv))
        for column, unit in enumerate(np.eye(model.nv)):
            mujoco.mj_mulM(model, data, mass[column], unit)
        jacobians = {}
        for link in links:
            jacobian = np.zeros((6, model.nv))
            mujoco.mj_jacBody(model, data, jacobian[:3], jacobian[3:], model.body(link).id)
            jacobians[link] = jacobian
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        gravity = data.qfrc_bias.copy()
        s, s_dot_v = _to_common(self.reference, state, slice(0, 3), slice(3, 6), False, self.indices)
        return _in_common(s, s_dot_v, mass, bias, gravity, jacobians)
