"""Electric power of holding or climbing: rotors by momentum theory, wheel motors by their losses and work."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.reduced.pendulum import MipParameters

__all__ = ["PowerModel", "power_needed"]


@dataclass(frozen=True, slots=True)
class PowerModel:
    """How much power thrust and torque cost.

    Attributes:
        thruster_count: Rotors that share the thrust equally.
        rotor_radius: [m].
        air_density: [kg/m^3].
        figure_of_merit: Ideal power over actual power of a rotor in hover.
    """

    thruster_count: int = 2
    rotor_radius: float = 0.1
    air_density: float = 1.225
    figure_of_merit: float = 0.6

    def __post_init__(self) -> None:
        for name in ("thruster_count", "rotor_radius", "air_density", "figure_of_merit"):
            value = float(getattr(self, name))
            if not (math.isfinite(value) and value > 0.0):
                raise InvalidSettingError(name, value, "a finite number above 0")


def power_needed(
    parameters: MipParameters, model: PowerModel, thrust: ArrayLike, torque: ArrayLike, wheel_rate: ArrayLike
) -> NDArray[np.float64]:
    """Electric power of rotors and wheel motors; arguments broadcast.

    A rotor that hovers with thrust f needs f^1.5 / sqrt(2 rho A) ideally (momentum theory). A motor whose torque and
    back-EMF constants are equal, as in SI units they are, loses tau^2 / k2 in its winding; k2 = 0 means no losses. A
    motor driven backwards is taken to return nothing.

    Args:
        parameters: The pendulum.
        model: Rotor figures.
        thrust: Total thrust [N].
        torque: Torque of both motors [N m].
        wheel_rate: Wheel rate relative to the body [rad/s].

    Returns:
        Power [W].
    """
    per_rotor = np.maximum(np.asarray(thrust, dtype=float), 0.0) / model.thruster_count
    disc_area = math.pi * model.rotor_radius**2
    ideal = model.thruster_count * per_rotor**1.5 / math.sqrt(2.0 * model.air_density * disc_area)
    tau = np.asarray(torque, dtype=float)
    losses = tau**2 / parameters.back_emf_constant if parameters.back_emf_constant > 0.0 else 0.0 * tau
    work = np.maximum(tau * np.asarray(wheel_rate, dtype=float) + losses, 0.0)
    return np.asarray(ideal / model.figure_of_merit + work)
