"""One cell of a closed-loop map: what is asked of it, and the record of what came out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.feasibility.job import Field
from m4_dynamics.simulation.controllers import CONTROLLERS, ControllerName
from m4_dynamics.simulation.verdict import Verdict

__all__ = [
    "FIELDS",
    "PLANTS",
    "VERDICTS",
    "VERDICT_FIELDS",
    "CellIndex",
    "PlantName",
    "RolloutSettings",
    "StartErrors",
    "require_sweep_settings",
    "require_within",
    "start_errors",
    "verdict_code",
]

PlantName = Literal["full", "mip"]
PLANTS: tuple[str, ...] = get_args(PlantName)

#: Figures that are verdicts.
VERDICT_FIELDS = ("verdict", "verdict_reduced", "without_margin", "without_error", "without_both")

#: Verdicts in the order of their codes in a map.
VERDICTS: tuple[Verdict, ...] = (
    Verdict.CLIMBED,
    Verdict.LAGGED,
    Verdict.SLIPPED,
    Verdict.FELL,
    Verdict.INFEASIBLE,
    Verdict.ABORTED,
)


class CellIndex(NamedTuple):
    """Where a rollout belongs: positions on the axes of the map."""

    friction: int
    slope: int
    thrust: int
    start: int


#: Figures of a rollout, in the order of a record. NaN: not simulated, or not known for this plant.
FIELDS: dict[str, Field] = {
    "verdict": Field("1", "how the rollout ended"),
    "verdict_reduced": Field("1", "how the same start ends on the reduced model"),
    "without_margin": Field("1", "verdict on the reduced model if the controller plans with all the friction"),
    "without_error": Field("1", "verdict on the reduced model from a start without error"),
    "without_both": Field("1", "verdict on the reduced model with neither friction margin nor error of the start"),
    "slip_time": Field(
        "s", "time that a wheel slid after the first half second (reduced model: would need more grip than there is)"
    ),
    "slip_time_start": Field("s", "the same in the first half second, in which it does not count for the verdict"),
    "slip_distance": Field("m", "distance slid by the worst wheel"),
    "air_time": Field("s", "time that a drive wheel was off the ground"),
    "duty_saturated": Field("s", "time at full duty"),
    "thrust_saturated": Field("s", "time at a bound of the thrust"),
    "solver_failures": Field("1", "control steps answered by the fallback"),
    "friction_used": Field("1", "largest friction over normal force along the slope, after the first half second"),
    "normal_force_min": Field("N", "least normal force, both drive wheels, after the first half second"),
    "duty_max": Field("1", "largest duty after the first half second"),
    "wheel_rms": Field("m", "axle travel against its reference, after the first second"),
    "pitch_rms": Field("rad", "pitch against its reference, after the first second"),
    "yaw_max": Field("rad", "largest heading error after the first second"),
    "climbed": Field("m", "travel of the axle along the slope"),
    "goal": Field("m", "travel asked for"),
    "simulated_time": Field("s", "simulated until the end or the fall"),
    "trim_pitch": Field("rad", "pitch of the equilibrium climbed at"),
    "pitch_error": Field("rad", "initial pitch less the reference's"),
    "yaw_error": Field("rad", "initial heading"),
    "elapsed": Field("s", "time that the computation took"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class RolloutSettings:
    """What every cell of a closed-loop map has in common.

    Attributes:
        plant: "full" simulates the full model, and the reduced one beside it; "mip" the reduced one alone.
        controller: See `ClimbSettings.controller`.
        speed: Cruising speed along the slope [m/s].
        duration: Of a rollout [s].
        start_time: Rest before the robot moves off [s].
        ramp_time: Time to reach the speed, and to stop [s].
        hold_time: Rest at the end [s].
        starts: Rollouts in each cell.
        seed: Of the starts; a start depends on it and on the cell's place on the axes alone.
        pitch_error_max: Initial pitch errors are uniform up to this, either way [rad].
        yaw_error_max: Initial headings likewise [rad].
        adaptive: Whether only cells near the boundary are run, see `refine_boundary`.
    """

    plant: PlantName = "full"
    controller: ControllerName = "default"
    speed: float = 0.2
    duration: float = 4.0
    start_time: float = 0.3
    ramp_time: float = 1.5
    hold_time: float = 0.5
    starts: int = 1
    seed: int = 0
    pitch_error_max: float = math.radians(5.0)
    yaw_error_max: float = math.radians(0.5)
    adaptive: bool = False

    def __post_init__(self) -> None:
        require_sweep_settings(plant=self.plant, controller=self.controller, starts=self.starts, seed=self.seed)
        require_within(
            self,
            {
                "speed": (-2.0, 2.0),
                "start_time": (0.0, 600.0),
                "ramp_time": (1e-3, 600.0),
                "hold_time": (0.0, 600.0),
                "pitch_error_max": (0.0, math.radians(90.0)),
                "yaw_error_max": (0.0, math.radians(90.0)),
            },
        )
        least = self.start_time + 2.0 * self.ramp_time + self.hold_time
        if not least - 1e-9 <= self.duration <= 600.0:
            raise InvalidSettingError("duration [s]", self.duration, f"{least:g} (rest, two ramps and hold) to 600")

    def as_dict(self) -> dict[str, Any]:
        """Plain values: what a stored map is compared by."""
        return asdict(self)


def require_sweep_settings(*, plant: str, controller: str, starts: int, seed: int) -> None:
    """Refuse settings that no sweep can have.

    Args:
        plant: One of `PLANTS`.
        controller: One of `CONTROLLERS`.
        starts: 1 to 1000.
        seed: 0 or above.

    Raises:
        InvalidSettingError: Names the setting.
    """
    if plant not in PLANTS:
        raise InvalidSettingError("plant", plant, "one of " + ", ".join(PLANTS))
    if controller not in CONTROLLERS:
        raise InvalidSettingError("controller", controller, "one of " + ", ".join(CONTROLLERS))
    if not (isinstance(starts, int) and 1 <= starts <= 1000):
        raise InvalidSettingError("starts", starts, "a whole number from 1 to 1000")
    if not (isinstance(seed, int) and 0 <= seed < 2**63):
        raise InvalidSettingError("seed", seed, "a whole number, 0 or above")


def require_within(settings: object, ranges: Mapping[str, tuple[float, float]]) -> None:
    """Refuse settings outside their ranges.

    Args:
        settings: Has the attributes.
        ranges: Attribute -> least and greatest value.

    Raises:
        InvalidSettingError: Names the first one that is outside or NaN.
    """
    for name, (low, high) in ranges.items():
        value = getattr(settings, name)
        if not low <= value <= high:
            raise InvalidSettingError(name, value, f"a number from {low:g} to {high:g}")


class StartErrors(NamedTuple):
    """How a rollout starts off its reference [rad]."""

    pitch: float
    yaw: float


def start_errors(settings: RolloutSettings, index: CellIndex) -> StartErrors:
    """Draw a start; the same for a cell whatever else is computed, in whatever order.

    Args:
        settings: Seed and sizes.
        index: The cell and the number of the start in it.

    Returns:
        Errors of pitch and heading.
    """
    generator = np.random.default_rng([settings.seed, *index])
    pitch, yaw = generator.uniform(-1.0, 1.0, 2)
    return StartErrors(float(settings.pitch_error_max * pitch), float(settings.yaw_error_max * yaw))


def verdict_code(verdict: Verdict | str) -> float:
    """Code of a verdict in a map."""
    return float(VERDICTS.index(Verdict(verdict)))
