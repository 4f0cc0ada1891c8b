"""The implicit steps converge: at first order, to what explicit steps of microseconds give, and near it at 1 ms."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import on_incline, placed

from m4_dynamics.full.stepping import ExplicitStepper, ImplicitStepper
from m4_dynamics.robot.loading import load_robot

Array = NDArray[np.float64]
SLOPE = math.radians(15.0)
STEP = 1e-3
EXPLICIT_STEP = 2e-6


@lru_cache
def landing(dt: float, *, duration: float, explicit: bool = False) -> Array:
    """Height of the base every 10 ms after a drop of 2 cm onto four wheels [m]."""
    model = on_incline(load_robot())
    stepper = (ExplicitStepper if explicit else ImplicitStepper)(model, dt)
    stepper.reset(placed(model, "ugv", above=0.02))
    heights = []
    for _ in range(round(duration / 0.01)):
        stepper.step(round(0.01 / dt))
        heights.append(stepper.configuration[2])
    return np.array(heights)


@lru_cache
def drive(dt: float, *, duration: float, explicit: bool = False) -> Array:
    """Way of the base up a slope every 20 ms, with unequal duties of the wheels [m]."""
    model = on_incline(load_robot(), SLOPE)
    stepper = (ExplicitStepper if explicit else ImplicitStepper)(model, dt)
    stepper.reset(placed(model, "ugv", slope=SLOPE, above=-1.5e-4))
    stepper.actuation.wheel_duty[:] = (0.5, 0.45, 0.5, 0.5)
    ways = []
    for _ in range(round(duration / 0.02)):
        stepper.step(round(0.02 / dt))
        ways.append(stepper.configuration[0] * math.cos(SLOPE) + stepper.configuration[2] * math.sin(SLOPE))
    return np.array(ways)


def relative_error(found: Array, reference: Array) -> float:
    """Largest difference over the range that the reference goes through."""
    return float(np.abs(found - reference).max() / np.ptp(reference))


def test_halving_the_step_changes_a_landing_by_less_than_a_percent() -> None:
    whole, half = landing(STEP, duration=0.5), landing(STEP / 2.0, duration=0.5)
    assert relative_error(whole, half) < 0.01
    assert whole[-1] == pytest.approx(half[-1], abs=1e-6)


def test_halving_the_step_changes_a_drive_by_less_than_a_percent() -> None:
    assert relative_error(drive(STEP, duration=1.0), drive(STEP / 2.0, duration=1.0)) < 1e-3


@pytest.mark.parametrize("dt", [1e-4, STEP])
def test_a_landing_agrees_with_explicit_steps_of_microseconds(dt: float) -> None:
    """To one and a half steps at the speed of touch-down: the fall is half a step ahead, and the ground met up
    to one late."""
    touch_down = math.sqrt(2.0 * 9.81 * 0.02)
    reference = landing(EXPLICIT_STEP, duration=0.12, explicit=True)
    assert np.abs(landing(dt, duration=0.12) - reference).max() < 1.5 * touch_down * dt


def test_a_drive_agrees_with_explicit_steps_of_microseconds() -> None:
    reference = drive(EXPLICIT_STEP, duration=0.1, explicit=True)
    assert relative_error(drive(1e-4, duration=0.1), reference) < 2e-3
    assert relative_error(drive(STEP, duration=0.1), reference) < 0.01


def test_convergence_is_of_first_order() -> None:
    reference = drive(EXPLICIT_STEP, duration=0.1, explicit=True)
    steps = np.array([2e-3, 1e-3, 5e-4, 2.5e-4])
    errors = [relative_error(drive(dt, duration=0.1), reference) for dt in steps]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(1.0, abs=0.15)
