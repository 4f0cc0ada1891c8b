"""What a climb came to: a verdict in one word, a sentence, and figures with the limits they are held against."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray

__all__ = ["SETTLING_TIME", "ClimbSummary", "StepTimes", "Verdict", "summarise_climb"]

#: Slip is judged after this time [s]: before it the robot recovers from its initial error.
SLIP_GRACE = 0.5
#: Tracking is judged after this time [s].
SETTLING_TIME = 1.0
#: A run slipped if a wheel slid for longer than this after the grace time [s].
SLIP_TIME_ALLOWED = 0.1
#: A run climbed if it ended no further from its goal than this part of the way (of a metre at least).
SHORTFALL_ALLOWED = 0.1


class Verdict(StrEnum):
    """How a run ended.

    Attributes:
        CLIMBED: Arrived, without sliding.
        SLIPPED: A wheel slid for longer than 0.1 s, or the robot ended short of its goal for want of grip.
        FELL: The body touched the ground or leaned too far from its reference.
        INFEASIBLE: No equilibrium exists within the limits; nothing was simulated.
        LAGGED: Stayed up without sliding, but ended more than a tenth of the way below its goal.
        ABORTED: Interrupted, or the simulation diverged.
    """

    CLIMBED = "climbed"
    SLIPPED = "slipped"
    FELL = "fell"
    INFEASIBLE = "infeasible"
    LAGGED = "lagged"
    ABORTED = "aborted"


@dataclass(frozen=True, slots=True)
class StepTimes:
    """Wall-clock times of the controller [microseconds]."""

    median: float
    p99: float

    @classmethod
    def from_seconds(cls, seconds: NDArray[np.float64]) -> StepTimes:
        """Median and 99th percentile of step times in seconds; zeros when there are none."""
        if len(seconds) == 0:
            return cls(0.0, 0.0)
        return cls(float(1e6 * np.median(seconds)), float(1e6 * np.percentile(seconds, 99.0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ClimbSummary:
    """Figures of one climb; the names carry the units. `None` where nothing was simulated for it.

    Attributes:
        verdict: One word.
        reason: One sentence.
        remarks: What else a reader should know, in sentences.
        max_friction_use: Largest |friction| / (mu_s normal force) on a drive wheel after the first 0.5 s, sideways
            force included. The wheels press against each other sideways: it may reach 1 while they only creep.
        max_friction_use_along_slope: The same for the force along the slope alone, means over a sample.
        min_normal_force_N: Least normal force on a drive wheel after the first 0.5 s.
        slip_time_s: Time that the worst wheel's contact point slid faster than 5 mm/s, after the first 0.5 s.
        slip_distance_m: Distance slid by the worst wheel after the first 0.5 s, creep of the friction law included.
        max_slip_speed_m_s: Largest sliding speed, lateral motion included, after the first 0.5 s.
        air_time_s: Time that a drive wheel was off the ground after the first 0.5 s.
        wheel_rms_m: True axle travel against its reference, after the first second.
        pitch_rms_deg: Pitch against its reference, after the first second.
        yaw_max_deg: Largest heading error after the first second.
        climbed_m: True travel of the axle along the slope.
        end_speed_m_s: True speed of the axle at the end.
        ground_force_rms_over_weight: Model against simulated ground force, both components, after the first second.
        steady_cost: Sum of e^T Q e over the samples after the first second, the paper's Q, true state.
        pitch_estimate_rms_deg: Error of the pitch that the controller saw, after the first second.
        heading_estimate_max_deg: Largest error of the heading that it saw, after the first second.
        battery_min_V: Lowest voltage of the battery; None where the supply is ideal.
        battery_charge_end: Charge left at the end.
        fallbacks: Control steps answered by the fallback.
        newton_failures: Simulation steps whose contact forces did not converge.
        mpc_step_us: Median and 99th percentile of the controller's time per step.
        real_time_factor: Simulated over elapsed time of the closed loop, logging included.
    """

    verdict: str
    reason: str
    slope_deg: float
    friction_static: float
    controller: str
    fidelity: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    speed_m_s: float | None = None
    duration_s: float | None = None
    pitch_error_deg: float | None = None
    yaw_error_deg: float | None = None
    trim_pitch_deg: float | None = None
    trim_thrust_N: float | None = None
    trim_friction_needed: float | None = None
    max_friction_use: float | None = None
    max_friction_use_along_slope: float | None = None
    min_normal_force_N: float | None = None
    slip_time_s: float | None = None
    slip_distance_m: float | None = None
    max_slip_speed_m_s: float | None = None
    air_time_s: float | None = None
    wheel_rms_m: float | None = None
    pitch_rms_deg: float | None = None
    yaw_max_deg: float | None = None
    climbed_m: float | None = None
    goal_m: float | None = None
    end_speed_m_s: float | None = None
    ground_force_rms_over_weight: float | None = None
    steady_cost: float | None = None
    pitch_estimate_rms_deg: float | None = None
    heading_estimate_max_deg: float | None = None
    battery_min_V: float | None = None
    battery_charge_end: float | None = None
    fallbacks: int | None = None
    newton_failures: int | None = None
    servo_saturations: int | None = None
    mpc_step_us: StepTimes | None = None
    real_time_factor: float | None = None
    warm_up_s: float | None = None
    provenance: dict[str, str] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; figures that are not finite become None."""
        values = asdict(self)
        return {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in values.items()
        }


def summarise_climb(dataset: xarray.Dataset, *, ended: str | None, **context: Any) -> ClimbSummary:
    """Judge a run.

    Args:
        dataset: The trajectory.
        ended: Why it ended before its time: "fell: ...", "aborted: ..." or None.
        context: Further fields of `ClimbSummary` (controller, trim, times, ...).

    Returns:
        The summary.
    """
    time = dataset["time"].to_numpy()
    wheels = list(dataset.attrs["drive_wheels"])
    radius, weight = float(dataset.attrs["wheel_radius_m"]), float(dataset.attrs["weight_N"])
    after_grace, settled = time >= SLIP_GRACE, time >= SETTLING_TIME
    on_wheels = dataset.sel(wheel=wheels)
    state, reference = dataset["state"].to_numpy(), dataset["state_reference"].to_numpy()
    error = state - reference

    def worst(name: str) -> float:
        return float(on_wheels[name].to_numpy()[after_grace].sum(axis=0).max())

    def rms(values: NDArray[np.float64]) -> float | None:
        return float(np.sqrt(np.mean(values**2))) if values.size else None

    def peak(values: NDArray[np.float64]) -> float | None:
        return float(np.max(np.abs(values))) if values.size else None

    grip = on_wheels["friction_use"].to_numpy()[after_grace]
    normal = on_wheels["normal_force_min"].to_numpy()[after_grace]
    slope = math.radians(float(dataset.attrs["slope_deg"]))
    on_slope = on_wheels["contact_force_in_world"].to_numpy()[after_grace]
    along = on_slope[..., 0] * math.cos(slope) + on_slope[..., 2] * math.sin(slope)
    across = on_slope[..., 2] * math.cos(slope) - on_slope[..., 0] * math.sin(slope)
    pressed = across > 1e-6
    use_along_slope = np.abs(along[pressed]) / (float(dataset.attrs["friction_static"]) * across[pressed])
    force_error = dataset["ground_force_model"].to_numpy() - dataset["ground_force_simulated"].to_numpy()
    figures: dict[str, Any] = {
        "max_friction_use": peak(grip),
        "max_friction_use_along_slope": peak(use_along_slope),
        "min_normal_force_N": float(normal.min()) if normal.size else None,
        "slip_time_s": worst("slip_time"),
        "slip_distance_m": worst("slip_distance"),
        "max_slip_speed_m_s": peak(on_wheels["slip_speed"].to_numpy()[after_grace]),
        "air_time_s": worst("air_time"),
        "wheel_rms_m": rms(radius * error[settled, 0]),
        "pitch_rms_deg": rms(np.degrees(error[settled, 1])),
        "yaw_max_deg": peak(np.degrees(dataset["heading"].to_numpy()[settled])),
        "climbed_m": radius * float(state[-1, 0]),
        "goal_m": radius * float(reference[-1, 0]),
        "end_speed_m_s": radius * abs(float(state[-1, 2])),
        "ground_force_rms_over_weight": rms(np.linalg.norm(force_error[settled], axis=1) / weight),
        "steady_cost": float(dataset["tracking_cost"].to_numpy()[settled].sum()) if settled.any() else None,
        "pitch_estimate_rms_deg": rms(np.degrees(dataset["state_estimated"].to_numpy() - state)[settled, 1]),
        "heading_estimate_max_deg": peak(
            np.degrees((dataset["heading_estimated"] - dataset["heading"]).to_numpy()[settled])
        ),
        "fallbacks": int(dataset["fallback"].to_numpy().sum()),
    }
    if "battery_voltage" in dataset:
        figures["battery_min_V"] = float(dataset["battery_voltage"].min())
        figures["battery_charge_end"] = float(dataset["battery_charge"][-1])
    verdict, reason = _verdict(figures, ended)
    return ClimbSummary(
        verdict=verdict.value,
        reason=reason,
        remarks=_remarks(dataset, figures, settled),
        slope_deg=float(dataset.attrs["slope_deg"]),
        friction_static=float(dataset.attrs["friction_static"]),
        **figures,
        **context,
    )


def _verdict(figures: dict[str, Any], ended: str | None) -> tuple[Verdict, str]:
    goal, climbed = figures["goal_m"], figures["climbed_m"]
    if ended is not None:
        word, _, why = ended.partition(": ")
        return Verdict(word), why
    shortfall = abs(goal - climbed)
    slid = figures["slip_time_s"] > SLIP_TIME_ALLOWED or figures["air_time_s"] > SLIP_TIME_ALLOWED
    if slid:
        return Verdict.SLIPPED, (
            f"a wheel slid for {figures['slip_time_s']:.2f} s and was off the ground for {figures['air_time_s']:.2f} s "
            f"(at most {SLIP_TIME_ALLOWED:g} s is allowed)"
        )
    if shortfall > SHORTFALL_ALLOWED * max(abs(goal), 1.0):
        return Verdict.LAGGED, f"it stayed up without sliding but ended {shortfall:.2f} m from its goal at {goal:.2f} m"
    return Verdict.CLIMBED, f"it climbed {climbed:.2f} m and stands {1e3 * shortfall:.0f} mm from its goal"


def _remarks(dataset: xarray.Dataset, figures: dict[str, Any], settled: NDArray[np.bool_]) -> tuple[str, ...]:
    """What the figures say about tracking and cost."""
    remarks = []
    radius = float(dataset.attrs["wheel_radius_m"])
    error = (dataset["state"] - dataset["state_reference"]).to_numpy()
    moving = np.abs(dataset["state_reference"].to_numpy()[:, 2]) > 1e-3
    lag = radius * error[:, 0]
    if np.abs(lag).max() > 0.1:
        worst = float(lag[np.argmax(np.abs(lag))])
        direction = "behind" if worst < 0.0 else "ahead of"
        remarks.append(f"wheel tracking is poor: the axle gets {abs(worst):.2f} m {direction} its reference")
    cost = dataset["cost"].to_numpy()[settled & moving]
    if len(cost) >= 8:
        quarter = len(cost) // 4
        early, late = float(np.median(cost[:quarter])), float(np.median(cost[-quarter:]))
        if late > 2.0 * early and late > 1.0:
            remarks.append(f"the controller's cost climbs along the slope, from {early:.2g} to {late:.2g}")
    if figures["fallbacks"]:
        remarks.append(f"{figures['fallbacks']} control steps were answered by the fallback")
    return tuple(remarks)
