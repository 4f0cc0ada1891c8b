"""The MPC's problem posed in CasADi and solved with its `sqpmethod`: a peer to compare results and times with.

The problem is that of `control.mpc` to the last term (model, costs, soft ground constraints, bounds), written as a
competent user of CasADi would: SX expressions, Gauss-Newton Hessian, warm start from the shifted plan, and calls
through a `FunctionBuffer`, which cost about a microsecond where a call with NumPy arrays costs tens.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypedDict

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.bench.peers import import_peer
from m4_dynamics.control.mpc import kernels
from m4_dynamics.control.mpc.problem import Problem
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.control.reference import ReferenceTrajectory
from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.reduced.pendulum import MipParameters

__all__ = ["CASADI_CONTENDERS", "CasadiController", "CasadiOptions", "build_casadi_controller"]

_Array = NDArray[np.float64]

Transcription = Literal["single", "multiple"]


class CasadiOptions(TypedDict, total=False):
    """Options of `build_casadi_controller`."""

    transcription: Transcription
    qp_solver: str
    iterations: int


#: What `m4 bench` compares with, by name.
CASADI_CONTENDERS: dict[str, CasadiOptions] = {
    "CasADi sqpmethod, DAQP, one iteration": {"qp_solver": "daqp", "iterations": 1},
    "CasADi sqpmethod, DAQP, converged": {"qp_solver": "daqp", "iterations": 50},
    "CasADi sqpmethod, qrqp, multiple shooting, one iteration": {
        "transcription": "multiple",
        "qp_solver": "qrqp",
        "iterations": 1,
    },
}


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where things are in the unknowns w and the parameters p.

    Attributes:
        inputs: Entries of w that hold the scaled inputs, (n, 2) by rows.
        states: Entries of w that hold x_1 .. x_n; empty in single shooting.
        slack: Entry of w that holds the scaled slack, -1 without ground constraints.
        size: Number of unknowns.
    """

    inputs: slice
    states: slice
    slack: int
    size: int


class CasadiController:
    """Calls one CasADi solver per control step; a callable `(step, state) -> inputs`.

    Attributes:
        plan: Planned inputs of the last step, shape (n, 2).
        slack: Slack of the last step [N].
    """

    def __init__(self, problem: Problem, solver: Any, layout: _Layout, equalities: int, inequalities: int) -> None:
        """Bind the solver's arguments and results to arrays.

        Args:
            problem: The problem.
            solver: CasADi's nlpsol object.
            layout: Of its unknowns.
            equalities: Number of equality constraints, which come first.
            inequalities: Number of constraints g <= 0.
        """
        n = problem.settings.horizon
        weights = problem.weights
        self._problem, self._layout, self._solver = problem, layout, solver
        self._scale = weights[kernels.INPUT_SCALE : kernels.INPUT_SCALE + 2]
        self._has_states = layout.states.stop > layout.states.start
        self._step: int | None = None
        self.plan: _Array = np.zeros((n, 2))
        self.slack = 0.0

        rows = equalities + inequalities
        lower, upper = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
        for c in range(2):
            lower[layout.inputs][c::2] = weights[kernels.LOWER + c] / self._scale[c]
            upper[layout.inputs][c::2] = weights[kernels.UPPER + c] / self._scale[c]
        if layout.slack >= 0:
            lower[layout.slack] = 0.0
        self._lower, self._upper = lower[layout.inputs], upper[layout.inputs]
        self._guess = np.zeros(layout.size)
        self._parameters = np.zeros(4 + 8 * n + 16)
        self._result = np.zeros(layout.size)
        self._multipliers_x, self._multipliers_g = np.zeros(layout.size), np.zeros(rows)
        row_lower = np.concatenate([np.zeros(equalities), np.full(inequalities, -np.inf)])
        # The buffer keeps addresses only; the arrays must live as long as it does.
        self._kept = (lower, upper, row_lower, np.zeros(rows))
        self._buffer, self._evaluate = solver.buffer()
        arguments = (self._guess, self._parameters, *self._kept, self._multipliers_x, self._multipliers_g)
        for i, array in enumerate(arguments):
            self._buffer.set_arg(i, array.data)
        for i, array in ((0, self._result), (3, self._multipliers_x), (4, self._multipliers_g)):
            self._buffer.set_res(i, array.data)

    @property
    def success(self) -> bool:
        """Whether the last step converged."""
        return bool(self._buffer.stats()["success"])

    def __call__(self, step: int, state: _Array) -> _Array:
        """Inputs for one sample.

        Args:
            step: Index into the reference trajectory; beyond its end the last sample holds.
            state: (absolute wheel angle, pitch, and their rates), shape (4,).

        Returns:
            (motor duty, thrust [N]), shape (2,).
        """
        problem, layout, guess, p = self._problem, self._layout, self._guess, self._parameters
        n = problem.settings.horizon
        sample = min(step, problem.last_step)
        end = sample + n
        p[:4] = state
        p[4 : 4 + 4 * n] = problem.states[sample + 1 : end + 1].ravel()
        p[4 + 4 * n : 4 + 6 * n] = problem.costed_inputs[sample:end].ravel()
        p[4 + 6 * n : 4 + 7 * n] = np.sin(problem.slopes[sample:end])
        p[4 + 7 * n : 4 + 8 * n] = np.cos(problem.slopes[sample:end])
        p[4 + 8 * n :] = problem.terminals[end].ravel()
        if self._step is not None and step == self._step + 1:
            guess[:] = self._result
            guess[layout.inputs][:-2] = self._result[layout.inputs][2:]
            if self._has_states:
                guess[layout.states][:-4] = self._result[layout.states][4:]
        elif step != self._step:
            start = (problem.inputs[sample:end] / self._scale).ravel()
            guess[layout.inputs] = np.clip(start, self._lower, self._upper)
            if self._has_states:
                guess[layout.states] = problem.states[sample + 1 : end + 1].ravel()
            self._multipliers_x[:] = 0.0
            self._multipliers_g[:] = 0.0
        self._evaluate()
        self._step = step
        np.multiply(self._result[layout.inputs].reshape(n, 2), self._scale, out=self.plan)
        if layout.slack >= 0:
            self.slack = float(self._result[layout.slack] * problem.weights[kernels.SLACK_SCALE])
        inputs: _Array = self.plan[0].copy()
        return inputs


def build_casadi_controller(
    parameters: MipParameters,
    reference: ReferenceTrajectory,
    settings: MpcSettings,
    *,
    transcription: Transcription = "single",
    qp_solver: str = "daqp",
    iterations: int = 1,
) -> CasadiController:
    """Pose the MPC's problem in CasADi.

    Args:
        parameters: The pendulum.
        reference: What to follow.
        settings: The problem's settings; those of the SQP and of ProxQP do not matter here.
        transcription: "single" shooting has the inputs as unknowns, "multiple" shooting the states too.
        qp_solver: CasADi's QP plugin: "daqp", "qrqp", "qpoases" (which prints its licence at every construction), ...
        iterations: Most SQP iterations per step; 1 takes the QP's full step.

    Returns:
        The controller.

    Raises:
        PeerMissingError: If CasADi is not installed.
        InvalidSettingError: If reference and settings disagree on the time step, or the rotors lag.
    """
    ca = import_peer("casadi")
    if parameters.thrust_time_constant > 0.0:
        raise InvalidSettingError("thrust_time_constant", parameters.thrust_time_constant, "0: an ideal rotor")
    problem = Problem(parameters, reference, settings)
    n = settings.horizon
    weights = problem.weights
    scale = weights[kernels.INPUT_SCALE : kernels.INPUT_SCALE + 2]

    x0, state_reference, input_reference = ca.SX.sym("x0", 4), ca.SX.sym("xr", 4, n), ca.SX.sym("ur", 2, n)
    sin_b, cos_b, terminal = ca.SX.sym("sin_b", n), ca.SX.sym("cos_b", n), ca.SX.sym("P", 4, 4)
    inputs, slack = ca.SX.sym("u", 2, n), ca.SX.sym("s", 1 if settings.ground_constraints else 0)
    unknown_states = ca.SX.sym("x", 4, n if transcription == "multiple" else 0)

    x, objective, hessian_terms, defects, rows = x0, 0, [], [], []
    for k in range(n):
        u = inputs[:, k] * ca.DM(scale)
        acceleration, friction, normal = _dynamics(ca, parameters, sin_b[k], cos_b[k], x, u)
        following = x + settings.time_step * ca.vertcat(x[2:], acceleration)
        if transcription == "multiple":
            defects.append(unknown_states[:, k] - following)
            following = unknown_states[:, k]
        rows += [friction - settings.friction_plan * normal, -friction - settings.friction_plan * normal]
        rows.append(settings.normal_force_min - normal)
        error, effort = following - state_reference[:, k], u - input_reference[:, k]
        weight = terminal if k == n - 1 else ca.diag(ca.DM(list(settings.state_weights)))
        effort_weight = ca.diag(ca.DM(list(settings.input_weights)))
        objective += ca.bilin(weight, error, error) + ca.bilin(effort_weight, effort, effort)
        hessian_terms += [(weight, error), (effort_weight, effort)]
        x = following
    unknowns = ca.vertcat(ca.vec(inputs), ca.vec(unknown_states), slack)
    slack_size = weights[kernels.SLACK_SCALE]
    hessian = ca.SX(unknowns.numel(), unknowns.numel())
    for weight, residual in hessian_terms:
        jacobian = ca.jacobian(residual, unknowns)
        hessian += 2 * ca.mtimes([jacobian.T, weight, jacobian])
    if settings.ground_constraints:
        newtons = slack * slack_size
        objective += settings.slack_weight * newtons + settings.slack_curvature * newtons**2
        hessian[-1, -1] += 2 * settings.slack_curvature * slack_size**2
        rows = [row - newtons for row in rows]
    else:
        rows = []
    p = ca.vertcat(x0, ca.vec(state_reference), ca.vec(input_reference), sin_b, cos_b, ca.vec(terminal))
    constraints = ca.vertcat(*defects, *rows)
    lam_f, lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", constraints.numel())
    gauss_newton = ca.Function(
        "nlp_hess_l",
        [unknowns, p, lam_f, lam_g],
        [lam_f * hessian],
        ["x", "p", "lam_f", "lam_g"],
        ["hess_gamma_x_x"],
    )
    quiet = {"print_header": False, "print_iteration": False, "print_status": False}
    solver = ca.nlpsol(
        "mpc",
        "sqpmethod",
        {"x": unknowns, "p": p, "f": objective, "g": constraints},
        {
            "hess_lag": gauss_newton,
            "qpsol": qp_solver,
            "qpsol_options": {"error_on_fail": False, **_QUIET_QP.get(qp_solver, {})},
            "max_iter": iterations,
            "max_iter_ls": 0 if iterations == 1 else 10,
            "tol_pr": 1e-8,
            "tol_du": 1e-6,
            "error_on_fail": False,
            "print_time": False,
            "calc_f": False,
            **quiet,
        },
    )
    size = unknowns.numel()
    states = slice(2 * n, 2 * n + unknown_states.numel())
    layout = _Layout(slice(0, 2 * n), states, size - 1 if settings.ground_constraints else -1, size)
    return CasadiController(problem, solver, layout, unknown_states.numel(), len(rows))


#: Options that silence a QP plugin.
_QUIET_QP: dict[str, dict[str, Any]] = {
    "qpoases": {"printLevel": "none"},
    "qrqp": {"print_iter": False, "print_header": False, "print_info": False},
}


def _dynamics(ca: Any, parameters: MipParameters, sin_b: Any, cos_b: Any, x: Any, u: Any) -> tuple[Any, Any, Any]:
    """Accelerations (2,), friction and normal force of the pendulum, symbolically (paper, eq. eom_2d_v2)."""
    l_x, l_z = parameters.com_in_body
    m_b, mass, r, g = parameters.mass_body, parameters.mass, parameters.wheel_radius, parameters.gravity
    sin_t, cos_t, rate = ca.sin(x[1]), ca.cos(x[1]), x[3]
    sin_tb, cos_tb = sin_t * cos_b + cos_t * sin_b, cos_t * cos_b - sin_t * sin_b
    eta, eta_t = l_z * cos_tb - l_x * sin_tb, -l_z * sin_tb - l_x * cos_tb
    emf_rate = x[2] - rate if parameters.motor_model == "relative" else x[2]
    torque = parameters.torque_constant * u[0] - parameters.back_emf_constant * emf_rate
    m11, m12 = parameters.inertia_wheel + mass * r**2, m_b * r * eta
    m22 = parameters.inertia_body + m_b * (l_x**2 + l_z**2)
    rhs1 = torque + r * cos_tb * u[1] - m_b * r * eta_t * rate**2 - mass * g * r * sin_b
    rhs2 = -torque + parameters.thrust_point_in_body[1] * u[1] + m_b * g * (l_x * cos_t + l_z * sin_t)
    determinant = m11 * m22 - m12**2
    wheel, body = (m22 * rhs1 - m12 * rhs2) / determinant, (m11 * rhs2 - m12 * rhs1) / determinant
    friction = mass * (r * wheel + g * sin_b) + m_b * (eta * body + eta_t * rate**2) - u[1] * cos_tb
    normal = m_b * (eta_t * body - eta * rate**2) + mass * g * cos_b + u[1] * sin_tb
    return ca.vertcat(wheel, body), friction, normal
