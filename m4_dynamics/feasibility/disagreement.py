"""Where rollouts and statics disagree, and the effect that sets them apart."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.feasibility.cell import RolloutSettings
from m4_dynamics.feasibility.limits import Limit
from m4_dynamics.reduced.equilibrium import equilibrium_loads, equilibrium_pitches
from m4_dynamics.reduced.reduction import Reduction
from m4_dynamics.reduced.trim_limits import trim_margins

if TYPE_CHECKING:
    import xarray

__all__ = ["EFFECTS", "EFFECT_LABELS", "Agreement", "Effect", "agreement", "explain", "next_to_boundary"]

_Bool = NDArray[np.bool_]

#: Largest acceleration of the reference's ramp, in units of speed over ramp time.
_RAMP_PEAK = 2.1875
#: An input at its limit for longer than this had no authority left there [s].
_SATURATED_LONG = 0.1
#: A slide longer than this is judged a slip, as in the verdict [s].
_SLID_LONG = 0.1


class Effect(IntEnum):
    """What sets statics and rollouts apart in a cell.

    Attributes:
        NONE: They agree.
        THRUST_BOUND: The equilibrium lies on a bound of the thrust, where a controller has no authority downwards or
            upwards.
        PLANNING_MARGIN: On the reduced model it climbs if the controller plans with all the friction there is.
        START_TRANSIENT: On the reduced model it climbs from a start without error.
        MARGIN_AND_TRANSIENT: On the reduced model it climbs without the margin and without the error, not with either.
        ACCELERATION: At the peak acceleration of moving off or stopping no equilibrium is within the limits; the
            statics are those of a steady climb.
        SLIP: A wheel slid while the robot recovered or followed, for more than 0.1 s in all; the grip of a wheel that
            slides is less than what the equilibrium needs, so that it does not come back.
        MOTOR_SPEED: The duty saturated.
        RESERVE: It climbs although the equilibrium falls short of a reserve (clearance, normal force, pitch window).
        FULL_MODEL: The reduced model climbs from the same start, the full one does not.
        UNEXPLAINED: None of these.
    """

    NONE = 0
    THRUST_BOUND = 1
    PLANNING_MARGIN = 2
    START_TRANSIENT = 3
    MARGIN_AND_TRANSIENT = 4
    ACCELERATION = 5
    SLIP = 6
    MOTOR_SPEED = 7
    RESERVE = 8
    FULL_MODEL = 9
    UNEXPLAINED = 10


EFFECT_LABELS: dict[Effect, str] = {
    Effect.NONE: "agreement",
    Effect.THRUST_BOUND: "thrust at its bound",
    Effect.PLANNING_MARGIN: "controller's friction margin",
    Effect.START_TRANSIENT: "start transient",
    Effect.MARGIN_AND_TRANSIENT: "friction margin and start transient",
    Effect.ACCELERATION: "acceleration of the ramps",
    Effect.SLIP: "slip",
    Effect.MOTOR_SPEED: "motor speed",
    Effect.RESERVE: "reserve of the limit",
    Effect.FULL_MODEL: "full model",
    Effect.UNEXPLAINED: "unexplained",
}
#: Names in the order of their codes.
EFFECTS: tuple[str, ...] = tuple(effect.name.lower() for effect in Effect)


def explain(dataset: xarray.Dataset, reduction: Reduction, settings: RolloutSettings) -> NDArray[np.int8]:
    """Name the effect in every cell; of several that apply the first in the order of `Effect`.

    Args:
        dataset: A closed-loop map, still without this layer.
        reduction: The robot as a pendulum.
        settings: Of the rollouts.

    Returns:
        Codes of `Effect`, shape (friction, slope, thrust).
    """
    climbs = dataset["climbs"].to_numpy()
    static = dataset["static_feasible"].to_numpy()
    known = (dataset["verdict"] >= 0).all("start").to_numpy()
    stopped, surprising = known & static & ~climbs, known & ~static & climbs
    thrust = dataset["thrust"].to_numpy()
    failing = dataset["verdict"] > 0

    def longest(name: str) -> NDArray[np.float64]:
        return np.asarray(dataset[name].where(failing).fillna(0.0).max("start").to_numpy())

    def helps(name: str) -> _Bool:
        return np.asarray(((dataset[name] == 0) | ~failing).all("start").to_numpy())

    on_bound = (thrust <= 1e-6) | (thrust >= reduction.thrust_max - 1e-6)
    limit = dataset["static_limit"].to_numpy()
    reduced_climbs = (dataset["verdict_reduced"] == 0).all("start").to_numpy()
    rules: list[tuple[Effect, _Bool]] = [
        (Effect.THRUST_BOUND, stopped & on_bound),
        (Effect.PLANNING_MARGIN, stopped & helps("without_margin")),
        (Effect.START_TRANSIENT, stopped & helps("without_error")),
        (Effect.MARGIN_AND_TRANSIENT, stopped & helps("without_both")),
        (Effect.ACCELERATION, stopped & ~_ramp_feasible(dataset, reduction, settings)),
        (Effect.SLIP, stopped & (longest("slip_time") + longest("slip_time_start") > _SLID_LONG)),
        (Effect.MOTOR_SPEED, stopped & (longest("duty_saturated") > _SATURATED_LONG)),
        (Effect.MOTOR_SPEED, surprising & np.isin(limit, (Limit.MOTOR_SPEED, Limit.TORQUE))),
        (Effect.RESERVE, surprising & np.isin(limit, (Limit.CLEARANCE, Limit.NORMAL_FORCE, Limit.PITCH_WINDOW))),
        (Effect.FULL_MODEL, stopped & reduced_climbs & (settings.plant == "full")),
        (Effect.UNEXPLAINED, stopped | surprising),
    ]
    codes = np.zeros(climbs.shape, dtype=np.int8)
    for effect, applies in rules:
        codes[(codes == 0) & applies] = effect
    return codes


def _ramp_feasible(dataset: xarray.Dataset, reduction: Reduction, settings: RolloutSettings) -> _Bool:
    """Whether equilibria at the ramps' peak accelerations keep all limits, shape (friction, slope, thrust)."""
    parameters = reduction.parameters
    slope, thrust = dataset["slope"].to_numpy()[:, None], dataset["thrust"].to_numpy()[None, :]
    peak = _RAMP_PEAK * abs(settings.speed) / settings.ramp_time
    kept = []
    for friction in dataset["friction"].to_numpy():
        limits = reduction.trim_limits(friction_static=float(friction))
        both = np.ones(np.broadcast_shapes(slope.shape, thrust.shape), dtype=bool)
        for acceleration in (peak, -peak):
            pitch = equilibrium_pitches(parameters, slope, thrust, acceleration=acceleration)
            loads = equilibrium_loads(parameters, slope, thrust, pitch, speed=settings.speed, acceleration=acceleration)
            margins = trim_margins(limits, slope, thrust, pitch, loads, parameters.wheel_radius)
            both &= margins.satisfied.any(axis=0)
        kept.append(both)
    return np.stack(kept)


def next_to_boundary(feasible: _Bool, thrust: NDArray[np.float64], thrust_max: float) -> _Bool:
    """Cells of which a neighbour, diagonal ones included, differs; outside the thrusters' range nothing is feasible.

    Args:
        feasible: Shape (friction, slope, thrust).
        thrust: Axis of thrust [N].
        thrust_max: Greatest thrust [N]; 0: a robot without thrusters, whose thrust has no bound to be next to.

    Returns:
        Shape of `feasible`.
    """
    padded = np.pad(feasible, ((0, 0), (1, 1), (1, 1)), mode="edge")
    if thrust_max > 0.0:
        if thrust[0] <= 0.0:
            padded[:, :, 0] = False
        if thrust[-1] >= thrust_max:
            padded[:, :, -1] = False
    near = np.zeros(feasible.shape, dtype=bool)
    for i in range(3):
        for j in range(3):
            near |= padded[:, i : i + feasible.shape[1], j : j + feasible.shape[2]] != feasible
    return near


class Agreement(NamedTuple):
    """How far statics and rollouts agree.

    Attributes:
        cells: All cells.
        agreeing: Share of all cells in which they agree.
        inner: Cells that are not next to the static map's boundary.
        agreeing_inner: Share of those in which they agree.
        simulated: Inner cells that have an equilibrium to start from, so that there were rollouts.
        agreeing_simulated: Share of those in which they agree.
        reduced: Share of the cells that were run in which reduced and full model agree on whether the robot climbs.
        effects: Effect -> cells, where they disagree.
        effects_inner: The same for the inner cells.
    """

    cells: int
    agreeing: float
    inner: int
    agreeing_inner: float
    simulated: int
    agreeing_simulated: float
    reduced: float
    effects: dict[Effect, int]
    effects_inner: dict[Effect, int]


def agreement(dataset: xarray.Dataset) -> Agreement:
    """Compare the layers of a closed-loop map.

    Args:
        dataset: The map.

    Returns:
        Counts and shares.
    """
    static, climbs = dataset["static_feasible"].to_numpy(), dataset["climbs"].to_numpy()
    same = static == climbs
    inner = ~next_to_boundary(static, dataset["thrust"].to_numpy(), float(dataset.attrs["thrust_max"]))
    tried = inner & (dataset["simulated_time"] > 0.0).any("start").to_numpy()
    known = (dataset["verdict"] >= 0).all("start").to_numpy()
    reduced = (dataset["verdict_reduced"] == 0).all("start").to_numpy()
    codes = dataset["disagreement"].to_numpy()

    def counts(among: _Bool) -> dict[Effect, int]:
        chosen = codes[among & (codes > 0)]
        return {effect: int((chosen == effect).sum()) for effect in Effect if (chosen == effect).any()}

    return Agreement(
        cells=same.size,
        agreeing=float(same.mean()),
        inner=int(inner.sum()),
        agreeing_inner=float(same[inner].mean()) if inner.any() else float("nan"),
        simulated=int(tried.sum()),
        agreeing_simulated=float(same[tried].mean()) if tried.any() else float("nan"),
        reduced=float((reduced == climbs)[known].mean()) if known.any() else float("nan"),
        effects=counts(np.ones_like(inner)),
        effects_inner=counts(inner),
    )
