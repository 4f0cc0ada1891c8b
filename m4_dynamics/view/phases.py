"""The phases of a mission, as its trajectory tells them: when each began and ended, and what the robot did in it."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import xarray
from numpy.typing import NDArray

from m4_dynamics.errors import ResultFileError
from m4_dynamics.view.style import COLOURS

__all__ = [
    "PREDICTIVE_CONTROLLERS",
    "PhaseSpan",
    "balancing_samples",
    "corner_times",
    "phases_of",
    "predictive_samples",
]

#: Controllers that minimise a cost over a horizon (paper, section IV).
PREDICTIVE_CONTROLLERS = ("default", "paper", "paper-zero")

_ONE_CORNER = 0.5  # [s] turns of the slope that follow each other more quickly belong to one corner

# Kind of phase -> colour of its band; balancing has two, with and without prediction.
_COLOURS = {
    "hold": COLOURS["slate"],
    "morph": COLOURS["orange"],
    "raise": COLOURS["purple"],
    "sit": COLOURS["purple"],
    "balance": COLOURS["green"],
    "predictive": COLOURS["blue"],
    "safe": COLOURS["vermilion"],
}


@dataclass(frozen=True, slots=True)
class PhaseSpan:
    """One phase of a run.

    Attributes:
        name: Its name.
        kind: "hold", "morph", "raise", "balance", "sit" or, after an abort, "safe".
        controller: Of a balancing phase, else "".
        first: Its first sample.
        last: The sample after its last.
        start: When it began [s].
        end: When the next one began, or the run ended [s].
    """

    name: str
    kind: str
    controller: str
    first: int
    last: int
    start: float
    end: float

    def within(self, start: float, end: float) -> PhaseSpan:
        """The part of the phase between two moments [s]; its samples stay."""
        return replace(self, start=max(self.start, start), end=min(self.end, end))

    @property
    def balances(self) -> bool:
        """Whether a controller balanced the robot on its drive wheels."""
        return self.kind == "balance"

    @property
    def predicts(self) -> bool:
        """Whether that controller was a predictive one."""
        return self.balances and self.controller in PREDICTIVE_CONTROLLERS

    @property
    def label(self) -> str:
        """Name and, where one balances, the kind of controller."""
        if not self.balances:
            return self.name
        return f"{self.name} ({'MPC' if self.predicts else self.controller.upper()})"

    @property
    def colour(self) -> str:
        """Colour of what goes on, sRGB hex."""
        return _COLOURS.get("predictive" if self.predicts else self.kind, COLOURS["slate"])


def phases_of(dataset: xarray.Dataset) -> tuple[PhaseSpan, ...]:
    """The phases that a run went through, in order.

    Args:
        dataset: A trajectory.

    Returns:
        The phases; none for a run that was no mission.

    Raises:
        ResultFileError: The trajectory's phases don't fit together.
    """
    names, kinds, controllers = (_words(dataset, key) for key in ("phases", "phase_kinds", "phase_controllers"))
    if not names or not kinds or "phase" not in dataset:
        return ()
    time, index = np.asarray(dataset["time"].values, dtype=float), np.asarray(dataset["phase"].values, dtype=int)
    if not len(names) == len(kinds) == len(controllers) or index.min() < 0 or index.max() >= len(names):
        raise ResultFileError(
            f"the trajectory names {len(names)} phases, {len(kinds)} kinds and {len(controllers)} controllers, and its "
            f"samples belong to phases {index.min()} to {index.max()}: they don't fit together"
        )
    starts = [0, *(np.flatnonzero(np.diff(index)) + 1).tolist(), len(time)]
    return tuple(
        PhaseSpan(
            name=names[index[first]],
            kind=kinds[index[first]],
            controller=controllers[index[first]].replace("none", ""),
            first=first,
            last=last,
            start=float(time[first]),
            end=float(time[min(last, len(time) - 1)]),
        )
        for first, last in itertools.pairwise(starts)
    )


def balancing_samples(dataset: xarray.Dataset) -> NDArray[np.bool_]:
    """Samples at which the robot balanced on its drive wheels: all of a plain climb, the balancing phases of a mission.

    Args:
        dataset: A trajectory.

    Returns:
        Truth values, shape (time,).
    """
    return _samples(dataset, "balances", otherwise=True)


def predictive_samples(dataset: xarray.Dataset) -> NDArray[np.bool_]:
    """Samples at which a predictive controller balanced the robot.

    Args:
        dataset: A trajectory.

    Returns:
        Truth values, shape (time,).
    """
    return _samples(dataset, "predicts", otherwise=dataset.attrs.get("controller") in PREDICTIVE_CONTROLLERS)


def corner_times(dataset: xarray.Dataset) -> NDArray[np.float64]:
    """When the balancing robot's wheels came to a corner of the terrain.

    Args:
        dataset: A trajectory.

    Returns:
        Times, shape (k,) [s]; the arc over a convex corner, where the slope turns bit by bit, counts once.
    """
    if "slope" not in dataset:
        return np.empty(0)
    slope = np.asarray(dataset["slope"].values, dtype=float)
    turned = np.flatnonzero(np.diff(slope) != 0.0) + 1
    times = np.asarray(dataset["time"].values[turned[balancing_samples(dataset)[turned]]], dtype=float)
    return times[np.diff(times, prepend=-np.inf) > _ONE_CORNER]


def _samples(dataset: xarray.Dataset, what: str, *, otherwise: bool) -> NDArray[np.bool_]:
    phases = phases_of(dataset)
    if not phases:
        return np.full(dataset.sizes["time"], otherwise)
    chosen = np.zeros(dataset.sizes["time"], dtype=bool)
    for phase in phases:
        chosen[phase.first : phase.last] = getattr(phase, what)
    return chosen


def _words(dataset: xarray.Dataset, key: str) -> list[str]:
    """A list of words among the attributes; a file gives a list of one back as a plain string."""
    value = dataset.attrs.get(key, [])
    return [value] if isinstance(value, str) else [str(one) for one in value]
