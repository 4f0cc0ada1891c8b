"""Plots of a run over time: states and inputs (paper, Fig. plot_states B), ground forces and cost (Fig. plot_mpc)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from m4_dynamics.errors import ResultFileError
from m4_dynamics.view.friction import friction_use_in_plane, worst_wheel
from m4_dynamics.view.style import (
    COLOURS,
    draw_limit,
    dress_axes,
    label_lines,
    new_figure,
    run_subtitle,
    save_figure,
    series_colours,
    tight_limits,
    title_figure,
)

__all__ = ["draw_ground_forces", "draw_states", "plot_ground_forces", "plot_states"]

_ACTUAL = COLOURS["blue"]
_REFERENCE = COLOURS["vermilion"]
_TIME_LABEL = "time [s]"
_SLIDING_MM_S = 5.0  # a contact point faster than this slides visibly; slower ones creep


def plot_states(dataset: xarray.Dataset, path: Path | str, *, thrust_limit: float | None = None) -> Path:
    """Write the picture of states, references and inputs over time (paper, Fig. plot_states B).

    Args:
        dataset: A trajectory.
        path: The picture's file; the suffix chooses the format.
        thrust_limit: Greatest total thrust [N]; None takes the attribute `thrust_limit_N`, if there is one.

    Returns:
        The path.

    Raises:
        ResultFileError: A variable is missing, or the file cannot be written.
    """
    return save_figure(draw_states(dataset, thrust_limit=thrust_limit), path)


def plot_ground_forces(dataset: xarray.Dataset, path: Path | str) -> Path:
    """Write the picture of the ground constraints, model against simulation, and of the cost (paper, Fig. plot_mpc).

    Args:
        dataset: A trajectory.
        path: The picture's file; the suffix chooses the format.

    Returns:
        The path.

    Raises:
        ResultFileError: A variable is missing, or the file cannot be written.
    """
    return save_figure(draw_ground_forces(dataset), path)


def draw_states(dataset: xarray.Dataset, *, thrust_limit: float | None = None) -> Figure:
    """Draw states, references and inputs over time.

    Args:
        dataset: A trajectory.
        thrust_limit: Greatest total thrust [N]; None takes the attribute `thrust_limit_N`, if there is one.

    Returns:
        The figure: four rows (wheel, pitch, inputs, heading and errors) by two columns.

    Raises:
        ResultFileError: A variable is missing.
    """
    _require(dataset, "state", "state_reference", "inputs", "inputs_reference", "heading", "wheel_duty")
    time = _values(dataset, "time")
    state, reference = _values(dataset, "state"), _values(dataset, "state_reference")
    inputs, inputs_reference = _values(dataset, "inputs"), _values(dataset, "inputs_reference")
    if thrust_limit is None and "thrust_limit_N" in dataset.attrs:
        thrust_limit = float(dataset.attrs["thrust_limit_N"])

    degrees = 180.0 / np.pi
    figure = new_figure(width=12.0, height=9.0)
    panels = figure.subplots(4, 2, sharex=True)
    for axes, column, scale, title, ylabel, least_span in (
        (panels[0, 0], 0, 1.0, "Wheel angle", r"$\varphi$ [rad]", 0.2),
        (panels[0, 1], 2, 1.0, "Wheel rate", r"$\dot\varphi$ [rad/s]", 0.2),
        (panels[1, 0], 1, degrees, "Body pitch", r"$\theta$ [deg]", 2.0),
        (panels[1, 1], 3, degrees, "Body pitch rate", r"$\dot\theta$ [deg/s]", 2.0),
    ):
        axes.plot(time, scale * state[:, column], color=_ACTUAL, linewidth=1.8, label="actual")
        axes.plot(
            time, scale * reference[:, column], color=_REFERENCE, linewidth=1.3, linestyle="--", label="reference"
        )
        dress_axes(axes, title=title, ylabel=ylabel)
        tight_limits(axes, scale * state[:, column], scale * reference[:, column], least_span=least_span)
    label_lines(panels[0, 0])
    _draw_duty(panels[2, 0], dataset, time, inputs[:, 0], inputs_reference[:, 0])
    _draw_thrust(panels[2, 1], time, inputs[:, 1], inputs_reference[:, 1], thrust_limit)

    heading = np.rad2deg(_values(dataset, "heading"))
    panels[3, 0].axhline(0.0, color=_REFERENCE, linestyle="--", linewidth=1.2)
    panels[3, 0].plot(time, heading, color=_ACTUAL, linewidth=1.6)
    dress_axes(panels[3, 0], title="Heading", ylabel="yaw [deg]", xlabel=_TIME_LABEL)
    tight_limits(panels[3, 0], heading, include=(0.0,), least_span=0.2)

    error = np.rad2deg(reference - state)
    panels[3, 1].axhline(0.0, color=COLOURS["slate"], linewidth=0.8)
    panels[3, 1].plot(time, error[:, 0], color=COLOURS["green"], linewidth=1.6, label="wheel angle")
    panels[3, 1].plot(time, error[:, 1], color=COLOURS["purple"], linewidth=1.6, label="pitch")
    dress_axes(panels[3, 1], title="Tracking error", ylabel="reference − actual [deg]", xlabel=_TIME_LABEL)
    tight_limits(panels[3, 1], error[:, :2], include=(0.0,), least_span=1.0)
    label_lines(panels[3, 1])

    _finish(figure, panels.ravel(), time, dataset, "States, references and inputs")
    return figure


def draw_ground_forces(dataset: xarray.Dataset) -> Figure:
    """Draw the ground constraints of the model beside the simulated contact forces, the slip and the cost.

    Args:
        dataset: A trajectory.

    Returns:
        The figure: friction reserve, normal force, friction use, slip speed and cost over time.

    Raises:
        ResultFileError: A variable or the attribute `friction_static` is missing.
    """
    _require(dataset, "ground_force_model", "ground_force_simulated", "slip_speed", "cost", "tracking_cost")
    if "friction_static" not in dataset.attrs:
        raise ResultFileError("the trajectory has no attribute 'friction_static', so its friction reserve is unknown")
    friction = float(dataset.attrs["friction_static"])
    time = _values(dataset, "time")
    sources = {"simulated": _values(dataset, "ground_force_simulated"), "model": _values(dataset, "ground_force_model")}
    reserve = {name: friction * force[:, 1] - np.abs(force[:, 0]) for name, force in sources.items()}
    normal = {name: force[:, 1] for name, force in sources.items()}
    use = {name: friction_use_in_plane(force, friction) for name, force in sources.items()}

    figure = new_figure(width=10.0, height=10.5)
    panels = figure.subplots(5, 1, sharex=True)
    _draw_sources(panels[0], time, reserve, "Friction reserve", r"$\mu_s f_n - |f_x|$ [N]", 0.0, "slips below", "below")
    _draw_sources(panels[1], time, normal, "Normal force, both wheels", r"$f_n$ [N]", 0.0, "lifts off below", "below")
    _draw_sources(panels[2], time, use, "Friction use", r"$|f_x|\,/\,\mu_s f_n$ [-]", 1.0, "slips above", "above")
    if "friction_use" in dataset:
        # The reduced model knows nothing of sideways forces, which use up friction too.
        worst = worst_wheel(_values(dataset, "friction_use"))
        panels[2].plot(time, worst, color=COLOURS["purple"], linewidth=1.1, label="worst wheel, sideways included")
        label_lines(panels[2], leave_out=("simulated contact", "model of the controller"))
    # The model's forces mean nothing once the robot lies on the ground; they would flatten the rest.
    panels[2].set_ylim(top=min(panels[2].get_ylim()[1], 1.6))
    label_lines(panels[0])
    _draw_slip(panels[3], dataset, time)
    _draw_cost(panels[4], dataset, time)
    _finish(figure, panels, time, dataset, "Ground forces, slip and cost")
    return figure


def _require(dataset: xarray.Dataset, *names: str) -> None:
    """Raise if the trajectory lacks a variable."""
    missing = [name for name in ("time", *names) if name not in dataset.variables]
    if missing:
        present = ", ".join(sorted(str(name) for name in dataset.variables))
        raise ResultFileError(f"the trajectory has no variable {', '.join(missing)}; it has {present or 'none'}")
    if dataset.sizes["time"] < 2:
        raise ResultFileError(f"a plot needs two samples or more, but the trajectory has {dataset.sizes['time']}")


def _values(dataset: xarray.Dataset, name: str) -> NDArray[np.float64]:
    return np.asarray(dataset[name].values, dtype=float)


def _wheel_label(dataset: xarray.Dataset, index: int) -> str:
    return str(dataset["wheel"].values[index]).replace("_", " ") if "wheel" in dataset.coords else f"wheel {index + 1}"


def _draw_duty(
    axes: Axes,
    dataset: xarray.Dataset,
    time: NDArray[np.float64],
    duty: NDArray[np.float64],
    reference: NDArray[np.float64],
) -> None:
    """Duty of both motors together, the drive wheels' own duties behind it."""
    wheel_duty = _values(dataset, "wheel_duty")
    driven = [index for index in range(wheel_duty.shape[1]) if np.nanmax(np.abs(wheel_duty[:, index]), initial=0.0) > 0]
    for order, index in enumerate(driven):
        colour = (COLOURS["sky"], COLOURS["orange"], COLOURS["green"], COLOURS["purple"])[order % 4]
        label = _wheel_label(dataset, index)
        axes.plot(time, wheel_duty[:, index], color=colour, linewidth=1.0, alpha=0.8, label=label)
    axes.plot(time, duty, color=_ACTUAL, linewidth=1.8, label="mean")
    axes.plot(time, reference, color=_REFERENCE, linewidth=1.3, linestyle="--", label="reference")
    dress_axes(axes, title="Motor duty", ylabel=r"$u_m$ [-]")
    axes.set_ylim(-1.18, 1.18)
    draw_limit(axes, 1.0, "limit")
    draw_limit(axes, -1.0, "limit")
    label_lines(axes, leave_out=("mean", "reference"))


def _draw_thrust(
    axes: Axes,
    time: NDArray[np.float64],
    thrust: NDArray[np.float64],
    reference: NDArray[np.float64],
    limit: float | None,
) -> None:
    axes.plot(time, thrust, color=_ACTUAL, linewidth=1.8, label="total")
    axes.plot(time, reference, color=_REFERENCE, linewidth=1.3, linestyle="--", label="reference")
    dress_axes(axes, title="Thrust", ylabel=r"$f_t$ [N]")
    tight_limits(axes, thrust, reference, include=(0.0,) if limit is None else (0.0, limit), least_span=1.0)
    if limit is not None:
        draw_limit(axes, limit, f"limit {limit:.3g} N")
    draw_limit(axes, 0.0, "")


def _draw_sources(
    axes: Axes,
    time: NDArray[np.float64],
    sources: dict[str, NDArray[np.float64]],
    title: str,
    ylabel: str,
    limit: float,
    limit_text: str,
    forbidden: str,
) -> None:
    """One ground constraint, simulated and model, with its limit."""
    axes.plot(time, sources["simulated"], color=_ACTUAL, linewidth=1.8, label="simulated contact")
    axes.plot(time, sources["model"], color=_REFERENCE, linewidth=1.2, linestyle="--", label="model of the controller")
    dress_axes(axes, title=title, ylabel=ylabel)
    tight_limits(axes, *sources.values(), include=(limit, 0.0))
    draw_limit(axes, limit, limit_text, forbidden=forbidden)


def _draw_slip(axes: Axes, dataset: xarray.Dataset, time: NDArray[np.float64]) -> None:
    """Speed of each wheel's contact point on a logarithmic scale: sticking contacts creep, sliding ones run."""
    slip = 1e3 * _values(dataset, "slip_speed")
    floor = 1e-3  # [mm/s]; below it a contact stands still for any purpose
    touching = [index for index in range(slip.shape[1]) if np.nanmax(slip[:, index], initial=0.0) > 0.0]
    for order, (colour, index) in enumerate(zip(series_colours(len(touching)), touching, strict=True)):
        dash = "-" if order % 2 == 0 else (0, (4, 1.5))
        label = _wheel_label(dataset, index)
        axes.plot(time, np.maximum(slip[:, index], floor), color=colour, linewidth=1.4, linestyle=dash, label=label)
    dress_axes(axes, title="Slip speed of the contact points", ylabel="[mm/s]")
    axes.set_yscale("log")
    axes.set_ylim(floor, max(30.0, 2.0 * float(np.nanmax(slip, initial=0.0))))
    draw_limit(axes, _SLIDING_MM_S, f"sliding above {_SLIDING_MM_S:g} mm/s")
    if touching:
        label_lines(axes)


def _draw_cost(axes: Axes, dataset: xarray.Dataset, time: NDArray[np.float64]) -> None:
    """Cost of the predictive controller and of the tracking alone, on a logarithmic scale."""
    cost, tracking = _values(dataset, "cost"), _values(dataset, "tracking_cost")
    drawn = []
    for values, label, colour, dash in (
        (cost, r"MPC cost $J$", _ACTUAL, "-"),
        (tracking, r"tracking $e^\top Q\,e$", COLOURS["green"], "-."),
    ):
        positive = np.where(values > 0.0, values, np.nan)
        if np.isfinite(positive).any():
            axes.plot(time, positive, color=colour, linewidth=1.5, linestyle=dash, label=label)
            drawn.append(positive)
    dress_axes(axes, title="Cost", ylabel=r"$J$ [-]", xlabel=_TIME_LABEL)
    if drawn:
        axes.set_yscale("log")
        label_lines(axes)
    else:
        axes.text(0.5, 0.5, "this controller reports no cost", transform=axes.transAxes, ha="center", va="center")


def _finish(
    figure: Figure, panels: NDArray[np.object_], time: NDArray[np.float64], dataset: xarray.Dataset, title: str
) -> None:
    """Common time axis, aligned labels and headline."""
    for axes in panels:
        axes.set_xlim(time[0], time[-1])
    figure.align_ylabels()
    robot = str(dataset.attrs.get("robot", "")).strip()
    title_figure(figure, f"{robot}: {title[0].lower()}{title[1:]}" if robot else title, run_subtitle(dataset))
