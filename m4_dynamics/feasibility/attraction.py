"""Region of attraction: from which pitches, pitch rates and wheel speeds a robot comes back to its equilibrium."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.feasibility.attraction_rollout import (
    ATTRACTION_FIELDS,
    OUTCOME_FIELDS,
    OUTCOMES,
    Outcome,
    Stand,
    Start,
    outcome_code,
    run_start,
)
from m4_dynamics.feasibility.cell import PlantName, require_sweep_settings, require_within
from m4_dynamics.feasibility.grid import checked_axis
from m4_dynamics.feasibility.job import Axis, Field, Place, Record, start_axis
from m4_dynamics.feasibility.provenance import robot_provenance, sweep_identity
from m4_dynamics.feasibility.rollout import BATCHES
from m4_dynamics.feasibility.run import settled_answer
from m4_dynamics.feasibility.store import SweepStore
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import ClimbSettings, prepare_climb
from m4_dynamics.simulation.controllers import ControllerName

if TYPE_CHECKING:
    import xarray

__all__ = [
    "START_AXES",
    "AttractionGrid",
    "AttractionJob",
    "AttractionSettings",
    "Reach",
    "attraction_dataset",
    "make_attraction_job",
    "reach",
]

_Array = NDArray[np.float64]
_Bool = NDArray[np.bool_]


class _AxisRange(NamedTuple):
    unit: str
    meaning: str
    high: float


#: Axis -> unit, meaning and greatest size, in the order of a map's dimensions.
START_AXES: dict[str, _AxisRange] = {
    "wheel_speed": _AxisRange("m/s", "initial speed of the axle uphill, the wheels rolling", 10.0),
    "pitch_error": _AxisRange("rad", "initial pitch less the equilibrium's", math.pi),
    "pitch_rate": _AxisRange("rad/s", "initial pitch rate", 100.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class AttractionGrid:
    """Axes of starts; each strictly increasing.

    Attributes:
        wheel_speed: Speed of the axle uphill while the wheels roll, shape (k,) [m/s].
        pitch_error: Pitch less the equilibrium's, shape (n,) [rad].
        pitch_rate: Shape (m,) [rad/s].
    """

    wheel_speed: ArrayLike
    pitch_error: ArrayLike
    pitch_rate: ArrayLike

    def __post_init__(self) -> None:
        """Check the axes.

        Raises:
            InvalidSettingError: Names the axis and the entry that is not valid.
        """
        for name, (unit, _, high) in START_AXES.items():
            values = checked_axis(name, getattr(self, name), unit=unit, low=-high, high=high)
            object.__setattr__(self, name, values)

    @property
    def axes(self) -> dict[str, _Array]:
        """Axis -> values, in the order of a map's dimensions."""
        return {name: np.asarray(getattr(self, name)) for name in START_AXES}

    @property
    def cells(self) -> int:
        """Number of cells."""
        return math.prod(len(values) for values in self.axes.values())

    def as_dict(self) -> dict[str, Any]:
        """Plain values: what a stored map is compared by."""
        return {name: values.tolist() for name, values in self.axes.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class AttractionSettings:
    """Which equilibrium, under which controller, on which model.

    Attributes:
        slope: Inclination of the ground [rad].
        friction: mu_s of the ground; None takes the robot's own.
        thrust: Total thrust of the equilibrium [N]; None chooses one inside all limits.
        plant: "full" simulates the full model, and the reduced one beside it; "mip" the reduced one alone.
        controller: See `ClimbSettings.controller`.
        duration: Of a rollout [s].
        starts: Rollouts in each cell, with different headings.
        seed: Of the headings; one depends on it and on the cell's place on the axes alone.
        yaw_error_max: Initial headings are uniform up to this, either way [rad].
        adaptive: Whether only cells near the region's boundary are run, see `refine_boundary`.
    """

    slope: float
    friction: float | None = None
    thrust: float | None = None
    plant: PlantName = "full"
    controller: ControllerName = "default"
    duration: float = 3.0
    starts: int = 1
    seed: int = 0
    yaw_error_max: float = math.radians(0.5)
    adaptive: bool = False

    def __post_init__(self) -> None:
        """Check the settings that a climb does not check.

        Raises:
            InvalidSettingError: Names the setting.
        """
        require_sweep_settings(plant=self.plant, controller=self.controller, starts=self.starts, seed=self.seed)
        require_within(self, {"duration": (0.5, 600.0), "yaw_error_max": (0.0, math.radians(90.0))})
        if self.plant == "mip" and self.starts > 1:
            raise InvalidSettingError("starts", self.starts, "1 on the reduced model: starts differ in heading alone")

    def as_dict(self) -> dict[str, Any]:
        """Plain values: what a stored map is compared by."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False)
class AttractionJob:
    """All that a worker needs; see `SweepJob`.

    Attributes:
        stand: The robot at its equilibrium.
        grid: The starts.
        settings: What they have in common.
    """

    stand: Stand
    grid: AttractionGrid
    settings: AttractionSettings

    @property
    def kind(self) -> str:
        """See `SweepJob`."""
        return "attraction"

    @property
    def store_axes(self) -> dict[str, Axis]:
        """Wheel speed, pitch error, pitch rate and start."""
        axes = {name: Axis(values, *START_AXES[name][:2]) for name, values in self.grid.axes.items()}
        return {**axes, "start": start_axis(self.settings.starts)}

    @property
    def fields(self) -> dict[str, Field]:
        """See `ATTRACTION_FIELDS`."""
        return ATTRACTION_FIELDS

    @property
    def batch(self) -> int:
        """See `SweepJob`."""
        return BATCHES[self.settings.plant]

    @property
    def adaptive(self) -> bool:
        """See `AttractionSettings`."""
        return self.settings.adaptive

    def identity(self) -> dict[str, Any]:
        """Robot, version, axes and settings."""
        return sweep_identity(self.stand.robot, self.grid, self.settings)

    def start(self, place: Place) -> Start:
        """The start of a place: the same whatever else is computed, in whatever order."""
        speed, pitch, rate = (float(axis[i]) for axis, i in zip(self.grid.axes.values(), place, strict=False))
        yaw = 0.0
        if self.settings.plant == "full":
            drawn = np.random.default_rng([self.settings.seed, *place]).uniform(-1.0, 1.0)
            yaw = self.settings.yaw_error_max * float(drawn)
        return Start(speed, pitch, rate, yaw)

    def run(self, places: Sequence[Place]) -> list[Record]:
        """Run some starts; their records hold `ATTRACTION_FIELDS`."""
        return [(place, run_start(self.stand, self.start(place))) for place in places]

    def succeeded(self, records: _Array) -> _Bool:
        """Whether the robot came back. On the full model a slide does not matter, on the reduced one it does."""
        return self.came_back(records[..., 0], slides=self.settings.plant == "full")

    def came_back(self, codes: _Array, *, slides: bool) -> _Bool:
        """Whether codes of outcomes say that the robot came back.

        Args:
            codes: Any shape.
            slides: Whether a return after a slide counts.
        """
        back = codes == outcome_code(Outcome.RETURNED)
        return np.asarray(back | (codes == outcome_code(Outcome.SLID)) if slides else back)


def make_attraction_job(robot: Robot, grid: AttractionGrid, settings: AttractionSettings) -> AttractionJob:
    """Find the equilibrium and put together what workers need.

    Args:
        robot: A robot that balances.
        grid: The starts.
        settings: What they have in common.

    Returns:
        The job.

    Raises:
        NoTrimExists: No equilibrium satisfies the limits on this slope.
        RobotDescriptionError: The robot does not balance.
        InvalidSettingError: A setting is not valid.
    """
    friction = robot.ground.friction_static if settings.friction is None else settings.friction
    standing = ClimbSettings(
        slope=settings.slope,
        friction_static=friction,
        speed=0.0,
        thrust=settings.thrust,
        controller=settings.controller,
        duration=settings.duration,
        start_time=0.0,
        ramp_time=0.25 * settings.duration,
        hold_time=0.0,
        pitch_error=0.0,
        yaw_error=0.0,
    )
    climb = prepare_climb(robot, standing)
    stand = Stand(robot.without_visuals(), climb.reduction, climb.trim, climb.reference, standing, settings.plant)
    return AttractionJob(stand, grid, settings)


def attraction_dataset(store: SweepStore, job: AttractionJob, *, command: str = "") -> xarray.Dataset:
    """Label a store's records.

    Args:
        store: The store; starts that are missing are NaN, their outcome is -1.
        job: The job.
        command: The command line, for the record.

    Returns:
        The map, dimensions (wheel_speed, pitch_error, pitch_rate, start): the figures of `ATTRACTION_FIELDS`;
        `returns`: every start of the cell came back, in an adaptive map concluded from the cells around where nothing
        was run; `returns_reduced`: the same on the reduced model, where it was run.
    """
    import xarray

    records, trim = store.read(), job.stand.trim
    axes = job.store_axes
    cell = tuple(axes)[:3]
    variables: dict[str, Any] = {}
    for k, (name, field) in enumerate(ATTRACTION_FIELDS.items()):
        values: Any = records[..., k]
        attributes: dict[str, Any] = {"units": field.unit, "long_name": field.meaning}
        if name in OUTCOME_FIELDS:
            values = np.where(np.isnan(values), -1, values).astype(np.int8)
            attributes["flag_values"] = list(range(len(OUTCOMES)))
            attributes["flag_meanings"] = " ".join(OUTCOMES)
        variables[name] = (tuple(axes), values, attributes)
    reduced = job.came_back(variables["outcome_reduced"][1], slides=False).all(axis=-1)
    for name, values, where in (
        ("returns", settled_answer(job, store), "every start came back"),
        ("returns_reduced", reduced, "every start that was run comes back on the reduced model, without want of grip"),
    ):
        variables[name] = (cell, values, {"units": "1", "long_name": where})
    coordinates = {
        name: ((name,), axis.values, {"units": axis.unit, "long_name": axis.meaning}) for name, axis in axes.items()
    }
    dataset = xarray.Dataset(variables, coordinates)
    dataset.attrs.update(
        robot_provenance(job.stand.robot, command=command),
        kind=job.kind,
        settings=json.dumps(job.settings.as_dict()),
        plant=job.settings.plant,
        slope=trim.slope,
        friction=job.stand.climb.friction_static,
        trim_pitch=trim.pitch,
        trim_thrust=trim.thrust,
        trim_friction_needed=trim.friction_needed,
    )
    return dataset


class Reach(NamedTuple):
    """How far a region reaches from the equilibrium at one wheel speed, without a gap.

    Attributes:
        pitch: Least and greatest pitch error that comes back from the least pitch rate on the axis [rad].
        rate: Least and greatest pitch rate that comes back from the least pitch error on the axis [rad/s].
        share: Share of the cells that come back.
        bounded: Whether it ends on every side before the axes do.
    """

    pitch: tuple[float, float]
    rate: tuple[float, float]
    share: float
    bounded: bool


def reach(dataset: xarray.Dataset, wheel_speed: int) -> Reach:
    """Measure a region of attraction.

    Args:
        dataset: The map.
        wheel_speed: Position on the axis of the wheel's speed.

    Returns:
        Its size; NaN where the start nearest to the equilibrium does not come back.
    """
    returns = dataset["returns"].isel(wheel_speed=wheel_speed).to_numpy()
    pitch, rate = dataset["pitch_error"].to_numpy(), dataset["pitch_rate"].to_numpy()
    i, j = int(np.argmin(np.abs(pitch))), int(np.argmin(np.abs(rate)))
    bounded = not (returns[[0, -1], :].any() or returns[:, [0, -1]].any())
    return Reach(
        _run_about(pitch, returns[:, j], i), _run_about(rate, returns[i, :], j), float(returns.mean()), bounded
    )


def _run_about(values: _Array, holds: _Bool, middle: int) -> tuple[float, float]:
    """First and last value of the unbroken run of True that holds the middle."""
    if not holds[middle]:
        return math.nan, math.nan
    first = last = middle
    while first > 0 and holds[first - 1]:
        first -= 1
    while last < len(values) - 1 and holds[last + 1]:
        last += 1
    return float(values[first]), float(values[last])
