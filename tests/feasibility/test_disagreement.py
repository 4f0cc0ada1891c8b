"""Effects that set statics and rollouts apart, on maps made up for each, and the shares of cells that agree."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray

from m4_dynamics.feasibility.cell import RolloutSettings
from m4_dynamics.feasibility.disagreement import Effect, agreement, explain, next_to_boundary
from m4_dynamics.feasibility.limits import Limit
from m4_dynamics.reduced.reduction import Reduction

CLIMBED, SLIPPED, FELL = 0, 2, 3
CELL, START = ("friction", "slope", "thrust"), ("friction", "slope", "thrust", "start")


def one_cell(
    *, slope_deg: float = 30.0, thrust: float = 12.0, feasible: bool = True, **values: float
) -> xarray.Dataset:
    """A map of one cell, which falls on both models in whatever way it is run, and slid on neither."""
    figures = {
        **dict.fromkeys(("verdict", "verdict_reduced", "without_margin", "without_error", "without_both"), FELL),
        **dict.fromkeys(("slip_time", "slip_time_start", "duty_saturated"), 0.0),
        **values,
    }
    variables = {name: (START, [[[[value]]]]) for name, value in figures.items() if name != "static_limit"}
    return xarray.Dataset(
        {
            **variables,
            "climbs": (CELL, [[[figures["verdict"] == CLIMBED]]]),
            "static_feasible": (CELL, [[[feasible]]]),
            "static_limit": (CELL, [[[int(values.get("static_limit", Limit.FRICTION))]]]),
        },
        {"friction": [0.8], "slope": [math.radians(slope_deg)], "thrust": [thrust], "start": [0]},
    )


@pytest.mark.parametrize(
    ("values", "effect"),
    [
        ({"verdict": CLIMBED}, Effect.NONE),
        ({"feasible": False}, Effect.NONE),
        ({"verdict": -1}, Effect.NONE),
        ({"thrust": 0.0}, Effect.THRUST_BOUND),
        ({"thrust": 43.2, "without_margin": CLIMBED}, Effect.THRUST_BOUND),
        ({"without_margin": CLIMBED}, Effect.PLANNING_MARGIN),
        ({"without_error": CLIMBED, "slip_time": 1.0}, Effect.START_TRANSIENT),
        ({"without_both": CLIMBED}, Effect.MARGIN_AND_TRANSIENT),
        # The climb needs 0.78 of 0.8 when it is steady, more while it speeds up.
        ({"slope_deg": 40.0, "thrust": 2.16}, Effect.ACCELERATION),
        ({"slip_time": 0.06, "slip_time_start": 0.05, "verdict_reduced": CLIMBED}, Effect.SLIP),
        ({"duty_saturated": 0.2}, Effect.MOTOR_SPEED),
        ({"verdict_reduced": CLIMBED, "slip_time": 0.09}, Effect.FULL_MODEL),
        ({}, Effect.UNEXPLAINED),
        ({"verdict": CLIMBED, "feasible": False, "static_limit": Limit.MOTOR_SPEED}, Effect.MOTOR_SPEED),
        ({"verdict": CLIMBED, "feasible": False, "static_limit": Limit.CLEARANCE}, Effect.RESERVE),
        ({"verdict": CLIMBED, "feasible": False, "static_limit": Limit.FRICTION}, Effect.UNEXPLAINED),
    ],
)
def test_each_effect_is_told_from_the_others(m4_reduction: Reduction, values: dict, effect: Effect) -> None:
    dataset = one_cell(**values)
    assert explain(dataset, m4_reduction, RolloutSettings()).tolist() == [[[effect]]]


def test_slower_ramps_take_the_acceleration_away(m4_reduction: Reduction) -> None:
    dataset = one_cell(slope_deg=40.0, thrust=2.16)
    slow = RolloutSettings(ramp_time=60.0, duration=150.0)
    assert explain(dataset, m4_reduction, slow).item() == Effect.UNEXPLAINED


def test_cells_next_to_the_boundary() -> None:
    feasible = np.zeros((1, 5, 6), dtype=bool)
    feasible[0, :, 2:] = True
    thrust = np.linspace(1.0, 20.0, 6)
    near = next_to_boundary(feasible, thrust, 43.2)[0]
    assert near.all(axis=0).tolist() == [False, True, True, False, False, False]
    assert near.any(axis=0).tolist() == near.all(axis=0).tolist()
    # Beyond the thrusters' bound nothing is feasible: its last column is next to a boundary too.
    assert next_to_boundary(feasible, thrust, 20.0)[0].all(axis=0).tolist() == [False, True, True, False, False, True]


def test_shares_of_agreement() -> None:
    shape = (1, 4, 5)
    static, climbs = np.ones(shape, dtype=bool), np.ones(shape, dtype=bool)
    static[0, 3], climbs[0, 3], climbs[0, 2, 0], climbs[0, 0, 2] = False, False, False, False
    codes = np.zeros(shape, dtype=np.int8)
    codes[0, 2, 0], codes[0, 0, 2] = Effect.SLIP, Effect.ACCELERATION
    reduced = np.where(climbs, CLIMBED, FELL)
    reduced[0, 0, 2] = CLIMBED
    dataset = xarray.Dataset(
        {
            "static_feasible": (CELL, static),
            "climbs": (CELL, climbs),
            "disagreement": (CELL, codes),
            "verdict": (START, np.where(climbs, CLIMBED, FELL)[..., None]),
            "verdict_reduced": (START, reduced[..., None]),
            "simulated_time": (START, np.where(static, 4.0, 0.0)[..., None]),
        },
        {"friction": [0.8], "slope": np.arange(4) / 10.0, "thrust": np.arange(1.0, 6.0), "start": [0]},
        {"thrust_max": 43.2},
    )
    shares = agreement(dataset)
    assert (shares.cells, shares.agreeing) == (20, pytest.approx(18.0 / 20.0))
    # Rows 2 and 3 are next to the boundary; of the ten other cells one disagrees.
    assert (shares.inner, shares.agreeing_inner) == (10, pytest.approx(0.9))
    assert (shares.simulated, shares.agreeing_simulated) == (10, pytest.approx(0.9))
    assert shares.reduced == pytest.approx(19.0 / 20.0)
    assert shares.effects == {Effect.SLIP: 1, Effect.ACCELERATION: 1}
    assert shares.effects_inner == {Effect.ACCELERATION: 1}
