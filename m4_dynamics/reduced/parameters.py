"""What the pendulum is made of."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError, require_finite, require_shape
from m4_dynamics.reduced import kernels

__all__ = ["MipParameters", "MotorModel"]

_Array = NDArray[np.float64]

MotorModel = Literal["relative", "paper"]


@dataclass(frozen=True, slots=True)
class MipParameters:
    """Planar thruster-assisted mobile inverted pendulum (paper, fig. fbd_2d).

    Attributes:
        mass_body: Everything but the drive wheels [kg].
        mass_wheel: Both drive wheels together [kg].
        inertia_body: Body about its CoM, lateral axis [kg m^2].
        inertia_wheel: Both drive wheels together about the axle [kg m^2].
        com_in_body: CoM of the body from the axle, (forward, up) at pitch 0 [m].
        thrust_point_in_body: Point where the resultant thrust acts, from the axle, (forward, up) [m].
        wheel_radius: [m].
        torque_constant: k1, torque of both motors at full duty and standstill [N m].
        back_emf_constant: k2, torque lost per wheel rate, both motors together [N m s].
        motor_model: The back-EMF sees the wheel's rate relative to the body, phi' - theta' ("relative"), or phi' as the
            paper's eq. motor_model writes it ("paper").
        gravity: Gravitational acceleration [m/s^2].
        thrust_time_constant: First-order lag of the thrust behind its command [s]; 0 is the paper's ideal rotor.
            Controllers count on it; the functions of `pendulum` take the thrust itself.
    """

    mass_body: float
    mass_wheel: float
    inertia_body: float
    inertia_wheel: float
    com_in_body: tuple[float, float]
    thrust_point_in_body: tuple[float, float]
    wheel_radius: float
    torque_constant: float
    back_emf_constant: float
    motor_model: MotorModel = "relative"
    gravity: float = 9.81
    thrust_time_constant: float = 0.0

    def __post_init__(self) -> None:
        for name in ("com_in_body", "thrust_point_in_body"):
            point = np.asarray(getattr(self, name), dtype=float)
            require_shape(name, point, (2,))
            require_finite(name, point, ("forward", "up"))
            object.__setattr__(self, name, (float(point[0]), float(point[1])))
        for name in ("mass_body", "mass_wheel", "inertia_body", "wheel_radius", "torque_constant"):
            value = float(getattr(self, name))
            if not (math.isfinite(value) and value > 0.0):
                raise InvalidSettingError(name, value, "a finite number above 0")
            object.__setattr__(self, name, value)
        for name in ("inertia_wheel", "back_emf_constant", "gravity", "thrust_time_constant"):
            value = float(getattr(self, name))
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidSettingError(name, value, "a finite number, 0 or above")
            object.__setattr__(self, name, value)
        if self.motor_model not in ("relative", "paper"):
            raise InvalidSettingError("motor_model", self.motor_model, "'relative' or 'paper'")

    @property
    def mass(self) -> float:
        """Mass of the whole robot [kg]."""
        return self.mass_body + self.mass_wheel

    @property
    def weight(self) -> float:
        """Weight of the whole robot [N]."""
        return self.mass * self.gravity

    def with_(self, **changes: Any) -> MipParameters:
        """Return a copy with some attributes changed."""
        return dataclasses.replace(self, **changes)

    def as_array(self) -> _Array:
        """Return the parameter vector that the compiled kernels take; its layout is in `kernels`."""
        p = np.zeros(kernels.PARAMETER_COUNT)
        p[kernels.MASS_BODY] = self.mass_body
        p[kernels.MASS_WHEEL] = self.mass_wheel
        p[kernels.INERTIA_BODY] = self.inertia_body
        p[kernels.INERTIA_WHEEL] = self.inertia_wheel
        p[kernels.COM_FORWARD], p[kernels.COM_UP] = self.com_in_body
        p[kernels.THRUST_FORWARD], p[kernels.THRUST_UP] = self.thrust_point_in_body
        p[kernels.WHEEL_RADIUS] = self.wheel_radius
        p[kernels.TORQUE_CONSTANT] = self.torque_constant
        p[kernels.BACK_EMF_CONSTANT] = self.back_emf_constant
        p[kernels.BACK_EMF_PITCH] = self.back_emf_constant if self.motor_model == "relative" else 0.0
        p[kernels.GRAVITY] = self.gravity
        p[kernels.THRUST_TIME_CONSTANT] = self.thrust_time_constant
        return p
