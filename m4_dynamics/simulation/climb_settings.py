"""What to climb, and how: slope, ground, speed, controller, and what the plant has that the model has not."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.simulation.controllers import CONTROLLERS, ControllerName
from m4_dynamics.simulation.fidelity import Fidelity
from m4_dynamics.simulation.plant_errors import PlantErrors

__all__ = ["ClimbSettings"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ClimbSettings:
    """What to climb, and how.

    Attributes:
        slope: Inclination of the ground [rad].
        friction_static: mu_s of the ground; None takes the robot's own.
        speed: Cruising speed along the slope [m/s].
        thrust: Total thrust of the trim [N]; None chooses one inside all limits.
        controller: "default" tracks the trim with a terminal cost, "paper" is the paper's MPC measured from the trim,
            "paper-zero" the paper's with raw inputs in the cost, "lqr" the saturated LQR of the trim, "pid" balances
            with the wheels alone at the trim's thrust, for flat ground and gentle slopes.
        duration: [s].
        start_time: Rest before the robot moves off [s].
        ramp_time: Time to reach the speed, and to stop [s].
        hold_time: Rest at the end [s].
        pitch_error: Initial pitch less the trim's [rad].
        yaw_error: Initial heading, positive left of uphill [rad].
        start_position: Of the axle, from the foot of the slope uphill [m].
        time_step: Integration step of the full model [s].
        control_period: [s].
        posture_compensation: Whether the servos are told the trim's holding torques, so that the legs do not sag.
        plant_errors: How the simulated robot differs from the one that the controllers know.
        fidelity: What sets actuators and sensors apart from the paper's ideal ones; the default is nothing.
    """

    slope: float
    friction_static: float | None = None
    speed: float = 0.3
    thrust: float | None = None
    controller: ControllerName = "default"
    duration: float = 10.0
    start_time: float = 0.5
    ramp_time: float = 1.5
    hold_time: float = 2.0
    pitch_error: float = math.radians(5.0)
    yaw_error: float = math.radians(0.5)
    start_position: float = 0.6
    time_step: float = 1e-3
    control_period: float = 5e-3
    posture_compensation: bool = True
    plant_errors: PlantErrors = field(default_factory=PlantErrors)
    fidelity: Fidelity = field(default_factory=Fidelity)

    def __post_init__(self) -> None:
        limits: dict[str, tuple[float, float]] = {
            "slope": (0.0, math.radians(89.0)),
            "speed": (-2.0, 2.0),
            "duration": (0.0, 600.0),
            "pitch_error": (-math.radians(90.0), math.radians(90.0)),
            "yaw_error": (-math.radians(90.0), math.radians(90.0)),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if not low <= value <= high:
                angle = name in ("slope", "pitch_error", "yaw_error")
                shown = [math.degrees(x) if angle else x for x in (value, low, high)]
                unit = " [deg]" if angle else ""
                raise InvalidSettingError(f"{name}{unit}", round(shown[0], 6), f"{shown[1]:g} to {shown[2]:g}")
        if self.friction_static is not None and not 0.0 < self.friction_static <= 10.0:
            raise InvalidSettingError("friction_static", self.friction_static, "a coefficient above 0, at most 10")
        if self.thrust is not None and not (math.isfinite(self.thrust) and self.thrust >= 0.0):
            raise InvalidSettingError("thrust [N]", self.thrust, "a finite force >= 0")
        if self.controller not in CONTROLLERS:
            raise InvalidSettingError("controller", self.controller, "one of " + ", ".join(CONTROLLERS))
