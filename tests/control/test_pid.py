"""The wheels-only balance."""

from __future__ import annotations

import numpy as np
import pytest

from m4_dynamics.control.controller import BalanceController
from m4_dynamics.control.pid import PidController, PidGains
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.reduced.linear import discretise_zoh
from m4_dynamics.reduced.pendulum import linearise


def test_designed_gains_stabilise_the_sampled_model(pendulum, make_case):
    case = make_case(0.0)
    gains = PidController(pendulum, case.reference).gains
    a, b = linearise(pendulum, case.slope, case.trim.state, case.trim.inputs)
    a5 = np.block([[a, np.zeros((4, 1))], [np.array([[1.0, 0.0, 0.0, 0.0, 0.0]])]])
    a_d, b_d = discretise_zoh(a5, np.vstack([b[:, :1], [[0.0]]]), 0.005)
    feedback = np.array(
        [
            [
                gains.wheel_proportional,
                gains.pitch_proportional,
                gains.wheel_derivative,
                gains.pitch_derivative,
                gains.wheel_integral,
            ]
        ]
    )
    assert np.abs(np.linalg.eigvals(a_d - b_d @ feedback)).max() < 1.0
    assert np.abs(np.linalg.eigvals(a_d)).max() > 1.0


@pytest.mark.parametrize("pitch_error_deg", [-5.0, 5.0])
def test_balances_and_drives_on_flat_ground(pendulum, make_case, simulate, pitch_error_deg):
    case = make_case(0.0)
    controller = PidController(pendulum, case.reference)
    assert isinstance(controller, BalanceController)
    run = simulate(controller, case.reference, pitch_error_deg=pitch_error_deg)
    assert not run.fell
    assert np.abs(run.error[-1]).max() < 2e-3
    np.testing.assert_array_equal(run.inputs[:, 1], case.reference.inputs[:, 1])


def test_integral_removes_the_offset_of_a_wrong_model(pendulum, make_case, simulate):
    case = make_case(0.0, speed=0.0, duration=20.0)
    # A body whose CoM the controller believes 5 mm off leaves an offset that only the integral removes.
    believed = pendulum.with_(com_in_body=(0.026, 0.447))
    wrong = make_case(0.0, speed=0.0, duration=20.0).reference
    wrong.state[:, 1] -= np.arctan2(0.005, 0.447)
    gains = PidController(believed, wrong).gains
    with_integral = simulate(PidController(pendulum, wrong, gains=gains), wrong)
    without = simulate(PidController(pendulum, wrong, gains=gains._replace(wheel_integral=0.0)), wrong)
    assert not with_integral.fell
    assert abs(with_integral.error[-1, 0]) < 0.1 * abs(without.error[-1, 0])
    assert case.trim.pitch != wrong.state[0, 1]


def test_duty_saturates_and_the_integral_waits(pendulum, make_case):
    case = make_case(0.0)
    controller = PidController(pendulum, case.reference, gains=PidGains(0.0, 1.0, 0.0, 100.0, 0.0))
    leaning = case.reference.state[0] + np.array([5.0, 0.5, 0.0, 0.0])
    for _ in range(50):
        assert controller.control(0, leaning)[0] == -1.0
    upright = case.reference.state[0]
    assert controller.control(0, upright)[0] == pytest.approx(case.reference.inputs[0, 0])
    with pytest.raises(InvalidSettingError, match="duty_limits"):
        PidController(pendulum, case.reference, duty_limits=(1.0, -1.0))


def test_reset_clears_the_integral(pendulum, make_case):
    case = make_case(0.0)
    controller = PidController(pendulum, case.reference)
    first = controller.control(0, case.reference.state[0] + [0.01, 0.0, 0.0, 0.0])
    controller.control(1, case.reference.state[0] + [0.01, 0.0, 0.0, 0.0])
    controller.reset()
    np.testing.assert_array_equal(controller.control(0, case.reference.state[0] + [0.01, 0.0, 0.0, 0.0]), first)
