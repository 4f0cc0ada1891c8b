"""The controllers of the closed loop, made for one robot as the simulation knows it."""

from __future__ import annotations

import dataclasses
from typing import Literal, get_args

from m4_dynamics.control.controller import BalanceController
from m4_dynamics.control.heading import HeadingHold, heading_gains
from m4_dynamics.control.lqr import LqrController
from m4_dynamics.control.mpc.controller import MpcController
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.control.pid import PidController
from m4_dynamics.control.reference import ReferenceTrajectory
from m4_dynamics.control.slope_profile import SlopeProfile
from m4_dynamics.reduced.reduction import Reduction, heading_dynamics
from m4_dynamics.reduced.trim import Trim
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.fidelity import Fidelity

__all__ = ["CONTROLLERS", "ControllerName", "make_controller", "make_heading_hold", "robot_with_rotor_lag"]

ControllerName = Literal["default", "paper", "paper-zero", "lqr", "pid"]
CONTROLLERS: tuple[str, ...] = get_args(ControllerName)

#: The heading's closed loop: natural frequency [rad/s], above the fastest growth on any slope, and damping ratio.
HEADING_FREQUENCY = 8.0
HEADING_DAMPING_RATIO = 1.0
#: Pole of the heading's integral [1/s]: well below the others, it stands against constant moments alone.
HEADING_INTEGRAL_FREQUENCY = 2.0


def make_controller(
    name: ControllerName,
    reduction: Reduction,
    reference: ReferenceTrajectory,
    *,
    friction_static: float,
    profile: SlopeProfile | None = None,
) -> BalanceController:
    """Build a balance controller by its name.

    Args:
        name: "default" tracks the trim with a terminal cost, "paper" is the paper's MPC measured from the trim,
            "paper-zero" the paper's with raw inputs in the cost, "lqr" the saturated LQR of the trim, "pid" balances
            with the wheels alone.
        reduction: The robot as a pendulum.
        reference: What to follow.
        friction_static: mu_s that the constraints assume.
        profile: The ground ahead by place, which an MPC previews; None takes the reference's slopes by time.

    Returns:
        The controller.
    """
    parameters, thrust_limits = reduction.parameters, (0.0, reduction.thrust_max)
    if name == "lqr":
        return LqrController(parameters, reference, thrust_limits=thrust_limits)
    if name == "pid":
        return PidController(parameters, reference)
    if name == "default":
        settings = MpcSettings(friction_static=friction_static, thrust_limits=thrust_limits)
    else:
        settings = MpcSettings.paper(
            input_reference="zero" if name == "paper-zero" else "trim",
            friction_static=friction_static,
            thrust_limits=thrust_limits,
        )
    return MpcController(parameters, reference, settings, profile=profile)


def make_heading_hold(robot: Robot, reduction: Reduction, trim: Trim) -> HeadingHold:
    """Heading hold with its poles placed at the trim.

    Args:
        robot: The robot.
        reduction: The robot as a pendulum.
        trim: The equilibrium, with its slope, pitch and speed.

    Returns:
        The controller.
    """
    dynamics = heading_dynamics(robot, reduction, slope=trim.slope, pitch=trim.pitch, speed=trim.speed)
    gains = heading_gains(
        yaw_inertia=dynamics.yaw_inertia,
        track=dynamics.track,
        wheel_radius=dynamics.wheel_radius,
        stiffness=dynamics.gravity_stiffness,
        torque_constant=reduction.parameters.torque_constant,
        back_emf_constant=reduction.parameters.back_emf_constant,
        natural_frequency=HEADING_FREQUENCY,
        damping_ratio=HEADING_DAMPING_RATIO,
        integral_frequency=HEADING_INTEGRAL_FREQUENCY,
    )
    return HeadingHold(gains=gains)


def robot_with_rotor_lag(robot: Robot, fidelity: Fidelity) -> Robot:
    """The robot as its controllers know it: with the rotors' lag, its own or the fidelity's, as a state of their model.

    Args:
        robot: The robot.
        fidelity: The plant's.

    Returns:
        A copy with the time constants that act.
    """
    lags = fidelity.rotor_time_constants(robot)
    thrusters = tuple(
        dataclasses.replace(thruster, time_constant=float(lag))
        for thruster, lag in zip(robot.thrusters, lags, strict=True)
    )
    return dataclasses.replace(robot, thrusters=thrusters)
