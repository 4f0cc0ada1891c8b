"""Where the ground's corners are for odometry that is a little off: a wheel that stops at one has found it.

A wheel that meets a rising face a centimetre before its odometry says so stands still between both faces. As long as
the controller believes in level ground it has no reason to push harder, and the robot would wait there until the
error of its wheels has grown large enough.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.control.slope_profile import SlopeProfile
from m4_dynamics.errors import InvalidSettingError

__all__ = ["CornerFinder"]

_Array = NDArray[np.float64]

#: Slower than this share of the wanted rate a wheel counts as stopped.
STOPPED = 0.5


class CornerFinder:
    """The starts of a profile's pieces, moved to where the wheels meet them.

    Attributes:
        profile: The ground by place.
        reach: How far the odometry may be off [rad]; nothing further away is taken for the corner that was met.
        starts: As the profile's, for the wheel angle that is measured, shape (m,) [rad]; changes in place.
        offset: True less measured wheel angle, as far as corners have told [rad].
    """

    __slots__ = ("offset", "profile", "reach", "starts")

    def __init__(self, profile: SlopeProfile, *, reach: float) -> None:
        """Believe the odometry.

        Args:
            profile: The ground by place.
            reach: See the class [rad].

        Raises:
            InvalidSettingError: The reach is negative or not finite.
        """
        if not (math.isfinite(reach) and reach >= 0.0):
            raise InvalidSettingError("reach of a corner", reach, "a finite angle >= 0")
        self.profile = profile
        self.reach = reach
        self.starts: _Array = profile.starts.copy()
        self.offset = 0.0

    def reset(self) -> None:
        """Believe the odometry again."""
        self.offset = 0.0
        self.starts[:] = self.profile.starts

    def update(self, wheel_angle: float, rate: float, wanted_rate: float) -> bool:
        """Take in a measurement.

        Args:
            wheel_angle: Measured absolute wheel angle [rad].
            rate: Measured wheel rate [rad/s].
            wanted_rate: The reference's [rad/s].

        Returns:
            Whether a corner is within reach, to either side.
        """
        near = np.searchsorted(self.starts, (wheel_angle - self.reach, wheel_angle + self.reach), side="right")
        if near[0] == near[1]:
            return False
        if rate * wanted_rate < STOPPED * wanted_rate * wanted_rate:
            piece = int(np.searchsorted(self.starts, wheel_angle, side="right"))
            # The piece that starts ahead, or the one underneath on the way down; concave where the slope rises uphill.
            corner = piece if wanted_rate > 0.0 else piece - 1
            slopes = self.profile.slopes
            if 0 < corner < len(slopes) and slopes[corner] > slopes[corner - 1]:
                missing = float(self.starts[corner]) - wheel_angle
                if abs(missing) <= self.reach:
                    # Just behind the corner, on the face that is met.
                    self.offset += missing if wanted_rate > 0.0 else missing - 1e-9
                    self.starts[:] = self.profile.starts - self.offset
        return True
