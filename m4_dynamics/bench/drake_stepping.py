"""Drake stepping the same URDF on level ground, at the same step, with the servos held.

What is equal: bodies, joints, collision shapes, gravity, time step, servo stiffness and torque limits, friction
coefficient, contact stiffness and stiction speed, and the damping of a contact at rest. What is Drake's own: its
discrete contact solvers, and one point per pair of touching shapes. The servos' stiffness acts explicitly; their
damping is implicit in the convex solvers, but explicit in TAMSI and limited there to what a step can bear. The whole
loop runs inside Drake's simulator.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.bench.peers import import_peer
from m4_dynamics.errors import InvalidSettingError, RobotDescriptionError
from m4_dynamics.full.standing import joint_angles, standing_configuration
from m4_dynamics.robot.robot import Robot

__all__ = ["DrakeStepper", "build_drake_stepper"]

SOLVERS = ("sap", "lagged", "similar", "tamsi")


@dataclass(frozen=True, slots=True, eq=False)
class DrakeStepper:
    """Calling it advances the simulation by a number of steps.

    Attributes:
        diagram: The diagram; kept because the simulator does not own it.
        plant: The `MultibodyPlant`.
        simulator: The `Simulator`.
        root: The robot's root body in the plant.
        time_step: Step [s].
    """

    diagram: Any
    plant: Any
    simulator: Any
    root: Any
    time_step: float

    def __call__(self, n_steps: int) -> None:
        """Advance by `n_steps` time steps."""
        # Counted from the start, so that rounding never adds or drops a step.
        done = round(self.time / self.time_step)
        self.simulator.AdvanceTo((done + n_steps) * self.time_step)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.simulator.get_context().get_time())

    @property
    def base_height(self) -> float:
        """Height of the root body's origin above the ground [m]."""
        return float(self.plant.EvalBodyPoseInWorld(self._context(), self.root).translation()[2])

    def ground_force_in_world(self) -> NDArray[np.float64]:
        """Sum of the forces of the ground on the robot, shape (3,) [N]."""
        results = self.plant.get_contact_results_output_port().Eval(self._context())
        world = self.plant.world_body().index()
        total = np.zeros(3)
        for index in range(results.num_point_pair_contacts()):
            contact = results.point_pair_contact_info(index)
            force_on_second = np.asarray(contact.contact_force())
            total += force_on_second if contact.bodyA_index() == world else -force_on_second
        return total

    def _context(self) -> Any:
        return self.plant.GetMyContextFromRoot(self.simulator.get_context())


def build_drake_stepper(
    robot: Robot,
    *,
    posture: str | None = None,
    time_step: float = 1e-3,
    solver: Literal["sap", "lagged", "similar", "tamsi"] = "sap",
) -> DrakeStepper:
    """Build Drake's model of a robot that stands on level ground, servos holding its joints, wheels free.

    Args:
        robot: The robot.
        posture: Posture to stand in, with upright wheels; None sets every joint to zero.
        time_step: Step of the discrete plant [s].
        solver: Drake's discrete contact approximation. TAMSI is the fastest, and deprecated by Drake.

    Returns:
        The stepper, at rest.

    Raises:
        PeerMissingError: Drake is not installed.
        InvalidSettingError: Drake has no such solver.
        RobotDescriptionError: The robot cannot stand, or Drake refuses its URDF.
    """
    plants = import_peer("pydrake.multibody.plant")
    if solver not in SOLVERS:
        raise InvalidSettingError("solver", solver, "one of " + ", ".join(SOLVERS))
    q = standing_configuration(robot, posture)
    angles = dict(joint_angles(robot, q))
    damping = {servo.joint: servo.damping for servo in robot.servos}
    if solver == "tamsi":
        damping = _bearable_damping(robot, q, time_step)

    builder = import_peer("pydrake.systems.framework").DiagramBuilder()
    config = plants.MultibodyPlantConfig(
        time_step=time_step,
        contact_model="point",
        discrete_contact_approximation=solver,
        stiction_tolerance=robot.ground.stiction_speed,
    )
    with _known_notices_hidden():
        plant, scene_graph = plants.AddMultibodyPlant(config, builder)
    urdf = robot.files["urdf"]
    try:
        (instance,) = import_peer("pydrake.multibody.parsing").Parser(plant).AddModels(str(urdf))
    except (RuntimeError, ValueError) as error:
        raise RobotDescriptionError(f"{urdf}: Drake refuses it: {error}") from error
    root = plant.get_body(plant.GetBodyIndices(instance)[0])
    plant.mutable_gravity_field().set_gravity_vector(np.asarray(robot.model.gravity.linear))
    for servo in robot.servos:
        joint = plant.GetJointByName(servo.joint)
        joint.set_default_damping_vector([damping[servo.joint]])
        plant.AddJointActuator(servo.joint, joint, servo.effort_limit)
    with _known_notices_hidden():
        _add_ground(plant, scene_graph, robot)
        plant.Finalize()
        _ignore_contact_within_the_robot(plant, scene_graph)
        if robot.servos:
            _hold(builder, plant, instance, robot, angles)
        diagram = builder.Build()
        context = diagram.CreateDefaultContext()
        _set_state(plant, plant.GetMyMutableContextFromRoot(context), root, q, angles)
        simulator = import_peer("pydrake.systems.analysis").Simulator(diagram, context)
        simulator.Initialize()
    return DrakeStepper(diagram=diagram, plant=plant, simulator=simulator, root=root, time_step=time_step)


@contextmanager
def _known_notices_hidden() -> Iterator[None]:
    """Hide two notices that change nothing here: TAMSI is deprecated, deformable bodies ignore half spaces."""
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def _bearable_damping(robot: Robot, q: NDArray[np.float64], time_step: float) -> dict[str, float]:
    """Limit each servo's damping so that, taken explicitly, it at most halves the joint's speed in a step."""
    inverse = np.triu(pin.computeMinverse(robot.model, robot.model.createData(), q))
    effective_inertia = 1.0 / np.diag(inverse)
    return {
        servo.joint: min(servo.damping, 0.5 * float(effective_inertia[servo.index_v]) / time_step)
        for servo in robot.servos
    }


def _add_ground(plant: Any, scene_graph: Any, robot: Robot) -> None:
    """Put a half space under the robot and give all shapes the ground's properties."""
    geometry = import_peer("pydrake.geometry")
    ground = robot.ground
    # Drake's discrete solvers know one coefficient, for sticking and for sliding.
    friction = import_peer("pydrake.multibody.plant").CoulombFriction(ground.friction_static, ground.friction_static)
    force_on_a_wheel = robot.mass * robot.gravity / len(robot.wheels)
    properties = geometry.ProximityProperties()
    geometry.AddContactMaterial(
        # TAMSI's damping grows with the penetration; this equals the ground's where the robot stands at rest.
        dissipation=ground.damping / force_on_a_wheel,
        # Two equal springs in series make the ground's.
        point_stiffness=2.0 * ground.stiffness,
        friction=friction,
        properties=properties,
    )
    # SAP's damping is a time, and adds up over the two shapes.
    properties.AddProperty("material", "relaxation_time", 0.5 * ground.damping / ground.stiffness)
    for shape in _collision_shapes(plant):
        scene_graph.AssignRole(plant.get_source_id(), shape, properties, geometry.RoleAssign.kReplace)
    pose = import_peer("pydrake.math").RigidTransform()
    plant.RegisterCollisionGeometry(plant.world_body(), pose, geometry.HalfSpace(), "ground", properties)


def _collision_shapes(plant: Any) -> list[Any]:
    """Identifiers of the collision shapes of all bodies but the world."""
    body_index = import_peer("pydrake.multibody.tree").BodyIndex
    bodies = [plant.get_body(body_index(number)) for number in range(1, plant.num_bodies())]
    return [shape for body in bodies for shape in plant.GetCollisionGeometriesForBody(body)]


def _ignore_contact_within_the_robot(plant: Any, scene_graph: Any) -> None:
    geometry = import_peer("pydrake.geometry")
    shapes = geometry.GeometrySet(_collision_shapes(plant))
    scene_graph.collision_filter_manager().Apply(geometry.CollisionFilterDeclaration().ExcludeWithin(shapes))


def _hold(builder: Any, plant: Any, instance: Any, robot: Robot, angles: dict[str, float]) -> None:
    """Connect a proportional controller, in C++, that holds the servos' joints; damping acts in the joints."""
    servos = robot.servos
    states, positions = plant.num_multibody_states(instance), plant.num_positions(instance)
    selection = np.zeros((2 * len(servos), states))
    output = np.zeros((plant.num_actuators(), len(servos)))
    for row, servo in enumerate(servos):
        joint = plant.GetJointByName(servo.joint)
        selection[row, joint.position_start()] = 1.0
        selection[len(servos) + row, positions + joint.velocity_start()] = 1.0
        output[plant.GetJointActuatorByName(servo.joint).input_start(), row] = 1.0
    gains, zero = np.array([servo.stiffness for servo in servos]), np.zeros(len(servos))
    targets = np.concatenate(([angles[servo.joint] for servo in servos], zero))
    controllers = import_peer("pydrake.systems.controllers")
    controller = builder.AddSystem(controllers.PidController(selection, output, gains, zero, zero))
    target = builder.AddSystem(import_peer("pydrake.systems.primitives").ConstantVectorSource(targets))
    builder.Connect(target.get_output_port(), controller.get_input_port_desired_state())
    builder.Connect(plant.get_state_output_port(instance), controller.get_input_port_estimated_state())
    builder.Connect(controller.get_output_port(), plant.get_actuation_input_port())


def _set_state(plant: Any, context: Any, root: Any, q: NDArray[np.float64], angles: dict[str, float]) -> None:
    pose = import_peer("pydrake.math").RigidTransform(np.asarray(q[:3], dtype=float))
    plant.SetFreeBodyPose(context, root, pose)
    positions = plant.GetPositions(context)
    for name, angle in angles.items():
        positions[plant.GetJointByName(name).position_start()] = angle
    plant.SetPositions(context, positions)
