"""The axes of a map."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import InvalidSettingError

__all__ = ["AXIS_UNITS", "MapGrid", "checked_axis"]

_Array = NDArray[np.float64]

#: Axis -> (unit, meaning), in the order of a map's dimensions.
AXIS_UNITS: dict[str, tuple[str, str]] = {
    "posture_angle": ("rad", "angle of the posture's named joints; NaN: the posture as described"),
    "speed": ("m/s", "climbing speed along the slope"),
    "friction": ("1", "static friction coefficient of the ground"),
    "slope": ("rad", "inclination of the ground, positive uphill"),
    "thrust": ("N", "total thrust"),
}

_RANGES: dict[str, tuple[float, float]] = {
    "posture_angle": (-math.pi, math.pi),
    "speed": (-5.0, 5.0),
    "friction": (1e-3, 10.0),
    "slope": (0.0, math.radians(89.9)),
    "thrust": (0.0, 1e5),
}
#: A map of more cells would not fit into an ordinary memory.
_CELLS_MAX = 20_000_000


def checked_axis(name: str, values: ArrayLike, *, unit: str, low: float, high: float) -> _Array:
    """An axis of a map, once it is known to be one.

    Args:
        name: For messages.
        values: A number or a list of strictly increasing numbers.
        unit: Of the values; angles are shown in degrees.
        low: Least value that is valid.
        high: Greatest.

    Returns:
        A copy that cannot be written to, shape (n,).

    Raises:
        InvalidSettingError: Names the axis and the entry that is not valid.
    """
    axis = np.atleast_1d(np.asarray(values, dtype=float)).copy()
    if axis.ndim != 1 or len(axis) == 0:
        raise InvalidSettingError(f"axis {name}", axis.shape, "a list of at least one number")
    bad = axis[~((axis >= low) & (axis <= high))]
    if len(bad) > 0:
        shown, bounds, shown_unit = float(bad[0]), (low, high), unit
        if "rad" in unit:
            shown, shown_unit = round(math.degrees(shown), 6), unit.replace("rad", "deg")
            bounds = (math.degrees(low), math.degrees(high))
        where = f"axis {name} [{shown_unit}]"
        raise InvalidSettingError(where, shown, f"numbers from {bounds[0]:g} to {bounds[1]:g}")
    if (np.diff(axis) <= 0.0).any():
        raise InvalidSettingError(f"axis {name}", "values that do not increase", "strictly increasing numbers")
    axis.setflags(write=False)
    return axis


def _no_posture_angle() -> _Array:
    return np.array([np.nan])


@dataclass(frozen=True, slots=True, eq=False)
class MapGrid:
    """Axes of a map; each strictly increasing.

    Attributes:
        slope: Inclination of the ground, 0 to 89.9 deg, shape (n,) [rad].
        thrust: Total thrust, shape (m,) [N].
        friction: Static friction coefficient, shape (k,).
        speed: Climbing speed, shape (s,) [m/s].
        posture_angle: Angle given to the joints named in `posture_joints`, shape (p,) [rad]; a single NaN leaves the
            posture as it is.
        posture_joints: Joints that turn together along the axis `posture_angle`.
    """

    slope: ArrayLike
    thrust: ArrayLike
    friction: ArrayLike
    speed: ArrayLike = 0.0
    posture_angle: ArrayLike = field(default_factory=_no_posture_angle)
    posture_joints: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the axes.

        Raises:
            InvalidSettingError: Names the axis and the entry that is not valid.
        """
        for name, (low, high) in _RANGES.items():
            if name == "posture_angle" and not self.posture_joints:
                values = np.atleast_1d(np.asarray(self.posture_angle, dtype=float))
                if not (len(values) == 1 and np.isnan(values[0])):
                    raise InvalidSettingError("posture_angle", values.tolist(), "the names of the joints that turn")
            else:
                values = checked_axis(name, getattr(self, name), unit=AXIS_UNITS[name][0], low=low, high=high)
            object.__setattr__(self, name, values)
        if self.cells > _CELLS_MAX:
            raise InvalidSettingError("cells of the map", self.cells, f"at most {_CELLS_MAX}")

    @property
    def axes(self) -> dict[str, _Array]:
        """Axis -> values, in the order of a map's dimensions."""
        return {name: np.asarray(getattr(self, name)) for name in AXIS_UNITS}

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values on each axis, in the order of a map's dimensions."""
        return tuple(len(values) for values in self.axes.values())

    @property
    def cells(self) -> int:
        """Number of cells."""
        return math.prod(self.shape)

    def as_dict(self) -> dict[str, Any]:
        """Plain values: what a stored map is compared by."""
        values: dict[str, Any] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            values[item.name] = [None if v != v else float(v) for v in value] if item.name in AXIS_UNITS else value
        values["posture_joints"] = list(self.posture_joints)
        return values
