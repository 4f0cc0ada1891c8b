"""Equilibria: hand figures, equations of motion, selection and refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m4_dynamics.errors import InvalidSettingError, NonFiniteError, NoTrimExists
from m4_dynamics.reduced import pendulum
from m4_dynamics.reduced.equilibrium import equilibrium_loads, equilibrium_pitches, equilibrium_thrust
from m4_dynamics.reduced.ground_force import ground_force_in_slope
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.power import PowerModel, power_needed
from m4_dynamics.reduced.trim import TrimLimits, keeps_reserves, select_trim, trim_at_pitch, trim_branches

SLOPE = math.radians(45.0)

#: A body that is a disc about the axle, 5 mm smaller than the wheels.
DISC = 0.12 * np.column_stack([np.cos(np.linspace(0.0, 6.28, 61)), np.sin(np.linspace(0.0, 6.28, 61))])


@pytest.mark.parametrize(
    ("thrust", "pitch_deg", "friction", "torque"),
    [(0.0, 10.8, 1.00, 5.2), (6.6, -3.5, 0.80, 4.6), (14.4, -21.4, 0.60, 3.6), (26.7, -56.0, 0.42, 1.9)],
)
def test_hand_figures_at_45_deg(hand_pendulum: MipParameters, thrust, pitch_deg, friction, torque):
    trim = trim_branches(hand_pendulum, SLOPE, thrust)[0]
    assert trim.branch == "upright"
    assert math.degrees(trim.pitch) == pytest.approx(pitch_deg, abs=0.05)
    assert trim.friction_needed == pytest.approx(friction, abs=0.005)
    assert trim.torque == pytest.approx(torque, abs=0.05)
    assert trim.duty == pytest.approx(trim.torque / 6.0)
    np.testing.assert_allclose(pendulum.acceleration(hand_pendulum, SLOPE, trim.state, trim.inputs), 0.0, atol=1e-10)


@settings(max_examples=100, deadline=None)
@given(
    slope=st.floats(-1.2, 1.5),
    thrust=st.floats(0.0, 43.2),
    speed=st.floats(-1.0, 1.0),
    acceleration=st.floats(-2.0, 2.0),
    motor_model=st.sampled_from(["relative", "paper"]),
)
def test_every_branch_satisfies_the_equations_of_motion(
    hand_pendulum: MipParameters, slope, thrust, speed, acceleration, motor_model
):
    parameters = hand_pendulum.with_(motor_model=motor_model)
    trims = trim_branches(parameters, slope, thrust, speed=speed, acceleration=acceleration)
    for trim in trims:
        found = pendulum.acceleration(parameters, slope, trim.state, trim.inputs)
        np.testing.assert_allclose(found, [acceleration / parameters.wheel_radius, 0.0], atol=1e-7)
        force = ground_force_in_slope(parameters, slope, trim.state, trim.inputs)
        np.testing.assert_allclose(force, [trim.friction_force, trim.normal_force], atol=1e-8)
        assert -math.pi - 1e-12 <= trim.pitch + slope <= math.pi + 1e-12
        assert trim_at_pitch(parameters, slope, trim.pitch, acceleration=acceleration).thrust == pytest.approx(
            thrust, abs=1e-6
        )
    # No branch is missing: count the sign changes of the pitch acceleration at the torque that holds the wheel.
    pitch = np.linspace(-math.pi, math.pi, 2000, endpoint=False) - slope
    balance = equilibrium_thrust(parameters, slope, pitch, acceleration=acceleration) - thrust
    crossings = int(np.sum(balance * np.roll(balance, 1) < 0.0))
    if crossings != len(trims):  # a grazing pair may fall between two samples, never appear from nothing
        assert crossings < len(trims)
        assert abs(math.remainder(trims[0].pitch - trims[-1].pitch, 2 * math.pi)) < 0.01


def test_a_pitch_gives_the_thrust_of_its_branch(hand_pendulum: MipParameters):
    for member in trim_branches(hand_pendulum, SLOPE, 14.4):
        again = trim_at_pitch(hand_pendulum, SLOPE, member.pitch)
        assert again.branch == member.branch
        assert again.thrust == pytest.approx(14.4)


def test_acceleration_shifts_the_pitch(hand_pendulum: MipParameters):
    """0.3 m/s^2 shifts the pitch by about 2 deg at 45 deg."""
    steady = trim_branches(hand_pendulum, SLOPE, 6.6)[0]
    speeding_up = trim_branches(hand_pendulum, SLOPE, 6.6, acceleration=0.3)[0]
    assert math.degrees(speeding_up.pitch - steady.pitch) == pytest.approx(2.0, abs=0.5)


def test_back_emf_at_speed_takes_duty(hand_pendulum: MipParameters):
    still = trim_branches(hand_pendulum, SLOPE, 6.6)[0]
    climbing = trim_branches(hand_pendulum, SLOPE, 6.6, speed=0.5)[0]
    assert climbing.torque == pytest.approx(still.torque)
    assert climbing.duty - still.duty == pytest.approx(0.4 * (0.5 / 0.125) / 6.0)
    assert climbing.margins.duty == pytest.approx(1.0 - climbing.duty)


def test_closed_form_broadcasts(hand_pendulum: MipParameters):
    slope, thrust = np.radians([0.0, 30.0, 60.0])[:, None], np.array([0.0, 10.0, 20.0, 40.0])
    pitch = equilibrium_pitches(hand_pendulum, slope, thrust)
    loads = equilibrium_loads(hand_pendulum, slope, thrust, pitch, speed=0.2)
    assert pitch.shape == loads.friction_needed.shape == (2, 3, 4)
    for i in range(3):
        for j in range(4):
            for branch, trim in enumerate(trim_branches(hand_pendulum, float(slope[i, 0]), thrust[j], speed=0.2)):
                assert pitch[branch, i, j] == pytest.approx(trim.pitch)
                assert loads.friction_needed[branch, i, j] == pytest.approx(trim.friction_needed)
                assert loads.duty[branch, i, j] == pytest.approx(trim.duty)


def test_no_pitch_balances_a_robot_that_is_pushed_over(hand_pendulum: MipParameters):
    pitch = equilibrium_pitches(hand_pendulum, 0.0, [10.0, 60.0])
    assert np.isfinite(pitch[:, 0]).all()
    assert np.isnan(pitch[:, 1]).all()
    assert trim_branches(hand_pendulum, 0.0, 60.0) == []


def brute_force(parameters: MipParameters, slope: float, limits: TrimLimits) -> list:
    """Every allowed member on a dense grid of thrust."""
    thrusts = np.linspace(*limits.thrust_range, 4001)
    members = (m for thrust in thrusts for m in trim_branches(parameters, slope, float(thrust), limits=limits))
    return [member for member in members if member.within_limits]


def test_criteria_find_the_best_member(hand_pendulum: MipParameters):
    limits = TrimLimits()
    members = brute_force(hand_pendulum, SLOPE, limits)
    friction = select_trim(hand_pendulum, SLOPE, limits=limits, criterion="least-friction")
    assert friction.friction_needed == pytest.approx(min(m.friction_needed for m in members), abs=1e-6)
    assert friction.friction_needed <= min(m.friction_needed for m in members) + 1e-12

    thrust = select_trim(hand_pendulum, SLOPE, limits=limits, criterion="least-thrust")
    assert thrust.thrust == pytest.approx(min(m.thrust for m in members), abs=43.2 / 4000)
    assert thrust.friction_needed == pytest.approx(0.8, abs=1e-6), "friction is what stops the thrust from falling"

    cheap_rotors = PowerModel(rotor_radius=0.5, figure_of_merit=1.0)
    power = select_trim(hand_pendulum, SLOPE, limits=limits, criterion="least-power", power_model=cheap_rotors)

    def cost(member) -> float:
        return float(power_needed(hand_pendulum, cheap_rotors, member.thrust, member.torque, member.wheel_rate))

    assert cost(power) <= min(cost(m) for m in members) + 1e-9
    assert power.thrust > thrust.thrust + 1.0, "with cheap thrust it pays to unload the wheel motors"


def test_power_of_one_hovering_rotor():
    """A 10 N rotor of 0.1 m radius: v_i = sqrt(f / 2 rho A) = 11.4 m/s, ideal power f v_i."""
    parameters = MipParameters(1.0, 1.0, 1.0, 1.0, (0.0, 1.0), (0.0, 1.0), 0.1, 1.0, 0.5)
    one = PowerModel(thruster_count=1, rotor_radius=0.1, air_density=1.225, figure_of_merit=1.0)
    induced = math.sqrt(10.0 / (2.0 * 1.225 * math.pi * 0.01))
    assert power_needed(parameters, one, 10.0, 0.0, 0.0) == pytest.approx(10.0 * induced)
    assert power_needed(parameters, one, 0.0, 2.0, 3.0) == pytest.approx(2.0 * 3.0 + 4.0 / 0.5)


@pytest.mark.parametrize("changes", [{}, {"thrust_margin": 2.0, "friction_fraction": 0.9, "friction_reserve": 0.9}])
def test_automatic_trim_keeps_its_reserves(hand_pendulum: MipParameters, changes):
    limits = TrimLimits(**changes)
    low, high = limits.thrust_range
    for slope_deg in (0.0, 15.0, 30.0, 45.0):
        trim = select_trim(hand_pendulum, math.radians(slope_deg), limits=limits)
        assert low + limits.thrust_margin - 1e-6 <= trim.thrust <= high - limits.thrust_margin + 1e-6
        assert trim.friction_needed <= limits.friction_reserve * limits.friction_planned + 1e-6
        assert abs(trim.duty) <= limits.duty_max - limits.duty_margin
        assert trim.margins.pitch_window > 0.0
        assert keeps_reserves(hand_pendulum, trim, limits)
        less = trim_branches(hand_pendulum, trim.slope, trim.thrust - 0.01, limits=limits)[0]
        assert not keeps_reserves(hand_pendulum, less, limits), "the least thrust that keeps them"


def test_automatic_trim_falls_back_to_least_friction(hand_pendulum: MipParameters):
    slope = math.radians(60.0)
    fallback = select_trim(hand_pendulum, slope)
    assert fallback == select_trim(hand_pendulum, slope, criterion="least-friction")
    assert not keeps_reserves(hand_pendulum, fallback, TrimLimits())
    # Without thrusters there is one member, and it is taken if it can be.
    level = select_trim(hand_pendulum, 0.0, limits=TrimLimits(thrust_range=(0.0, 0.0)))
    assert level.thrust == 0.0
    assert level.friction_needed == pytest.approx(0.0, abs=1e-12)


def test_given_thrust_and_pitch(hand_pendulum: MipParameters):
    trim = select_trim(hand_pendulum, SLOPE, criterion="thrust", thrust=14.4)
    assert math.degrees(trim.pitch) == pytest.approx(-21.36, abs=0.01)
    assert select_trim(hand_pendulum, SLOPE, criterion="pitch", pitch=trim.pitch).thrust == pytest.approx(14.4)
    with pytest.raises(InvalidSettingError, match="thrust"):
        select_trim(hand_pendulum, SLOPE, criterion="thrust")
    with pytest.raises(InvalidSettingError, match="least-friction"):
        select_trim(hand_pendulum, SLOPE, criterion="cheapest")
    with pytest.raises(NonFiniteError, match="slope"):
        select_trim(hand_pendulum, math.nan)


def test_narrow_window_between_grid_points_is_found(hand_pendulum: MipParameters):
    """Limits that leave a stretch of thrust of about 1 mN, far below the sweep's spacing."""
    target = trim_branches(hand_pendulum, SLOPE, 17.123456)[0]
    window = (target.pitch + SLOPE - 2e-5, target.pitch + SLOPE + 2e-5)
    trim = select_trim(hand_pendulum, SLOPE, limits=TrimLimits(pitch_window=window))
    assert trim.thrust == pytest.approx(17.123456, abs=2e-3)


@settings(max_examples=20, deadline=None)
@given(slope=st.floats(0.0, 1.5), friction=st.floats(0.1, 1.5), speed=st.floats(0.0, 2.0))
def test_selection_agrees_with_a_sweep_of_members(hand_pendulum: MipParameters, slope, friction, speed):
    limits = TrimLimits(friction_static=friction)
    thrusts = np.linspace(*limits.thrust_range, 150)
    members = [m for f in thrusts for m in trim_branches(hand_pendulum, slope, float(f), speed=speed, limits=limits)]
    possible = any(member.within_limits for member in members)
    try:
        trim = select_trim(hand_pendulum, slope, limits=limits, speed=speed)
    except NoTrimExists:
        assert not possible
    else:
        assert trim.within_limits
        if not possible:  # what the coarse sweep steps over must be close to a limit
            assert min(trim.margins.friction, trim.margins.duty) < 0.05


@pytest.mark.parametrize(
    ("slope_deg", "changes", "limit", "words"),
    [
        (
            80.0,
            {"friction_static": 0.3},
            "friction",
            r"80\.0 deg: friction: .* 1\.40 is needed .* 0\.30 is there \(1\.10",
        ),
        (45.0, {"thrust_range": (0.0, 5.0)}, "friction", "thrust: 6.5 N is needed, 0 to 5 N is there"),
        (60.0, {"duty_max": 0.3}, "duty", "duty: 0.43 is needed"),
        (15.0, {"pitch_window": (1.5, 1.6)}, "pitch_window", "pitch window"),
        (0.0, {"normal_force_min": 80.0}, "normal_force", "normal force"),
        (0.0, {"outline_in_body": DISC}, "clearance", r"5 mm above .* 20 mm is the least \(15 mm short"),
    ],
)
def test_refusal_names_the_limit_and_the_shortfall(hand_pendulum: MipParameters, slope_deg, changes, limit, words):
    with pytest.raises(NoTrimExists, match=words) as refusal:
        select_trim(hand_pendulum, math.radians(slope_deg), limits=TrimLimits(**changes))
    assert refusal.value.limit == limit


def test_refusal_of_several_limits_names_them_all(hand_pendulum: MipParameters):
    limits = TrimLimits(friction_static=0.3, duty_max=0.01, thrust_range=(0.0, 1.0))
    with pytest.raises(NoTrimExists, match=r"no single limit .* friction.* and .*duty"):
        select_trim(hand_pendulum, SLOPE, limits=limits)


def test_refusal_of_a_given_thrust(hand_pendulum: MipParameters):
    with pytest.raises(NoTrimExists, match=r"with 60\.0 N of thrust: no pitch balances") as refusal:
        select_trim(hand_pendulum, 0.0, criterion="thrust", thrust=60.0)
    assert refusal.value.limit == "equilibrium"
    with pytest.raises(NoTrimExists, match=r"with 2\.0 N of thrust: friction: a coefficient of 0\.93") as refusal:
        select_trim(hand_pendulum, SLOPE, criterion="thrust", thrust=2.0)
    assert refusal.value.limit == "friction"


def test_vertical_wall_without_friction_force_is_explained(hand_pendulum: MipParameters):
    """Where the ground would have to pull, the friction needed is infinite; the message speaks of the normal force."""
    with pytest.raises(NoTrimExists, match="normal force") as refusal:
        select_trim(hand_pendulum, math.radians(100.0), criterion="thrust", thrust=0.0)
    assert "inf" not in str(refusal.value)
    assert refusal.value.limit == "normal_force"


@pytest.mark.parametrize(
    "changes",
    [
        {"friction_static": 0.0},
        {"friction_fraction": 1.5},
        {"thrust_range": (5.0, 0.0)},
        {"pitch_window": (0.0, math.inf)},
        {"duty_margin": -0.1},
        {"outline_in_body": np.zeros((2, 3))},
    ],
)
def test_bad_limits_are_named(changes):
    with pytest.raises(InvalidSettingError, match=next(iter(changes))):
        TrimLimits(**changes)


def test_refusal_of_a_given_pitch_speaks_of_that_pitch(hand_pendulum: MipParameters):
    upright, hanging = trim_branches(hand_pendulum, SLOPE, 14.4)
    assert upright.within_limits
    with pytest.raises(NoTrimExists, match=r"at -171\.2 deg of pitch: friction.* and duty.* and pitch window"):
        select_trim(hand_pendulum, SLOPE, criterion="pitch", pitch=hanging.pitch)
    with pytest.raises(NoTrimExists, match=r"thrust: -\d+\.\d N is needed, 0 to 43.2 N is there"):
        select_trim(hand_pendulum, SLOPE, criterion="pitch", pitch=math.radians(30.0))


@settings(max_examples=40, deadline=None)
@given(
    slope=st.floats(-1.6, 1.6),
    friction=st.floats(0.05, 2.0),
    thrust_max=st.floats(0.0, 80.0),
    duty_max=st.floats(0.05, 1.0),
    normal_force_min=st.floats(0.0, 60.0),
    window=st.tuples(st.floats(-2.0, 0.0), st.floats(0.0, 2.0)),
    speed=st.floats(-2.0, 2.0),
    acceleration=st.floats(-3.0, 3.0),
)
def test_every_case_ends_in_a_trim_or_a_reason(
    hand_pendulum: MipParameters,
    slope,
    friction,
    thrust_max,
    duty_max,
    normal_force_min,
    window,
    speed,
    acceleration,
):
    limits = TrimLimits(
        friction_static=friction,
        thrust_range=(0.0, thrust_max),
        duty_max=duty_max,
        normal_force_min=normal_force_min,
        pitch_window=window,
    )
    try:
        trim = select_trim(hand_pendulum, slope, limits=limits, speed=speed, acceleration=acceleration)
    except NoTrimExists as refusal:
        missed = ("friction", "thrust", "duty", "normal_force", "pitch_window", "equilibrium")
        assert refusal.limit in missed  # noqa: PT017
        assert "nan" not in str(refusal)  # noqa: PT017
    else:
        assert trim.within_limits
        found = pendulum.acceleration(hand_pendulum, slope, trim.state, trim.inputs)
        np.testing.assert_allclose(found, [acceleration / 0.125, 0.0], atol=1e-6)
