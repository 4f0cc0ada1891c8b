"""The MPC in closed loop with the reduced model: recovery, scarce friction, and the paper's settings."""

from __future__ import annotations

import numpy as np
import pytest

from m4_dynamics.control.mpc.controller import MpcController
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.reduced.ground_force import ground_force_in_slope
from m4_dynamics.reduced.linear import discretise_euler
from m4_dynamics.reduced.pendulum import linearise


@pytest.mark.parametrize("slope_deg", [15.0, 30.0, 45.0])
@pytest.mark.parametrize("pitch_error_deg", [-8.0, 8.0])
def test_recovers_from_a_pitch_error_and_climbs(pendulum, make_case, simulate, slope_deg, pitch_error_deg):
    # No less thrust than the automatic trim keeps: what is not there cannot be taken away to lean back.
    case = make_case(slope_deg, thrust=15.0 if slope_deg == 45.0 else 4.0)
    controller = MpcController(pendulum, case.reference)
    run = simulate(controller, case.reference, pitch_error_deg=pitch_error_deg)
    assert not run.fell
    assert controller.fallbacks == 0
    # A recovery may use the margin that the plan keeps, never more than the ground gives.
    assert run.friction_use.max() < controller.problem.settings.friction_static
    assert run.friction_use[60:].max() <= controller.problem.settings.friction_plan + 1e-3
    assert run.force[:, 1].min() >= 5.0
    wheel_after_a_second = run.error[200:, 0] * pendulum.wheel_radius
    assert np.sqrt(np.mean(wheel_after_a_second**2)) < 0.02
    assert np.degrees(np.sqrt(np.mean(run.error[200:, 1] ** 2))) < 0.1
    assert run.tracking_cost[-1] < 1e-6


@pytest.mark.parametrize("slope_deg", [15.0, 30.0, 45.0])
@pytest.mark.parametrize("pitch_error_deg", [-5.0, 5.0])
def test_wheels_are_back_on_their_way_after_a_second(pendulum, make_case, simulate, slope_deg, pitch_error_deg):
    case = make_case(slope_deg)
    run = simulate(MpcController(pendulum, case.reference), case.reference, pitch_error_deg=pitch_error_deg)
    wheel_after_a_second = run.error[200:, 0] * pendulum.wheel_radius
    assert np.sqrt(np.mean(wheel_after_a_second**2)) < 0.01


@pytest.mark.parametrize("slope_deg", [0.0, 10.0])
def test_balances_a_robot_without_thrusters(pendulum, make_case, simulate, slope_deg):
    # The ramps would need a little thrust, so what they leave behind is given time to settle.
    case = make_case(slope_deg, thrust=0.0, duration=12.0, hold_time=4.0)
    controller = MpcController(pendulum, case.reference, MpcSettings(thrust_limits=(0.0, 0.0)))
    run = simulate(controller, case.reference, pitch_error_deg=3.0)
    assert not run.fell
    assert (run.inputs[:, 1] == 0.0).all()
    assert np.abs(run.error[-1, :2]).max() < 1e-2
    assert controller.fallbacks == 0


@pytest.mark.parametrize("rate", [-1.2, 1.2])
def test_recovers_from_a_push(pendulum, make_case, simulate, rate):
    # A blow at the body that changes its pitch rate at once, in the middle of the climb.
    case = make_case(45.0)
    controller = MpcController(pendulum, case.reference)
    run = simulate(controller, case.reference, push=(700, rate))
    assert not run.fell
    assert np.abs(run.error[700:, 0]).max() * pendulum.wheel_radius > 0.03
    assert run.tracking_cost[-1] < 1e-6
    assert controller.fallbacks == 0


@pytest.mark.parametrize("pitch_error_deg", [-5.0, 5.0])
def test_scarce_friction_is_used_up_and_not_exceeded(pendulum, make_case, simulate, pitch_error_deg):
    # Ground that allows 5 % more than the trim needs: the constraint must hold the unconstrained optimum back, that of
    # the paper's weights, which ask for more than the default's.
    case = make_case(45.0, speed=0.0)
    hasty = {"input_weights": MpcSettings.paper().input_weights}
    scarce = MpcSettings(
        friction_static=1.05 * case.trim.friction_needed, friction_fraction=1.0, slack_weight=1e3, **hasty
    )
    run = simulate(MpcController(pendulum, case.reference, scarce), case.reference, pitch_error_deg=pitch_error_deg)
    free = MpcSettings(ground_constraints=False, **hasty)
    unconstrained = simulate(
        MpcController(pendulum, case.reference, free), case.reference, pitch_error_deg=pitch_error_deg
    )
    mu = scarce.friction_plan
    assert unconstrained.friction_use.max() > 1.05 * mu
    assert run.friction_use.max() <= mu * (1 + 1e-4)
    assert (run.friction_use > mu * (1 - 1e-3)).sum() > 10
    assert max(d.slack for d in run.diagnostics) < 1e-4
    assert not run.fell
    assert run.tracking_cost[-1] < 1e-6


def test_default_penalty_uses_the_margin_before_it_gives_up_the_balance(pendulum, make_case, simulate):
    # At 30 deg the trim has little thrust to take away: from +8 deg a strict plan keeps its margin and falls.
    case = make_case(30.0)
    yielding = simulate(MpcController(pendulum, case.reference), case.reference, pitch_error_deg=8.0)
    settings = MpcSettings(slack_weight=1e3)
    strict = simulate(MpcController(pendulum, case.reference, settings), case.reference, pitch_error_deg=8.0)
    assert strict.fell
    assert strict.friction_use[:20].max() <= settings.friction_plan + 1e-3
    assert not yielding.fell
    assert settings.friction_plan + 1e-2 < yielding.friction_use.max() < settings.friction_static


def test_slack_is_the_violation_that_cannot_be_avoided(pendulum, make_case):
    # Less friction than any input can need less of: the best input's violation, found by brute force over the box.
    case = make_case(45.0, speed=0.0)
    settings = MpcSettings(
        horizon=1, friction_static=0.05, friction_fraction=1.0, slack_weight=1e5, solver_tolerance=1e-9
    )
    controller = MpcController(pendulum, case.reference, settings)
    controller.control(0, case.reference.state[0])
    # At one stage the force is affine in the inputs, so the least violation is at a corner or an edge of the box.
    least = np.inf
    for duty in np.linspace(-1.0, 1.0, 201):
        for thrust in np.linspace(0.0, 43.2, 201):
            fx, fn = ground_force_in_slope(pendulum, case.slope, case.reference.state[0], (duty, thrust))
            least = min(least, max(abs(fx) - 0.05 * fn, 5.0 - fn, 0.0))
    assert controller.diagnostics.slack == pytest.approx(least, abs=0.3)


def test_infeasible_start_is_reported_and_survived(pendulum, make_case, simulate):
    case = make_case(45.0, speed=0.0)
    controller = MpcController(pendulum, case.reference, MpcSettings(friction_static=0.3))
    run = simulate(controller, case.reference, steps=100)
    assert all(np.isfinite(run.inputs).ravel())
    assert max(d.slack for d in run.diagnostics) > 1.0
    assert controller.fallbacks == 0


@pytest.mark.parametrize("slope_deg", [15.0, 45.0])
def test_papers_settings_track_far_worse(pendulum, make_case, simulate, slope_deg):
    case = make_case(slope_deg)
    ours = simulate(MpcController(pendulum, case.reference), case.reference)
    papers = simulate(MpcController(pendulum, case.reference, MpcSettings.paper()), case.reference)
    steady = slice(-400, None)
    assert papers.tracking_cost[steady].mean() > 100.0 * ours.tracking_cost[steady].mean()
    assert papers.tracking_cost[steady].mean() > 1.0
    assert ours.tracking_cost[steady].mean() < 1e-3


@pytest.mark.parametrize("slope_deg", [15.0, 45.0])
def test_costing_raw_inputs_makes_the_robot_fall(pendulum, make_case, simulate, slope_deg):
    case = make_case(slope_deg)
    run = simulate(MpcController(pendulum, case.reference, MpcSettings.paper(input_reference="zero")), case.reference)
    assert run.fell


def test_papers_loop_is_unstable_by_its_own_linear_model(pendulum, make_case):
    # Why it drifts: the receding-horizon gain of ten steps leaves one slow unstable pole; fifteen would not.
    case = make_case(45.0)
    a, b = discretise_euler(*linearise(pendulum, case.slope, case.trim.state, case.trim.inputs), 0.005)
    paper = MpcSettings.paper()
    q, r = np.diag(paper.state_weights), np.diag(paper.input_weights)
    growth = {}
    for horizon in (10, 15):
        cost_to_go = q
        for _ in range(horizon):
            gain = np.linalg.solve(r + b.T @ cost_to_go @ b, b.T @ cost_to_go @ a)
            cost_to_go = q + a.T @ cost_to_go @ (a - b @ gain)
        growth[horizon] = np.log(np.abs(np.linalg.eigvals(a - b @ gain)).max()) / 0.005
    assert 0.5 < growth[10] < 1.5
    assert growth[15] < 0.0
