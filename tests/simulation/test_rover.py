"""The robot as a rover: where it climbs, slips, tips and stalls, against statics."""

from __future__ import annotations

import dataclasses
import math
from functools import cache

import numpy as np
import pytest

from m4_dynamics.errors import InvalidSettingError, UnknownNameError
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.simulation.rover import RoverOutcome, RoverRun, RoverSettings, drive_rover, rover_limits


@cache
def drive(slope_deg: float, friction: float, speed: float = 0.3, way: float = 1.2, duration: float = 10.0) -> RoverRun:
    settings = RoverSettings(
        slope=math.radians(slope_deg), friction_static=friction, speed=speed, way=way, duration=duration
    )
    return drive_rover(load_robot(), settings)


def test_fifteen_degrees_are_climbed_without_sliding():
    run = drive(15.0, 0.8)
    assert run.outcome is RoverOutcome.CLIMBED
    assert run.climbed >= 1.2
    assert run.slid < 0.01
    # On the slope it goes as fast as its wheels are told to roll.
    way, time = run.dataset.way_up_slope.values, run.dataset.time.values
    last = time > time[-1] - 1.0
    assert np.polyfit(time[last], way[last], 1)[0] == pytest.approx(0.3, rel=5e-3)


def test_forty_five_degrees_are_not_climbed():
    run = drive(45.0, 0.8)
    assert run.outcome is RoverOutcome.SLIPPED
    # It gets its front wheels onto the slope, and no farther; the wheels roll on as they are told.
    assert run.climbed < 0.4
    assert run.rolled == pytest.approx(0.3 * 10.0, rel=0.05)
    assert run.slid > 2.0
    rest = run.dataset.way_up_slope.values[-400:]
    assert np.ptp(rest) < 0.02


@pytest.mark.parametrize(
    ("slope_deg", "friction", "outcome"),
    [
        (20.0, 0.5, RoverOutcome.CLIMBED),  # atan(0.5) = 26.6 deg
        (28.0, 0.5, RoverOutcome.SLIPPED),
        (33.0, 0.8, RoverOutcome.CLIMBED),  # atan(0.8) = 38.7 deg
        (40.0, 0.8, RoverOutcome.SLIPPED),
    ],
)
def test_the_friction_sets_the_slope_it_slips_on(slope_deg, friction, outcome):
    run = drive(slope_deg, friction, way=0.8, duration=6.0)
    assert run.outcome is outcome
    assert run.limits.slipping == pytest.approx(math.atan(friction))


def test_more_friction_makes_it_tip_instead():
    # Slowly, statics decide: the tipping slope is 46.6 deg.
    assert drive(44.0, 2.0, speed=0.15, way=0.6, duration=12.0).outcome is RoverOutcome.CLIMBED
    assert drive(49.0, 2.0, speed=0.15, way=0.6, duration=12.0).outcome is RoverOutcome.TIPPED
    # At 45 deg there is so little left that it tips at a speed at which it climbs gentler slopes.
    assert drive(45.0, 1.2).outcome is RoverOutcome.TIPPED
    assert drive(40.0, 1.2).outcome is RoverOutcome.CLIMBED


def test_limits_are_those_of_statics():
    limits = rover_limits(load_robot(), friction_static=0.8)
    assert math.degrees(limits.slipping) == pytest.approx(38.66, abs=0.01)
    # Half the wheelbase over the height of the centre of mass, by hand from masses and dimensions of the bodies:
    # base 2.45 kg at -0.03 m, hips at 0, legs 0.3 kg at -0.1019 m, wheels 0.4525 kg at -0.1689 m, axles at 0.125 m.
    height = 0.125 + 0.1689 - (2.45 * 0.03 + 4 * (0.3 * 0.1019 + 0.4525 * 0.1689)) / 6.0
    assert math.degrees(limits.tipping) == pytest.approx(math.degrees(math.atan(0.2225 / height)), abs=0.02)
    # Four motors of 3 N m lift 58.9 N on wheels of 0.125 m without slope enough to stop them.
    assert limits.stalling == math.inf


def test_weak_motors_stall():
    robot = load_robot()
    weak = dataclasses.replace(robot, drive_motor=dataclasses.replace(robot.motor, torque_constant=1.0))
    limits = rover_limits(weak, friction_static=0.8)
    assert math.degrees(limits.stalling) == pytest.approx(math.degrees(math.asin(2.0 / (6.0 * 9.81 * 0.125))))
    run = drive_rover(weak, RoverSettings(slope=math.radians(25.0), friction_static=0.8, duration=5.0))
    assert run.outcome is RoverOutcome.STALLED
    assert run.rolled < 1.0


def test_the_trajectory_tells_the_drive():
    run = drive(15.0, 0.8)
    dataset = run.dataset
    assert dataset.attrs["verdict"] == "climbed"
    assert float(dataset.thrust.max()) == 0.0
    uphill = np.array([math.cos(math.radians(15.0)), 0.0, math.sin(math.radians(15.0))])
    np.testing.assert_allclose(dataset.way_up_slope.values, dataset.com_in_world.values @ uphill, atol=1e-9)


def test_bad_settings_are_named():
    for values, name in (({"slope": 0.0}, "slope"), ({"speed": -1.0}, "speed"), ({"friction_static": 0.0}, "friction")):
        with pytest.raises(InvalidSettingError, match=name):
            RoverSettings(**{"slope": 0.3, **values})
    with pytest.raises(UnknownNameError, match="posture"):
        drive_rover(load_robot(), RoverSettings(slope=0.3, posture="tank"))
