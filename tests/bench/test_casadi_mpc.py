"""CasADi's solution of the MPC's problem is the MPC's: the model, costs and constraints written a second time."""

from __future__ import annotations

import numpy as np
import pytest

from m4_dynamics.bench import peers
from m4_dynamics.bench.casadi_mpc import CASADI_CONTENDERS, build_casadi_controller
from m4_dynamics.bench.peers import PeerMissingError
from m4_dynamics.control.mpc.controller import MpcController
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.control.reference import ReferenceTrajectory, climb_reference
from m4_dynamics.reduced.kernels import mip_step
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.trim import select_trim

SLOPE = np.radians(45.0)


@pytest.fixture(scope="module")
def pendulum() -> MipParameters:
    return MipParameters(
        mass_body=5.095,
        mass_wheel=0.905,
        inertia_body=0.305,
        inertia_wheel=0.004,
        com_in_body=(0.021, 0.447),
        thrust_point_in_body=(0.114, 0.744),
        wheel_radius=0.125,
        torque_constant=6.0,
        back_emf_constant=0.4,
    )


@pytest.fixture(scope="module")
def reference(pendulum: MipParameters) -> ReferenceTrajectory:
    trim = select_trim(pendulum, SLOPE, criterion="thrust", thrust=12.0)
    return climb_reference(pendulum, SLOPE, trim)


def climb(pendulum, reference, controller, steps=300):
    """States and inputs of a start from +5 deg, which saturates the thrust and uses the friction up."""
    x, states, inputs = reference.state[0] + [0.0, np.radians(5.0), 0.0, 0.0], [], []
    for k in range(steps):
        states.append(x.copy())
        inputs.append(controller.control(k, x))
        mip_step(pendulum.as_array(), SLOPE, x, inputs[-1], 0.005, 2, x)
    return np.array(states), np.array(inputs)


@pytest.mark.parametrize("terminal_cost", ["riccati", "none"])
def test_one_iteration_agrees_step_by_step(pendulum, reference, require_peer, terminal_cost):
    require_peer("casadi")
    settings = MpcSettings(terminal_cost=terminal_cost, solver_tolerance=1e-9, disturbance_rejection=False)
    states, inputs = climb(pendulum, reference, MpcController(pendulum, reference, settings))
    peer = build_casadi_controller(pendulum, reference, settings, iterations=1)
    theirs = np.array([peer(k, x) for k, x in enumerate(states)])
    np.testing.assert_allclose(theirs / [1.0, 21.6], inputs / [1.0, 21.6], atol=2e-5)


@pytest.mark.parametrize("transcription", ["single", "multiple"])
def test_converged_solutions_agree(pendulum, reference, require_peer, transcription):
    require_peer("casadi")
    settings = MpcSettings(sqp_iterations=50, solver_tolerance=1e-9, disturbance_rejection=False)
    ours = MpcController(pendulum, reference, settings)
    states, inputs = climb(pendulum, reference, ours, steps=60)
    peer = build_casadi_controller(pendulum, reference, settings, transcription=transcription, iterations=50)
    for k, x in enumerate(states):
        np.testing.assert_allclose(peer(k, x) / [1.0, 21.6], inputs[k] / [1.0, 21.6], atol=1e-6)


def test_slack_agrees_where_the_friction_cannot_suffice(pendulum, reference, require_peer):
    require_peer("casadi")
    settings = MpcSettings(friction_static=0.3, sqp_iterations=50, solver_tolerance=1e-9, disturbance_rejection=False)
    ours = MpcController(pendulum, reference, settings)
    peer = build_casadi_controller(pendulum, reference, settings, iterations=50)
    x = reference.state[0] + [0.0, 0.02, 0.0, 0.0]
    u = ours.control(0, x)
    np.testing.assert_allclose(peer(0, x), u, atol=1e-3)
    assert peer.slack > 0.1
    assert peer.slack == pytest.approx(ours.diagnostics.slack, rel=1e-3)


def test_every_contender_of_the_benchmark_runs(pendulum, reference, require_peer):
    require_peer("casadi")
    settings = MpcSettings(ground_constraints=False)
    expected = MpcController(pendulum, reference, settings).control(0, reference.state[0])
    for options in CASADI_CONTENDERS.values():
        peer = build_casadi_controller(pendulum, reference, settings, **options)
        np.testing.assert_allclose(peer(0, reference.state[0]), expected, atol=1e-5)


def test_without_casadi_the_message_says_what_to_install(pendulum, reference, monkeypatch):
    def missing(name: str):
        raise ImportError(f"No module named '{name}'")

    monkeypatch.setattr(peers.importlib, "import_module", missing)
    with pytest.raises(PeerMissingError, match="extra 'peers'"):
        build_casadi_controller(pendulum, reference, MpcSettings())
