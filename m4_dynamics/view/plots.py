"""Plots of a run over time: states and inputs (paper, Fig. plot_states B), ground forces and cost (Fig. plot_mpc)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from m4_dynamics.view.force_plots import draw_ground_forces
from m4_dynamics.view.phase_bands import draw_corners
from m4_dynamics.view.phases import balancing_samples, corner_times
from m4_dynamics.view.run_figure import (
    ACTUAL,
    REFERENCE,
    TIME_LABEL,
    require_variables,
    run_figure,
    values_of,
    wheel_label,
)
from m4_dynamics.view.style import COLOURS, INK, draw_limit, dress_axes, label_lines, save_figure, tight_limits

__all__ = ["draw_ground_forces", "draw_states", "plot_ground_forces", "plot_states"]

_WANTED: dict[str, Any] = {"color": REFERENCE, "linestyle": "--", "linewidth": 1.2}


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
    require_variables(dataset, "state", "state_reference", "inputs", "inputs_reference", "heading", "wheel_duty")
    time = values_of(dataset, "time")
    state, reference = values_of(dataset, "state"), values_of(dataset, "state_reference")
    inputs, inputs_reference = values_of(dataset, "inputs"), values_of(dataset, "inputs_reference")
    if thrust_limit is None and "thrust_limit_N" in dataset.attrs:
        thrust_limit = float(dataset.attrs["thrust_limit_N"])

    degrees = 180.0 / np.pi
    making = run_figure(dataset, rows=4, columns=2, size=(12.0, 9.0))
    panels = making.panels
    for axes, column, scale, title, ylabel, least_span in (
        (panels[0, 0], 0, 1.0, "Wheel angle", r"$\varphi$ [rad]", 0.2),
        (panels[0, 1], 2, 1.0, "Wheel rate", r"$\dot\varphi$ [rad/s]", 0.2),
        (panels[1, 0], 1, degrees, "Body pitch", r"$\theta$ [deg]", 2.0),
        (panels[1, 1], 3, degrees, "Body pitch rate", r"$\dot\theta$ [deg/s]", 2.0),
    ):
        axes.plot(time, scale * state[:, column], color=ACTUAL, linewidth=1.8, label="actual")
        axes.plot(time, scale * reference[:, column], color=REFERENCE, linewidth=1.3, linestyle="--", label="reference")
        dress_axes(axes, title=title, ylabel=ylabel)
        tight_limits(axes, scale * state[:, column], scale * reference[:, column], least_span=least_span)
    label_lines(panels[0, 0])
    _add_metres(panels[0, 0], dataset)
    _draw_duty(panels[2, 0], dataset, time, inputs[:, 0], inputs_reference[:, 0])
    _draw_thrust(panels[2, 1], time, inputs[:, 1], inputs_reference[:, 1], thrust_limit)

    heading = np.rad2deg(values_of(dataset, "heading"))
    # A climb keeps its heading at zero; what a mission wants may turn.
    panels[3, 0].axhline(0.0, **({"color": COLOURS["slate"], "linewidth": 0.8} if making.phases else _WANTED))
    panels[3, 0].plot(time, heading, color=ACTUAL, linewidth=1.6)
    dress_axes(panels[3, 0], title="Heading", ylabel="yaw [deg]", xlabel=TIME_LABEL)
    tight_limits(panels[3, 0], heading, include=(0.0,), least_span=0.2)

    error = np.where(balancing_samples(dataset)[:, None], np.rad2deg(reference - state), np.nan)
    panels[3, 1].axhline(0.0, color=COLOURS["slate"], linewidth=0.8)
    panels[3, 1].plot(time, error[:, 0], color=COLOURS["green"], linewidth=1.6, label="wheel angle")
    panels[3, 1].plot(time, error[:, 1], color=COLOURS["purple"], linewidth=1.6, label="pitch")
    title = "Tracking error while it balances" if making.phases else "Tracking error"
    dress_axes(panels[3, 1], title=title, ylabel="reference − actual [deg]", xlabel=TIME_LABEL)
    tight_limits(panels[3, 1], error[:, :2], include=(0.0,), least_span=1.0)
    label_lines(panels[3, 1])

    for axes in panels.ravel():
        draw_corners(axes, making.in_sight(corner_times(dataset)), text="corner" if axes is panels[0, 0] else "")
    return making.finish(dataset, "States, references and inputs")


def _add_metres(axes: Axes, dataset: xarray.Dataset) -> None:
    """Add a second scale to the wheel angle: the travel of the axle, the angle times the wheel's radius."""
    if "wheel_radius_m" not in dataset.attrs:
        return
    radius = float(dataset.attrs["wheel_radius_m"])

    def to_metres(angle: Any) -> Any:
        return radius * angle

    def to_angle(way: Any) -> Any:
        return way / radius

    metres = axes.secondary_yaxis("right", functions=(to_metres, to_angle))
    metres.set_ylabel("travel [m]", size=9, color=INK)
    metres.tick_params(labelsize=8.5, colors=INK, length=3, width=0.7)
    metres.spines["right"].set_color(COLOURS["mist"])


def _draw_duty(
    axes: Axes,
    dataset: xarray.Dataset,
    time: NDArray[np.float64],
    duty: NDArray[np.float64],
    reference: NDArray[np.float64],
) -> None:
    """Duty of both motors together, the drive wheels' own duties behind it."""
    wheel_duty = values_of(dataset, "wheel_duty")
    driven = [index for index in range(wheel_duty.shape[1]) if np.nanmax(np.abs(wheel_duty[:, index]), initial=0.0) > 0]
    for order, index in enumerate(driven):
        colour = (COLOURS["sky"], COLOURS["orange"], COLOURS["green"], COLOURS["purple"])[order % 4]
        label = wheel_label(dataset, index)
        axes.plot(time, wheel_duty[:, index], color=colour, linewidth=1.0, alpha=0.8, label=label)
    axes.plot(time, duty, color=ACTUAL, linewidth=1.8, label="mean")
    axes.plot(time, reference, color=REFERENCE, linewidth=1.3, linestyle="--", label="reference")
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
    axes.plot(time, thrust, color=ACTUAL, linewidth=1.8, label="total")
    axes.plot(time, reference, color=REFERENCE, linewidth=1.3, linestyle="--", label="reference")
    dress_axes(axes, title="Thrust", ylabel=r"$f_t$ [N]")
    tight_limits(axes, thrust, reference, include=(0.0,) if limit is None else (0.0, limit), least_span=1.0)
    if limit is not None:
        draw_limit(axes, limit, f"limit {limit:.3g} N")
    draw_limit(axes, 0.0, "")
