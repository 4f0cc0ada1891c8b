"""MuJoCo stepping the same URDF on level ground, at the same step, with the servos held.

What is equal: bodies, joints, collision shapes, gravity, time step, servo gains and limits, friction coefficient.
What is MuJoCo's own: its soft contact (the default stiffness), its pyramidal friction cone, and the two points where
it finds a cylinder to touch a plane, where this package's thin disc has one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.bench.peers import import_peer
from m4_dynamics.errors import InvalidSettingError, RobotDescriptionError
from m4_dynamics.full.standing import joint_angles, standing_configuration
from m4_dynamics.robot.robot import Robot

__all__ = ["MujocoStepper", "build_mujoco_stepper"]

GROUND = "ground"


@dataclass(frozen=True, slots=True, eq=False)
class MujocoStepper:
    """Calling it advances the simulation by a number of steps.

    Attributes:
        mujoco: The module.
        model: The `mujoco.MjModel`.
        data: The `mujoco.MjData`.
        loop: "python" calls MuJoCo once a step, "c" once for all of them.
    """

    mujoco: Any
    model: Any
    data: Any
    loop: Literal["python", "c"]

    def __call__(self, n_steps: int) -> None:
        """Advance by `n_steps` time steps."""
        step, model, data = self.mujoco.mj_step, self.model, self.data
        if self.loop == "c":
            step(model, data, n_steps)
            return
        for _ in range(n_steps):
            step(model, data)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.data.time)

    @property
    def base_height(self) -> float:
        """Height of the root body's origin above the ground [m]."""
        return float(self.data.qpos[2])

    def ground_force_in_world(self) -> NDArray[np.float64]:
        """Sum of the forces of the ground on the robot, shape (3,) [N]."""
        total, wrench = np.zeros(3), np.zeros(6)
        for index, contact in enumerate(self.data.contact):
            self.mujoco.mj_contactForce(self.model, self.data, index, wrench)
            # Rows of the frame are the contact's axes; the force is the one on the second shape.
            force_in_world = np.asarray(contact.frame).reshape(3, 3).T @ wrench[:3]
            total += force_in_world if self.model.geom(int(contact.geom[0])).name == GROUND else -force_in_world
        return total


def build_mujoco_stepper(
    robot: Robot, *, posture: str | None = None, time_step: float = 1e-3, loop: Literal["python", "c"] = "python"
) -> MujocoStepper:
    """Build MuJoCo's model of a robot that stands on level ground, servos holding its joints, wheels free.

    Args:
        robot: The robot.
        posture: Posture to stand in, with upright wheels; None sets every joint to zero.
        time_step: Step [s].
        loop: Whether a call of many steps loops over MuJoCo's step in Python or inside MuJoCo.

    Returns:
        The stepper, at rest.

    Raises:
        PeerMissingError: MuJoCo is not installed.
        InvalidSettingError: The loop is neither of the two.
        RobotDescriptionError: The robot cannot stand, or MuJoCo refuses its URDF.
    """
    mujoco = import_peer("mujoco")
    if loop not in ("python", "c"):
        raise InvalidSettingError("loop", loop, "'python' or 'c'")
    q = standing_configuration(robot, posture)
    angles = dict(joint_angles(robot, q))
    urdf = robot.files["urdf"]
    try:
        spec = mujoco.MjSpec.from_file(str(urdf))
        _put_on_the_ground(mujoco, spec, robot)
        for servo in robot.servos:
            actuator = spec.add_actuator(name=servo.joint, target=servo.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            actuator.set_to_position(kp=servo.stiffness, kv=servo.damping)
            actuator.forcerange = [-servo.effort_limit, servo.effort_limit]
            actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        spec.option.timestep = time_step
        # Damping is implicit: a servo's damping on a light leg is unstable at a millisecond otherwise.
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.gravity = np.asarray(robot.model.gravity.linear)
        model = spec.compile()
    except ValueError as error:
        raise RobotDescriptionError(f"{urdf}: MuJoCo refuses it: {error}") from error
    data = mujoco.MjData(model)
    data.qpos[:3] = q[:3]
    for name, angle in angles.items():
        data.qpos[model.joint(name).qposadr[0]] = angle
    for servo in robot.servos:
        data.ctrl[model.actuator(servo.joint).id] = angles[servo.joint]
    mujoco.mj_forward(model, data)
    return MujocoStepper(mujoco=mujoco, model=model, data=data, loop=loop)


def _put_on_the_ground(mujoco: Any, spec: Any, robot: Robot) -> None:
    """Free the root body, which MuJoCo fixes to the world, and let its shapes touch a plane but not each other."""
    roots = list(spec.worldbody.bodies)
    if len(roots) != 1:
        raise RobotDescriptionError(f"{robot.files['urdf']}: expected one root link, MuJoCo found {len(roots)}")
    roots[0].add_freejoint(name="root")
    for shape in spec.geoms:
        shape.contype, shape.conaffinity = 1, 0
        shape.friction[0] = robot.ground.friction_static
    spec.worldbody.add_geom(
        name=GROUND,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 1.0],
        contype=0,
        conaffinity=1,
        friction=[robot.ground.friction_static, 0.005, 0.0001],
    )
