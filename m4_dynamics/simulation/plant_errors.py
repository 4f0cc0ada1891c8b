"""A plant that is not quite what the controller believes: mass, balance, thrust and grip off by stated amounts."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError, require_finite, require_shape
from m4_dynamics.full.terrain import Terrain
from m4_dynamics.robot.robot import Ground, Robot

__all__ = ["PlantErrors", "perturbed_robot"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantErrors:
    """How the simulated robot differs from the one that its controllers were designed for.

    Attributes:
        mass_scale: Mass and inertia of every body over their nominal values.
        com_offset_in_base: By how much the whole robot's CoM moves, (x, y, z) of the base frame [m]. The base carries
            the shift: its own CoM moves further, by the robot's mass over the base's.
        thrust_scale: Thrust given over thrust commanded, of every thruster.
        friction_scale: Static friction coefficient of the ground over the one that the controllers assume.
        thrust_scales: A further factor for each thruster, in the robot's order; empty is none.
        friction_scale_left: A further factor on the friction coefficient where y > 0: one wheel grips less.
    """

    mass_scale: float = 1.0
    com_offset_in_base: tuple[float, float, float] = (0.0, 0.0, 0.0)
    thrust_scale: float = 1.0
    friction_scale: float = 1.0
    thrust_scales: tuple[float, ...] = ()
    friction_scale_left: float = 1.0

    def __post_init__(self) -> None:
        """Refuse what no robot can be.

        Raises:
            InvalidSettingError: Names the entry, what was received and what would be valid.
            NonFiniteError: The offset is not finite.
        """
        scales = ("mass_scale", "thrust_scale", "friction_scale", "friction_scale_left")
        named = [(name, getattr(self, name)) for name in scales]
        for name, value in [*named, *(("thrust_scales", value) for value in self.thrust_scales)]:
            if not (math.isfinite(value) and 0.0 < value <= 10.0):
                raise InvalidSettingError(name, value, "a factor above 0, at most 10")
        offset = np.asarray(self.com_offset_in_base, dtype=float)
        require_shape("com_offset_in_base", offset, (3,))
        require_finite("com_offset_in_base", offset, ("x", "y", "z"))
        object.__setattr__(self, "com_offset_in_base", tuple(offset.tolist()))

    def applied_to(self, ground: Ground) -> Ground:
        """The ground with the plant's friction."""
        return dataclasses.replace(ground, friction_static=self.friction_scale * ground.friction_static)

    def applied_to_terrain(self, terrain: Terrain) -> Terrain:
        """The terrain with the plant's friction on the left."""
        assert terrain.friction_scale is not None
        return dataclasses.replace(terrain, friction_scale_left=self.friction_scale_left * terrain.friction_scale)

    def thrust_given(self, robot: Robot) -> NDArray[np.float64]:
        """Thrust given over thrust commanded, per thruster of a robot, shape (thrusters,).

        Raises:
            InvalidSettingError: There are not as many `thrust_scales` as thrusters.
        """
        count = len(robot.thrusters)
        if self.thrust_scales and len(self.thrust_scales) != count:
            raise InvalidSettingError("thrust_scales", self.thrust_scales, f"{count} factors, one for each thruster")
        each = np.array(self.thrust_scales, dtype=float) if self.thrust_scales else np.ones(count)
        return self.thrust_scale * each


def perturbed_robot(robot: Robot, errors: PlantErrors) -> Robot:
    """A copy of a robot with other inertias; the thrust scale is the plant's, see `Plant.thrust_scale`.

    Args:
        robot: The robot; it and its model stay as they are.
        errors: Mass scale and CoM offset.

    Returns:
        The copy, the robot itself if neither mass nor CoM differ.
    """
    offset = np.asarray(errors.com_offset_in_base)
    if errors.mass_scale == 1.0 and not offset.any():
        return robot
    model = robot.model.copy()
    base = 1  # the root joint
    share = model.inertias[base].mass / sum(inertia.mass for inertia in model.inertias[1:])
    for joint in range(1, model.njoints):
        nominal = model.inertias[joint]
        lever = nominal.lever + offset / share if joint == base else nominal.lever
        model.inertias[joint] = pin.Inertia(
            errors.mass_scale * nominal.mass, lever, errors.mass_scale * nominal.inertia
        )
    return dataclasses.replace(robot, model=model)
