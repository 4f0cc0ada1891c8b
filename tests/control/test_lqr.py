"""The linear-quadratic regulator: optimal on its model, saturated in use."""

from __future__ import annotations

import numpy as np
import pytest

from m4_dynamics.control.controller import BalanceController
from m4_dynamics.control.lqr import LqrController, lqr_gain
from m4_dynamics.errors import ConvergenceError, InvalidSettingError, NonFiniteError
from m4_dynamics.reduced.linear import discretise_zoh
from m4_dynamics.reduced.pendulum import linearise

Q = np.diag([10.0, 1e4, 5.0, 25.0])
R = np.diag([5.0, 0.5])


def test_cost_to_go_is_the_sum_that_the_gain_pays(pendulum, make_case):
    case = make_case(45.0)
    a, b = discretise_zoh(*linearise(pendulum, case.slope, case.trim.state, case.trim.inputs), 0.005)
    gain, cost_to_go = lqr_gain(a, b, np.diag(Q), np.diag(R))
    start = np.array([0.1, 0.05, -0.2, 0.3])
    x, total = start.copy(), 0.0
    for _ in range(20_000):
        u = -gain @ x
        total += x @ Q @ x + u @ R @ u
        x = a @ x + b @ u
    assert total == pytest.approx(start @ cost_to_go @ start, rel=1e-9)
    # Any other gain pays more.
    worse, x = 0.0, start.copy()
    for _ in range(20_000):
        u = -1.05 * gain @ x
        worse += x @ Q @ x + u @ R @ u
        x = a @ x + b @ u
    assert worse > total


def test_unstabilisable_models_are_refused():
    with pytest.raises(ConvergenceError, match="no linear-quadratic regulator"):
        lqr_gain(np.diag([1.2, 0.5]), np.array([[0.0], [1.0]]), np.ones(2), np.ones(1))


@pytest.mark.parametrize("slope_deg", [0.0, 15.0, 45.0])
@pytest.mark.parametrize("pitch_error_deg", [-8.0, 8.0])
def test_recovers_and_tracks(pendulum, make_case, simulate, slope_deg, pitch_error_deg):
    case = make_case(slope_deg, duration=8.0)
    controller = LqrController(pendulum, case.reference)
    assert isinstance(controller, BalanceController)
    run = simulate(controller, case.reference, pitch_error_deg=pitch_error_deg)
    assert not run.fell
    assert run.tracking_cost[-1] < 1e-6
    # The reported cost is a cost-to-go: it only falls while nothing saturates and the reference is exact.
    cost = np.array([d.cost for d in run.diagnostics[100:400]])
    assert (np.diff(cost) <= 1e-9 + 1e-3 * cost[:-1]).all()


def test_inputs_stay_within_their_limits(pendulum, make_case):
    case = make_case(45.0)
    controller = LqrController(pendulum, case.reference, thrust_limits=(0.0, 20.0))
    for pitch in (-1.0, 1.0):
        u = controller.control(0, case.reference.state[0] + [0.0, pitch, 0.0, 0.0])
        assert -1.0 <= u[0] <= 1.0
        assert 0.0 <= u[1] <= 20.0
    with pytest.raises(InvalidSettingError, match="thrust_limits"):
        LqrController(pendulum, case.reference, thrust_limits=(5.0, 1.0))


def test_not_a_number_is_refused_by_name(pendulum, make_case):
    case = make_case(15.0)
    controller = LqrController(pendulum, case.reference)
    with pytest.raises(NonFiniteError, match="pitch"):
        controller.control(0, np.array([0.0, np.nan, 0.0, 0.0]))
    assert np.isfinite(controller.control(0, case.reference.state[0])).all()
