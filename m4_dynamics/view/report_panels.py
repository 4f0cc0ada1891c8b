"""What a report plots over time: panels of curves with their limits, from a trajectory, as plain values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray
from numpy.typing import ArrayLike, NDArray

from m4_dynamics.view.friction import friction_use_in_plane, worst_wheel
from m4_dynamics.view.phases import balancing_samples

__all__ = ["Curve", "Panel", "report_panels"]


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One line of a panel.

    Attributes:
        label: Its name.
        values: Shape (n,), NaN where there is nothing.
        dashed: Whether it is a reference or a model rather than what happened.
    """

    label: str
    values: NDArray[np.float64]
    dashed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """Curves that share an axis.

    Attributes:
        title: What is shown.
        unit: Unit of the values.
        curves: The lines, two or three.
        limits: (value, name) of horizontal lines.
        logarithmic: Whether the values span decades.
        about: One sentence for those who cannot see the curves, and for those who wonder.
    """

    title: str
    unit: str
    curves: tuple[Curve, ...]
    about: str
    limits: tuple[tuple[float, str], ...] = ()
    logarithmic: bool = False


def report_panels(dataset: xarray.Dataset) -> list[Panel]:
    """Everything that a trajectory has to plot, in the order in which it is read.

    Args:
        dataset: A trajectory.

    Returns:
        The panels; what the trajectory lacks is left out.
    """
    return [*_states(dataset), *_inputs(dataset), *_ground(dataset), *_controller(dataset)]


def _states(dataset: xarray.Dataset) -> list[Panel]:
    state, reference = _array(dataset["state"]), _array(dataset["state_reference"])
    radius = float(dataset.attrs.get("wheel_radius_m", np.nan))
    length, unit = (radius, "m") if np.isfinite(radius) else (1.0, "rad")
    panels = [
        Panel(
            "Way of the axle",
            unit,
            (Curve("robot", length * state[:, 0]), Curve("reference", length * reference[:, 0], dashed=True)),
            "Distance that the wheels have rolled along the ground, beside its reference.",
        ),
        Panel(
            "Pitch",
            "°",
            (Curve("robot", np.degrees(state[:, 1])), Curve("reference", np.degrees(reference[:, 1]), dashed=True)),
            "Lean of the body, positive forward, zero upright in the world.",
        ),
        Panel(
            "Speed",
            f"{unit}/s",
            (Curve("robot", length * state[:, 2]), Curve("reference", length * reference[:, 2], dashed=True)),
            "Speed of the axle along the ground.",
        ),
    ]
    if "heading" in dataset:
        curves = [Curve("robot", np.degrees(_array(dataset["heading"])))]
        if "heading_estimated" in dataset:
            curves.append(Curve("as estimated", np.degrees(_array(dataset["heading_estimated"])), dashed=True))
        panels.append(Panel("Heading", "°", tuple(curves), "Heading about the slope's normal, positive to the left."))
    return panels


def _inputs(dataset: xarray.Dataset) -> list[Panel]:
    inputs = _array(dataset["inputs"])
    reference = _array(dataset["inputs_reference"])
    thrust_limit = dataset.attrs.get("thrust_limit_N")
    given = _array(dataset["thrust"]).sum(axis=1)
    return [
        Panel(
            "Motor duty",
            "",
            (Curve("commanded", inputs[:, 0]), Curve("reference", reference[:, 0], dashed=True)),
            "Duty of the two drive motors together; the heading hold adds its difference.",
            limits=((1.0, "limit"), (-1.0, "limit")),
        ),
        Panel(
            "Thrust",
            "N",
            (Curve("given", given), Curve("commanded", inputs[:, 1], dashed=True)),
            "Thrust of all rotors together.",
            limits=((float(thrust_limit), "limit"),) if thrust_limit is not None else (),
        ),
    ]


def _ground(dataset: xarray.Dataset) -> list[Panel]:
    model, simulated = _array(dataset["ground_force_model"]), _array(dataset["ground_force_simulated"])
    balancing = balancing_samples(dataset)
    panels = [
        Panel(
            title,
            "N",
            (
                Curve("full model", simulated[:, column]),
                Curve("reduced model", np.where(balancing, model[:, column], np.nan), dashed=True),
            ),
            about,
        )
        for column, title, about in (
            (0, "Friction force", "Force of the ground along the slope: simulated, and as the reduced model predicts."),
            (1, "Normal force", "Force of the ground out of it: simulated, and as the reduced model predicts."),
        )
    ]
    if "friction_static" in dataset.attrs:
        along = friction_use_in_plane(simulated, float(dataset.attrs["friction_static"]))
        curves = [Curve("along the slope", np.where(balancing, 100.0 * along, np.nan))]
        if "friction_use" in dataset:
            worst = worst_wheel(_array(dataset["friction_use"]))
            curves.append(Curve("sideways included", np.where(balancing, 100.0 * worst, np.nan), dashed=True))
        about = "Share of the available friction in use while the robot balances; at 100 % a wheel begins to slide."
        panels.append(Panel("Friction use", "%", tuple(curves), about, limits=((100.0, "grip ends"),)))
    if "slip_speed" in dataset:
        slip = 1e3 * _array(dataset["slip_speed"]).max(axis=1)
        panels.append(
            Panel(
                "Slip",
                "mm/s",
                (Curve("fastest wheel", slip),),
                "Largest sliding speed of any wheel's contact point.",
                limits=((5.0, "slips"),),
            )
        )
    return panels


def _controller(dataset: xarray.Dataset) -> list[Panel]:
    panels = []
    curves = []
    if "cost" in dataset:
        curves.append(Curve("cost of the plan", _positive(_array(dataset["cost"]))))
    if "tracking_cost" in dataset:
        curves.append(Curve("tracking cost", _positive(_array(dataset["tracking_cost"])), dashed=True))
    if curves:
        about = "Cost that the controller plans with, and the tracking error weighed as the paper does; logarithmic."
        panels.append(Panel("Cost", "", tuple(curves), about, logarithmic=True))
    if "control_time" in dataset:
        times = _positive(1e6 * _array(dataset["control_time"]))
        period = 1e6 * float(np.median(np.diff(_array(dataset["time"])))) if dataset.sizes["time"] > 1 else np.nan
        about = "Wall-clock time that each control step took, beside the time that there is; logarithmic."
        limits = ((period, "control period"),) if np.isfinite(period) else ()
        panels.append(Panel("Solver time", "µs", (Curve("control step", times),), about, limits, logarithmic=True))
    if "battery_voltage" in dataset:
        voltage = _array(dataset["battery_voltage"])
        panels.append(Panel("Battery", "V", (Curve("voltage", voltage),), "Voltage of the battery under load."))
    return [panel for panel in panels if any(np.isfinite(curve.values).any() for curve in panel.curves)]


def _array(values: ArrayLike) -> NDArray[np.float64]:
    return np.asarray(values, dtype=float)


def _positive(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """What a logarithmic axis can show."""
    return np.where(values > 0.0, values, np.nan)
