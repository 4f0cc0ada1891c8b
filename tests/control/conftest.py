"""Shared pieces of the control tests: the pendulum, references, and a closed loop on the reduced model."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from m4_dynamics.control.controller import BalanceController, Diagnostics
from m4_dynamics.control.reference import ReferenceTrajectory, climb_reference
from m4_dynamics.reduced.kernels import ground_force, mip_step
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.trim import Trim, select_trim

STATE_WEIGHTS = np.array([10.0, 1e4, 5.0, 25.0])

#: Thrust of the trim on each slope [N]: little, where the ground alone would nearly do, more on the steepest.
TRIM_THRUST = {0.0: 2.0, 15.0: 2.0, 30.0: 2.0, 45.0: 15.0}


class Case(NamedTuple):
    """A trim on a slope and a climb from it."""

    slope: float
    trim: Trim
    reference: ReferenceTrajectory


class Run(NamedTuple):
    """A closed loop on the reduced model; row k belongs to control step k, up to a fall."""

    error: np.ndarray
    inputs: np.ndarray
    force: np.ndarray
    diagnostics: list[Diagnostics]
    fell: bool

    @property
    def friction_use(self) -> np.ndarray:
        return np.abs(self.force[:, 0]) / self.force[:, 1]

    @property
    def tracking_cost(self) -> np.ndarray:
        return np.einsum("ki,i,ki->k", self.error, STATE_WEIGHTS, self.error)


@pytest.fixture(scope="session")
def pendulum() -> MipParameters:
    """M4 in MIP posture, by hand from its mass table."""
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


@pytest.fixture(scope="session")
def make_case(pendulum: MipParameters) -> Callable[..., Case]:
    """Build a case: slope in degrees, thrust of its trim, and options of the climb."""

    def make(slope_deg: float, *, thrust: float | None = None, **options: float) -> Case:
        slope = np.radians(slope_deg)
        chosen = TRIM_THRUST[slope_deg] if thrust is None else thrust
        trim = select_trim(pendulum, slope, criterion="thrust", thrust=chosen)
        return Case(slope, trim, climb_reference(pendulum, slope, trim, **options))

    return make


@pytest.fixture(scope="session")
def simulate(pendulum: MipParameters) -> Callable[..., Run]:
    """Close the loop with the reduced model (Runge-Kutta, inputs held) as the plant."""

    def run(
        controller: BalanceController,
        reference: ReferenceTrajectory,
        *,
        pitch_error_deg: float = 0.0,
        steps: int | None = None,
        push: tuple[int, float] | None = None,
        plant: np.ndarray | None = None,
    ) -> Run:
        p = pendulum.as_array() if plant is None else plant
        dt = reference.time_step
        x = reference.state[0].copy()
        x[1] += np.radians(pitch_error_deg)
        force = np.zeros(2)
        error, inputs, forces, diagnostics = [], [], [], []
        fell = False
        for k in range(len(reference) if steps is None else steps):
            sample = min(k, len(reference) - 1)
            if push is not None and k == push[0]:
                x[3] += push[1]
            u = controller.control(k, x)
            ground_force(p, reference.slope[sample], x, u, force)
            error.append(x - reference.state[sample])
            inputs.append(u)
            forces.append(force.copy())
            diagnostics.append(controller.diagnostics)
            if abs(error[-1][1]) > 1.2:
                fell = True
                break
            mip_step(p, reference.slope[sample], x, u, dt, 2, x)
        return Run(np.array(error), np.array(inputs), np.array(forces), diagnostics, fell)

    return run
