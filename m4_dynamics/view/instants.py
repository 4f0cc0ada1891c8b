"""Which instants of a run a picture shows: those that tell its story, few enough to be seen side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray
from numpy.typing import NDArray

from m4_dynamics.errors import ResultFileError
from m4_dynamics.view.phases import PhaseSpan, balancing_samples, phases_of

__all__ = ["Instant", "climbing_instants", "transformation_instants", "way_instants"]

_RAISING = (0.12, 0.5, 0.88)  # shares of the change of pitch at which raising is shown
_SITTING = (0.45, 0.99)
_SETTLED = 1.0  # [s] after which the robot balances quietly


@dataclass(frozen=True, slots=True)
class Instant:
    """One instant of a run.

    Attributes:
        sample: Its sample.
        time: When [s].
        phase: Name of the phase, or "".
        colour: The phase's colour, sRGB hex, or "".
        on_the_spot: Whether the robot changes its shape there rather than drives.
    """

    sample: int
    time: float
    phase: str = ""
    colour: str = ""
    on_the_spot: bool = False


def transformation_instants(dataset: xarray.Dataset) -> list[Instant]:
    """From four wheels to two and back: morphing, raising, balancing, touching down (paper, Fig. m4_experiment).

    Args:
        dataset: A mission's trajectory.

    Returns:
        The instants in order: the beginning, the end of each change of posture, three instants of raising, one of
        balancing, two of sitting down, and the middle of the last change of posture.

    Raises:
        ResultFileError: The run has no phases that change the robot's shape.
    """
    phases = phases_of(dataset)
    changing = [phase for phase in phases if phase.kind in ("morph", "raise", "sit")]
    if not changing:
        raise ResultFileError("the run has no phase in which the robot changes its shape: it is no such mission")
    chosen = [_instant(dataset, phases[0], phases[0].first)]
    balanced = False
    for phase in phases:
        if phase.kind == "morph":
            if balanced:
                chosen.append(_instant(dataset, phase, (phase.first + phase.last) // 2))
            chosen.append(_instant(dataset, phase, phase.last - 1))
        elif phase.kind in ("raise", "sit"):
            shares = _RAISING if phase.kind == "raise" else _SITTING
            chosen += [_instant(dataset, phase, sample) for sample in _by_pitch(dataset, phase, shares)]
        elif phase.balances and not balanced:
            time = np.asarray(dataset["time"].values[phase.first : phase.last], dtype=float)
            settled = int(np.searchsorted(time, time[0] + _SETTLED))
            chosen.append(_instant(dataset, phase, phase.first + min(settled, len(time) - 1)))
            balanced = True
    return chosen


def way_instants(dataset: xarray.Dataset, *, along: int) -> list[Instant]:
    """From the start to the farthest place of the way: the change of shape, then places evenly spaced along the way.

    Args:
        dataset: A trajectory.
        along: Number of places along the way, 2 at least.

    Returns:
        The instants in order. A run without phases has only those along the way.

    Raises:
        ResultFileError: The robot never balanced, or the trajectory has no travel.
    """
    top = _farthest(dataset)
    phases = phases_of(dataset)
    chosen = []
    if phases and not phases[0].balances:
        chosen.append(_instant(dataset, phases[0], phases[0].first))
    for phase in phases:
        if phase.last > top or phase.balances:
            break
        if phase.kind == "morph":
            samples = [(phase.first + phase.last) // 2, phase.last - 1]
        elif phase.kind == "raise":
            samples = _by_pitch(dataset, phase, (0.5,))
        else:
            continue
        chosen += [_instant(dataset, phase, sample) for sample in samples]
    return chosen + _spread_along(dataset, int(np.argmax(balancing_samples(dataset))), top, along)


def climbing_instants(dataset: xarray.Dataset, *, along: int) -> list[Instant]:
    """Up a slope: places evenly spaced from where the wheels meet it to the farthest one (paper, Fig. wair_experiment).

    Args:
        dataset: A trajectory.
        along: Number of places, 2 at least.

    Returns:
        The instants in order.

    Raises:
        ResultFileError: The robot never was on a slope while it balanced, or the trajectory has no travel.
    """
    top = _farthest(dataset)
    on_slope = balancing_samples(dataset) & (np.asarray(dataset["slope"].values) > 1e-3)
    if not on_slope[: top + 1].any():
        raise ResultFileError("the robot never climbed in this run: no sample on a slope while it balanced")
    return _spread_along(dataset, int(np.argmax(on_slope)), top, along)


def _farthest(dataset: xarray.Dataset) -> int:
    """The sample at which a balancing robot was farthest along its way."""
    if "travel" not in dataset or "slope" not in dataset:
        raise ResultFileError("the trajectory has no variable travel or slope; the picture needs both")
    balancing = balancing_samples(dataset)
    if not balancing.any():
        raise ResultFileError("the robot never balanced in this run, so there is no way to show")
    travel = np.where(balancing, np.asarray(dataset["travel"].values, dtype=float), -np.inf)
    # The last centimetre takes long: where it is nearly reached the robot has arrived.
    return int(np.argmax(travel >= travel.max() - 0.01))


def _spread_along(dataset: xarray.Dataset, first: int, last: int, count: int) -> list[Instant]:
    travel = np.maximum.accumulate(np.asarray(dataset["travel"].values[first : last + 1], dtype=float))
    samples = first + np.searchsorted(travel, np.linspace(travel[0], travel[-1], count))
    phases = phases_of(dataset)
    return [_instant(dataset, _phase_at(phases, int(sample)), int(sample)) for sample in samples]


def _phase_at(phases: tuple[PhaseSpan, ...], sample: int) -> PhaseSpan | None:
    return next((phase for phase in phases if phase.first <= sample < phase.last), None)


def _by_pitch(dataset: xarray.Dataset, phase: PhaseSpan, shares: tuple[float, ...]) -> list[int]:
    """Samples of a phase at which the pitch has gone through given shares of its change."""
    pitch: NDArray[np.float64] = np.asarray(dataset["state"].values[phase.first : phase.last, 1], dtype=float)
    if abs(pitch[-1] - pitch[0]) < 1e-6:
        return [phase.first + round(share * (len(pitch) - 1)) for share in shares]
    progress = np.maximum.accumulate((pitch - pitch[0]) / (pitch[-1] - pitch[0]))
    return [phase.first + min(int(np.searchsorted(progress, share)), len(pitch) - 1) for share in shares]


def _instant(dataset: xarray.Dataset, phase: PhaseSpan | None, sample: int) -> Instant:
    time = float(dataset["time"].values[sample])
    if phase is None:
        return Instant(sample, time)
    return Instant(sample, time, phase.label, phase.colour, phase.kind in ("hold", "morph", "raise", "sit"))
