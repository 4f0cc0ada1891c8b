"""Rotors that lag: the thrust as a state of the controllers' model, known from the commands alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m4_dynamics.control.controller import ControlStatus
from m4_dynamics.control.lqr import LqrController, lqr_gain
from m4_dynamics.control.mpc.controller import MpcController
from m4_dynamics.control.mpc.qp import QuadraticProgramme
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.control.rotor import RotorModel, with_rotor_lag
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.reduced import kernels
from m4_dynamics.reduced.linear import discretise_euler
from m4_dynamics.reduced.pendulum import linearise

DT, LAG = 0.005, 0.15
SUBSTEPS = 10


@pytest.fixture(scope="module")
def lagging(pendulum):
    return pendulum.with_(thrust_time_constant=LAG)


def run(controller, plant, case, *, pitch_error_deg=0.0, steps=None, time_constant=LAG):
    """Close the loop with a plant whose thrust lags continuously; errors, commands, thrust and ground forces."""
    x, thrust = case.reference.state[0].copy(), float(case.reference.inputs[0, 1])
    x[1] += np.radians(pitch_error_deg)
    errors, commands, thrusts, forces = [], [], [], []
    force, share = np.zeros(2), 1.0 - np.exp(-DT / SUBSTEPS / time_constant)
    for k in range(len(case.reference) if steps is None else steps):
        u = controller.control(k, x)
        errors.append(x - case.reference.state[min(k, len(case.reference) - 1)])
        commands.append(u)
        thrusts.append(thrust)
        kernels.ground_force(plant, case.slope, x, np.array([u[0], thrust]), force)
        forces.append(force.copy())
        if abs(errors[-1][1]) > 1.2:
            pytest.fail(f"fell at step {k}")
        for _ in range(SUBSTEPS):
            thrust += share * (u[1] - thrust)
            kernels.mip_step(plant, case.slope, x, np.array([u[0], thrust]), DT / SUBSTEPS, 1, x)
    return np.array(errors), np.array(commands), np.array(thrusts), np.array(forces)


def test_thrust_approaches_its_command_exponentially(lagging):
    rotor = RotorModel(lagging, DT)
    rotor.reset(10.0)
    assert rotor.thrust_at(0) == 10.0
    rotor.command(30.0)
    for step in (1, 7, 7, 40):
        assert rotor.thrust_at(step) == pytest.approx(30.0 - 20.0 * np.exp(-step * DT / LAG), rel=1e-12)
        rotor.command(30.0)
    rotor.reset(5.0)
    assert rotor.thrust_at(3) == 5.0


def test_mean_thrust_lies_between_before_and_after(lagging, pendulum):
    rotor = RotorModel(lagging, DT)
    rotor.reset(0.0)
    rotor.thrust_at(0)
    mean = rotor.command(10.0)
    assert mean == pytest.approx(0.5 * rotor.thrust_at(1))
    ideal = RotorModel(pendulum, DT)
    ideal.thrust_at(0)
    assert ideal.command(10.0) == 10.0
    assert ideal.thrust_at(1) == 10.0


def test_commands_make_the_thrust_that_is_wanted(lagging):
    rotor = RotorModel(lagging, DT)
    wanted = 15.0 + np.sin(np.arange(100) * 0.1)
    rotor.reset(wanted[0])
    for step, command in enumerate(rotor.commands_for(wanted)):
        assert rotor.thrust_at(step) == pytest.approx(wanted[step], abs=1e-9)
        rotor.command(command)


states = st.tuples(st.floats(-10, 10), st.floats(-0.8, 0.8), st.floats(-3, 3), st.floats(-3, 3), st.floats(0, 40)).map(
    np.array
)


@settings(deadline=None, max_examples=30)
@given(x0=states, u=st.tuples(st.floats(-1, 1), st.floats(0, 43)).map(np.array), slope=st.floats(-0.3, 1.0))
def test_rollout_with_lag_by_finite_differences(lagging, x0, u, slope):
    p, step = lagging.as_array(), 1e-6

    def roll(x, v):
        x_out, a, b = np.empty((2, 5)), np.full((1, 5, 5), np.nan), np.full((1, 5, 2), np.nan)
        f, f_x, f_u = np.empty((1, 2)), np.full((1, 2, 5), np.nan), np.full((1, 2, 2), np.nan)
        kernels.rollout_and_linearise(p, np.array([slope]), x, v[None], DT, x_out, a, b, f, f_x, f_u)
        return np.concatenate([x_out[1], f[0]]), np.vstack([a[0], f_x[0]]), np.vstack([b[0], f_u[0]])

    value, by_state, by_input = roll(x0, u)
    assert value[4] == pytest.approx(x0[4] + (1.0 - np.exp(-DT / LAG)) * (u[1] - x0[4]))
    for derivative, change in ((by_state, step * np.eye(5)), (by_input, step * np.eye(2))):
        for j, d in enumerate(change):
            plus, minus = (roll(x0 + s * d, u) if len(d) == 5 else roll(x0, u + s * d) for s in (1.0, -1.0))
            np.testing.assert_allclose(derivative[:, j], (plus[0] - minus[0]) / (2 * step), rtol=1e-5, atol=1e-5)


def test_terminal_cost_is_what_the_lqr_of_five_states_pays(lagging, make_case):
    case = make_case(45.0, speed=0.0)
    controller = MpcController(lagging, case.reference)
    a, b = linearise(lagging, case.slope, case.trim.state, case.trim.inputs)
    a, b = discretise_euler(a, b, DT)
    share = 1.0 - np.exp(-DT / LAG)
    q, r = np.diag(MpcSettings().state_weights), np.diag(MpcSettings().input_weights)
    gain = controller.problem.gains[0]
    rng = np.random.default_rng(3)
    for _ in range(3):
        x = 0.1 * rng.normal(size=4)
        thrust, total = rng.normal(), 0.0
        start = np.append(x, thrust)
        for _ in range(20_000):
            u = -gain @ np.append(x, thrust)
            total += x @ q @ x + u @ r @ u
            x = a @ x + b @ [u[0], thrust]
            thrust += share * (u[1] - thrust)
        assert total == pytest.approx(start @ controller.problem.terminals[0] @ start, rel=1e-8)


@pytest.mark.parametrize("horizon", [1, 10, 30])
def test_unconstrained_mpc_is_the_lqr_of_five_states(lagging, make_case, horizon):
    case = make_case(45.0, speed=0.0)
    a, b = discretise_euler(*linearise(lagging, case.slope, case.trim.state, case.trim.inputs), DT)
    a, b = with_rotor_lag(a, b, 1.0 - np.exp(-DT / LAG))
    gain, _ = lqr_gain(a, b, [*MpcSettings().state_weights, 0.0], MpcSettings().input_weights)
    free = MpcSettings(
        horizon=horizon,
        solver_tolerance=1e-12,
        duty_limits=(-1e3, 1e3),
        thrust_limits=(-1e4, 1e4),
        ground_constraints=False,
        disturbance_rejection=False,
    )
    controller = MpcController(lagging, case.reference, free)
    rng = np.random.default_rng(7)
    for _ in range(5):
        error = 1e-6 * rng.normal(size=5)
        controller.reset(thrust=float(case.trim.thrust + error[4]))
        u = controller.control(0, case.reference.state[0] + error[:4])
        expected = -gain @ error
        np.testing.assert_allclose(u - case.trim.inputs, expected, atol=5e-6 * np.abs(expected).max() + 1e-12)


@pytest.mark.parametrize("slope_deg", [15.0, 45.0])
@pytest.mark.parametrize("pitch_error_deg", [-5.0, 5.0])
def test_recovers_and_climbs(lagging, make_case, slope_deg, pitch_error_deg):
    case = make_case(slope_deg, thrust=6.0 if slope_deg == 15.0 else 18.0, duration=8.0)
    controller = MpcController(lagging, case.reference)
    error, commands, _, force = run(controller, lagging.as_array(), case, pitch_error_deg=pitch_error_deg)
    assert controller.fallbacks == 0
    use = np.abs(force[:, 0]) / force[:, 1]
    assert use.max() < controller.problem.settings.friction_static
    assert np.sqrt(np.mean((0.125 * error[300:, 0]) ** 2)) < 0.02
    assert np.abs(error[-1]).max() < 1e-4
    assert (np.abs(commands[:, 0]) <= 1.0).all()
    assert commands[:, 1].min() >= 0.0
    assert commands[:, 1].max() <= 43.2


def test_thrust_is_known_from_the_commands(lagging, make_case):
    case = make_case(45.0, thrust=18.0, duration=6.0)
    controller = MpcController(lagging, case.reference)
    seen = []

    class Watched:
        def control(self, step, state):
            inputs = controller.control(step, state)
            seen.append(controller.rotor.thrust)
            return inputs

    _, _, thrust, _ = run(Watched(), lagging.as_array(), case, pitch_error_deg=5.0)
    np.testing.assert_allclose(seen, thrust, atol=1e-9)


def test_a_lag_that_the_model_does_not_know_shakes_the_robot(pendulum, lagging, make_case):
    # What knowing it is worth: the same plant under a controller that takes its rotors for ideal.
    case = make_case(45.0, thrust=18.0, speed=0.0, duration=6.0)
    last = {}
    for name, parameters in (("known", lagging), ("unknown", pendulum)):
        controller = MpcController(parameters, case.reference)
        _, commands, _, _ = run(controller, lagging.as_array(), case, pitch_error_deg=2.0)
        last[name] = np.ptp(commands[-200:, 1])
    assert last["known"] < 0.1
    assert last["unknown"] > 1.0


def test_lag_and_disturbance_together_leave_no_offset(lagging, make_case):
    case = make_case(45.0, thrust=18.0, speed=0.0, duration=8.0)
    plant = lagging.as_array()
    plant[kernels.DISTURBANCE_WHEEL : kernels.DISTURBANCE_PITCH + 1] = -0.5, -2.7
    controller = MpcController(lagging, case.reference)
    error, _, _, _ = run(controller, plant, case)
    assert np.abs(error[-1]).max() < 1e-5
    np.testing.assert_allclose(controller.estimator.estimate, (-0.5, -2.7), atol=1e-3)


def test_lqr_knows_the_lag_too(lagging, make_case):
    case = make_case(45.0, thrust=18.0, duration=8.0)
    controller = LqrController(lagging, case.reference)
    assert controller.gains.shape == (1, 2, 5)
    error, _, _, _ = run(controller, lagging.as_array(), case, pitch_error_deg=5.0)
    assert np.abs(error[-1]).max() < 1e-4


def test_fallback_counts_on_the_lag(lagging, make_case, monkeypatch):
    # With a solver that is never done, the saturated LQR of five states balances alone.
    monkeypatch.setattr(QuadraticProgramme, "solve", lambda programme: ControlStatus.ITERATION_LIMIT)
    case = make_case(45.0, thrust=18.0, duration=7.0)
    controller = MpcController(lagging, case.reference)
    error, _, _, _ = run(controller, lagging.as_array(), case, pitch_error_deg=3.0)
    assert controller.fallbacks_to_lqr == len(case.reference)
    assert np.abs(error[-1]).max() < 1e-3


def test_without_thrust_there_is_nothing_to_lag(lagging, make_case):
    case = make_case(15.0, thrust=0.0, speed=0.0)
    controller = MpcController(lagging, case.reference, MpcSettings(thrust_limits=(0.0, 0.0)))
    assert controller.problem.states.shape[1] == 4


def test_negative_time_constants_are_refused(pendulum):
    with pytest.raises(InvalidSettingError, match="thrust_time_constant"):
        pendulum.with_(thrust_time_constant=-0.1)
