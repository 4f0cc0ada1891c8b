"""What a sweep computes: places on axes, each with a record of figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["Axis", "Field", "OnProgress", "Place", "Record", "SweepJob", "start_axis"]

#: Positions on the axes.
Place = tuple[int, ...]
#: A place and its figures, in the order of the job's fields.
Record = tuple[Place, NDArray[np.float64]]
#: Takes the number of rollouts done, and how many there will be as far as is known by then.
OnProgress = Callable[[float, float], None]


class Axis(NamedTuple):
    """One axis of a map.

    Attributes:
        values: Strictly increasing, shape (n,).
        unit: Their unit.
        meaning: What they are.
    """

    values: NDArray[Any]
    unit: str
    meaning: str


def start_axis(count: int) -> Axis:
    """The axis of several rollouts from one place."""
    return Axis(np.arange(count), "1", "number of the start")


class Field(NamedTuple):
    """One figure of a record.

    Attributes:
        unit: Its unit.
        meaning: What it is.
    """

    unit: str
    meaning: str


class SweepJob(Protocol):
    """All that a worker needs; it travels once, by pickle."""

    @property
    def kind(self) -> str:
        """What kind of map this is, in a word."""
        ...

    @property
    def store_axes(self) -> Mapping[str, Axis]:
        """Four axes by name: of layers, rows, columns and starts."""
        ...

    @property
    def fields(self) -> Mapping[str, Field]:
        """Figures of a record; the first is never NaN."""
        ...

    @property
    def batch(self) -> int:
        """Rollouts in a task: a task costs the scheduler about 2 ms."""
        ...

    @property
    def adaptive(self) -> bool:
        """Whether only places near the boundary of a yes in each layer are run."""
        ...

    def identity(self) -> dict[str, Any]:
        """Robot, version, axes and settings that all records share, as plain values."""
        ...

    def run(self, places: Sequence[Place]) -> list[Record]:
        """Compute the records of some places."""
        ...

    def succeeded(self, records: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether a record says yes, shape (...) from (..., fields); NaN records say no."""
        ...
