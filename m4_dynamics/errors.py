"""Everything that can go wrong, in one small hierarchy.

A message says what was wrong, where, what was received and what would be valid. The command line prints the message and
exits with code 2; it never shows a traceback for an `M4Error`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

__all__ = [
    "ConvergenceError",
    "InvalidSettingError",
    "M4Error",
    "NoTrimExists",
    "NonFiniteError",
    "ResultFileError",
    "RobotDescriptionError",
    "SchedulerError",
    "UnknownNameError",
    "require_finite",
    "require_shape",
]


class M4Error(Exception):
    """Base of every error that this package raises on purpose."""


class RobotDescriptionError(M4Error):
    """A URDF, SRDF or TOML file is missing, malformed or physically impossible."""


class UnknownNameError(RobotDescriptionError):
    """A name that the robot does not have.

    Attributes:
        kind: What was looked up ("joint", "frame", "posture", ...).
        name: The name received.
        valid: The names that would have been valid.
    """

    def __init__(self, kind: str, name: str, valid: Iterable[str], where: str = "") -> None:
        self.kind = kind
        self.name = name
        self.valid = tuple(valid)
        place = f" in {where}" if where else ""
        known = ", ".join(self.valid) if self.valid else "none"
        super().__init__(f"unknown {kind} '{name}'{place}; valid: {known}")


class InvalidSettingError(M4Error):
    """A setting is outside its valid range.

    Attributes:
        setting: The setting's name.
        received: The value received.
        valid: What would be valid, in words.
    """

    def __init__(self, setting: str, received: object, valid: str) -> None:
        self.setting = setting
        self.received = received
        self.valid = valid
        super().__init__(f"{setting} = {received!r} is not valid; expected {valid}")


class NonFiniteError(M4Error):
    """A state, input or result holds NaN or infinity; the message names the entry."""


class NoTrimExists(M4Error):
    """No equilibrium satisfies the limits.

    Attributes:
        limit: Name of the limit that forbids it ("friction", "thrust", "duty", ...).
    """

    def __init__(self, message: str, limit: str) -> None:
        self.limit = limit
        super().__init__(message)


class ConvergenceError(M4Error):
    """An iterative solver did not converge; the message gives its residual and cap."""


class ResultFileError(M4Error):
    """A result file cannot be read or written."""


class SchedulerError(M4Error):
    """Workers or their scheduler cannot be reached, or died too often."""


def require_finite(name: str, values: ArrayLike, labels: Sequence[str] | None = None) -> None:
    """Raise if an array holds NaN or infinity.

    Args:
        name: What the array is, for the message.
        values: The array, any shape.
        labels: Names of the entries of a flat array, for the message.

    Raises:
        NonFiniteError: Names the first offending entry and its value.
    """
    array = np.asarray(values, dtype=float)
    if np.isfinite(array).all():
        return
    index = int(np.flatnonzero(~np.isfinite(array.ravel()))[0])
    entry = labels[index] if labels is not None else str(index)
    raise NonFiniteError(f"{name} must be finite, but entry {entry} is {array.ravel()[index]}")


def require_shape(name: str, values: np.ndarray, shape: tuple[int, ...]) -> None:
    """Raise if an array does not have the expected shape.

    Args:
        name: What the array is, for the message.
        values: The array.
        shape: The shape it must have.

    Raises:
        InvalidSettingError: Names the array, the shape received and the shape expected.
    """
    if values.shape != shape:
        raise InvalidSettingError(f"shape of {name}", values.shape, f"shape {shape}")
