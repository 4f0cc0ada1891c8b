"""Delay compensation: a late command on a predicted state is the punctual command of the state that it meets."""

from __future__ import annotations

import math

import numpy as np
import pytest

from m4_dynamics.control.controller import BalanceController
from m4_dynamics.control.delay import DelayCompensator
from m4_dynamics.control.lqr import LqrController
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.reduced.kernels import mip_step

DT = 5e-3
SLOPE = math.radians(30.0)


@pytest.fixture(scope="module")
def setting(pendulum, make_case):
    return pendulum, make_case(30.0, thrust=8.0).reference


def advance(parameters, state, inputs):
    after = np.empty(4)
    mip_step(parameters.as_array(), SLOPE, state, np.asarray(inputs), DT, 1, after)
    return after


@pytest.mark.parametrize("delay", [1, 4])
def test_late_loop_is_the_punctual_loop_from_where_the_first_command_acts(setting, delay):
    parameters, reference = setting
    late = DelayCompensator(LqrController(parameters, reference), parameters, reference, delay=delay)
    punctual = LqrController(parameters, reference)
    state = reference.state[0] + [0.0, math.radians(3.0), 0.1, -0.1]
    commands = [reference.inputs[0]] * delay
    shadow = None
    for k in range(600):
        if k == delay:
            shadow = state.copy()
        commands.append(late.control(k, state))
        state = advance(parameters, state, commands[k])
        if shadow is not None:
            shadow = advance(parameters, shadow, punctual.control(k, shadow))
            np.testing.assert_allclose(state, shadow, rtol=0.0, atol=1e-9)
    assert np.abs(state - reference.state[600])[1] < 1e-3


def test_prediction_knows_the_rotors_lag(setting):
    parameters, reference = setting
    lag, delay = 0.15, 3
    one = DelayCompensator(
        LqrController(parameters, reference), parameters, reference, delay=delay, rotor_time_constant=lag
    )
    packed = parameters.as_array()
    state, thrust = reference.state[0] + [0.0, 0.05, 0.0, 0.0], float(reference.inputs[0, 1])
    commands = [reference.inputs[0]] * delay
    for k in range(20):
        predicted = one.predict(k, state)
        commands.append(one.control(k, state))
        # The truth: the thrust follows exponentially, in steps of 10 microseconds.
        ahead, its_thrust = state.copy(), thrust
        for sample in range(delay):
            duty, wanted = commands[k + sample]
            for _ in range(500):
                its_thrust += -math.expm1(-DT / 500 / lag) * (wanted - its_thrust)
                mip_step(packed, SLOPE, ahead, np.array([duty, its_thrust]), DT / 500, 1, ahead)
            if sample == 0:
                state, thrust = ahead.copy(), its_thrust
        np.testing.assert_allclose(predicted, ahead, rtol=0.0, atol=2e-5)
    assert abs(thrust - commands[20][1]) > 0.5, "the thrust must have been on its way"


def test_it_is_a_balance_controller_that_starts_anew(setting):
    parameters, reference = setting
    one = DelayCompensator(LqrController(parameters, reference), parameters, reference, delay=2)
    assert isinstance(one, BalanceController)
    state = reference.state[0] + [0.0, 0.05, 0.0, 0.0]
    first = [one.control(k, state) for k in range(5)]
    one.reset()
    np.testing.assert_array_equal([one.control(k, state) for k in range(5)], first)
    assert one.diagnostics == one.controller.diagnostics


@pytest.mark.parametrize(("change", "message"), [({"delay": 0}, "delay"), ({"rotor_time_constant": -1.0}, "rotor")])
def test_what_is_no_delay_is_refused(setting, change, message):
    parameters, reference = setting
    with pytest.raises(InvalidSettingError, match=message):
        DelayCompensator(LqrController(parameters, reference), parameters, reference, **{"delay": 1, **change})
