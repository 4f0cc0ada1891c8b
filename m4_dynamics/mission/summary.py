"""What a mission came to: a verdict, its phases, and figures of each."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from m4_dynamics.mission.schema import BalancePhase, Mission

if TYPE_CHECKING:
    import xarray

__all__ = ["MissionSummary", "PhaseFigures", "PhaseOutcome", "summarise_mission"]


@dataclass(frozen=True, slots=True)
class PhaseOutcome:
    """How a phase ended.

    Attributes:
        name: Its name.
        kind: Its kind.
        first, last: Its rows in the trajectory, last exclusive.
        failure: Why it failed, or None.
    """

    name: str
    kind: str
    first: int
    last: int
    failure: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PhaseFigures:
    """Figures of one phase; None where they mean nothing.

    Attributes:
        ended: "done", or why it failed.
        thrust_peak_N: Largest total thrust.
        thrust_margin_N: From there to the limit of the balancing thrusters.
        servo_torque_peak_Nm: Largest servo torque.
        slip_time_s: Time that the worst drive wheel slid faster than 5 mm/s, away from corners.
        corner_slip_time_s: The same within a tenth of a second of a corner: a wheel that touches two segments at once
            cannot roll on both, so it slides on one of them for a moment.
        max_slip_speed_m_s: Fastest sliding of a drive wheel, away from corners.
        friction_use_along_slope: Largest share of mu_s used along the slope, means over a sample, away from corners.
        wheel_rms_m, pitch_rms_deg: Against the reference.
        heading_max_deg: Largest heading error.
        ground_force_rms_over_weight: Reduced model's ground force against the simulated one, away from corners.
        cost_first, cost_last: Median cost of the MPC in the first and last quarter of the time on the incline.
        fallbacks: Control steps answered by the fallback.
    """

    name: str
    kind: str
    start_s: float
    end_s: float
    ended: str
    thrust_peak_N: float | None = None
    thrust_margin_N: float | None = None
    servo_torque_peak_Nm: float | None = None
    slip_time_s: float | None = None
    corner_slip_time_s: float | None = None
    max_slip_speed_m_s: float | None = None
    friction_use_along_slope: float | None = None
    wheel_rms_m: float | None = None
    pitch_rms_deg: float | None = None
    heading_max_deg: float | None = None
    ground_force_rms_over_weight: float | None = None
    cost_first: float | None = None
    cost_last: float | None = None
    fallbacks: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionSummary:
    """A mission's verdict and figures.

    Attributes:
        verdict: "completed", "failed", or "interrupted".
        reason: One sentence.
        phases: Figures of each phase that ran.
    """

    verdict: str
    reason: str
    mission: str
    slope_deg: float
    friction_static: float
    duration_s: float
    travel_max_m: float
    newton_failures: int
    real_time_factor: float
    phases: tuple[PhaseFigures, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)


def summarise_mission(
    dataset: xarray.Dataset,
    mission: Mission,
    outcomes: tuple[PhaseOutcome, ...],
    *,
    real_time_factor: float,
    newton_failures: int,
    thrust_max: float,
) -> MissionSummary:
    """Judge a mission.

    Args:
        dataset: Its trajectory.
        mission: What was asked for.
        outcomes: How its phases ended.
        real_time_factor: Simulated over elapsed time.
        newton_failures: Steps whose contact forces did not converge.
        thrust_max: Limit of the balancing thrusters together [N].

    Returns:
        The summary.
    """
    figures = tuple(
        _phase_figures(dataset, phase, outcome, thrust_max)
        for phase, outcome in zip(mission.phases, outcomes, strict=False)
    )
    last = outcomes[-1]
    if last.failure is None:
        verdict, reason = "completed", f"all {len(outcomes)} phases done in {float(dataset.time[-1]):.1f} s"
    else:
        verdict = "interrupted" if last.failure.startswith("interrupted") else "failed"
        reason = f"phase '{last.name}' {last.failure}"
    return MissionSummary(
        verdict=verdict,
        reason=reason,
        mission=mission.name,
        slope_deg=round(math.degrees(mission.terrain.slope), 9),
        friction_static=float(dataset.attrs["friction_static"]),
        duration_s=float(dataset.time[-1]) if dataset.sizes["time"] else 0.0,
        travel_max_m=float(dataset.travel.max()),
        newton_failures=newton_failures,
        real_time_factor=real_time_factor,
        phases=figures,
    )


def _phase_figures(dataset: xarray.Dataset, phase: object, outcome: PhaseOutcome, thrust_max: float) -> PhaseFigures:
    part = dataset.isel(time=slice(outcome.first, outcome.last))
    ended = "done" if outcome.failure is None else outcome.failure
    if part.sizes["time"] == 0:
        now = float(dataset.time[min(outcome.first, dataset.sizes["time"] - 1)])
        return PhaseFigures(name=outcome.name, kind=outcome.kind, start_s=now, end_s=now, ended=ended)
    thrust = part.thrust.sum("thruster").to_numpy()
    figures: dict[str, Any] = {
        "name": outcome.name,
        "kind": outcome.kind,
        "start_s": float(part.time[0]),
        "end_s": float(part.time[-1]),
        "ended": ended,
        "thrust_peak_N": float(thrust.max()),
        "thrust_margin_N": float(thrust_max - thrust.max()),
        "servo_torque_peak_Nm": float(np.abs(part.servo_torque).max()),
    }
    if isinstance(phase, BalancePhase):
        figures.update(_balance_figures(part, phase))
    return PhaseFigures(**figures)


def _balance_figures(part: xarray.Dataset, phase: BalancePhase) -> dict[str, Any]:
    radius, weight = float(part.attrs["wheel_radius_m"]), float(part.attrs["weight_N"])
    wheels = part.sel(wheel=list(part.attrs["drive_wheels"]))
    error = (part.state - part.state_reference).to_numpy()
    slope = part.slope.to_numpy()
    incline = slope > 0.5 * slope.max() if slope.max() > 0.0 else np.zeros(len(slope), dtype=bool)
    force, model = part.ground_force_simulated.to_numpy(), part.ground_force_model.to_numpy()
    # Over a corner the axle's direction jumps, which no planar rigid model reproduces: a tenth of a second aside.
    change = np.flatnonzero(np.diff(slope)) + 1
    near_corner = np.zeros(len(slope), dtype=bool)
    for k in change:
        near_corner[max(k - 20, 0) : k + 20] = True
    settled = ~near_corner & (np.arange(len(slope)) >= 20)
    pressed = (force[:, 1] > 1.0) & ~near_corner
    use = np.abs(force[pressed, 0]) / (float(part.attrs["friction_static"]) * force[pressed, 1])
    figures: dict[str, Any] = {
        "slip_time_s": float(wheels.slip_time.to_numpy()[~near_corner].sum(axis=0).max()),
        "corner_slip_time_s": float(wheels.slip_time.to_numpy()[near_corner].sum(axis=0).max()),
        "max_slip_speed_m_s": float(wheels.slip_speed.to_numpy()[~near_corner].max(initial=0.0)),
        "friction_use_along_slope": float(use.max()) if use.size else None,
        "wheel_rms_m": radius * float(np.sqrt(np.mean(error[:, 0] ** 2))),
        "pitch_rms_deg": math.degrees(float(np.sqrt(np.mean(error[:, 1] ** 2)))),
        "fallbacks": int(part.fallback.sum()),
    }
    if phase.turn == 0.0:
        heading = part.heading.to_numpy()
        figures["heading_max_deg"] = math.degrees(float(np.abs(heading - np.median(heading)).max()))
    if settled.any():
        difference = np.linalg.norm((model - force)[settled], axis=1)
        figures["ground_force_rms_over_weight"] = float(np.sqrt(np.mean(difference**2))) / weight
    if phase.controller != "pid" and incline.sum() >= 8:
        cost = part.cost.to_numpy()[incline]
        quarter = len(cost) // 4
        figures["cost_first"] = float(np.median(cost[:quarter]))
        figures["cost_last"] = float(np.median(cost[-quarter:]))
    return figures
