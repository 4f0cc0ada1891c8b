"""Plots of missions: phases in sight, gaps where nothing is followed, forces only while the robot balances."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.patches import Rectangle

from m4_dynamics.errors import ResultFileError
from m4_dynamics.view.constraint_plot import constraint_figures, draw_constraints, plot_constraints
from m4_dynamics.view.phases import balancing_samples, phases_of, predictive_samples
from m4_dynamics.view.plots import draw_ground_forces, draw_states, plot_ground_forces, plot_states
from m4_dynamics.view.run_figure import REFERENCE
from m4_dynamics.view.style import new_figure, peak_limits


def panel(figure: Figure, title: str) -> Axes:
    return next(axes for axes in figure.axes if axes.get_title(loc="left") == title)


def lines_of(axes: Axes) -> dict[str, np.ndarray]:
    return {str(line.get_label()): np.asarray(line.get_ydata(), dtype=float) for line in axes.lines}


def bands(axes: Axes) -> list[tuple[float, float]]:
    """Where the panel's full-height tinted bands begin and end; shaded halves reach only from side to side."""
    boxes = [patch for patch in axes.patches if isinstance(patch, Rectangle) and patch.get_alpha() == 0.085]
    return [(box.get_x(), box.get_x() + box.get_width()) for box in boxes]


@pytest.fixture(scope="module")
def states(mission_run: xarray.Dataset) -> Figure:
    return draw_states(mission_run)


@pytest.fixture(scope="module")
def forces(mission_run: xarray.Dataset) -> Figure:
    return draw_ground_forces(mission_run)


@pytest.mark.parametrize("plot", [plot_states, plot_ground_forces, plot_constraints])
def test_picture_is_written_and_not_blank(plot, mission_run: xarray.Dataset, tmp_path: Path) -> None:
    path = plot(mission_run, tmp_path / "picture.png")
    assert [file.name for file in tmp_path.iterdir()] == ["picture.png"]
    image = imread(path)
    assert len(np.unique(image.reshape(-1, image.shape[2]), axis=0)) > 100


def test_states_have_gaps_where_nothing_is_followed(states: Figure, mission_run: xarray.Dataset) -> None:
    drawn = lines_of(panel(states, "Body pitch"))
    followed = np.isfinite(mission_run.state_reference.values[:, 1])
    assert 0.5 < followed.mean() < 0.98
    np.testing.assert_array_equal(np.isfinite(drawn["reference"]), followed)
    np.testing.assert_allclose(drawn["actual"], np.rad2deg(mission_run.state.values[:, 1]))
    error = lines_of(panel(states, "Tracking error while it balances"))["pitch"]
    np.testing.assert_array_equal(np.isfinite(error), balancing_samples(mission_run))


def test_every_phase_is_named_and_tinted(states: Figure, mission_run: xarray.Dataset) -> None:
    phases = phases_of(mission_run)
    words = [text.get_text() for axes in states.axes for text in axes.texts]
    for phase in phases:
        assert words.count(phase.label) == 2  # once above each column
    for title in ("Wheel angle", "Thrust", "Heading"):
        np.testing.assert_allclose(bands(panel(states, title)), [(phase.start, phase.end) for phase in phases])


def test_wheel_angle_has_a_scale_in_metres(states: Figure, mission_run: xarray.Dataset) -> None:
    axes = panel(states, "Wheel angle")
    (metres,) = axes.child_axes
    states.canvas.draw()
    np.testing.assert_allclose(metres.get_ylim(), np.multiply(axes.get_ylim(), 0.125))
    assert metres.get_ylabel() == "travel [m]"
    # The angle is the travel over the radius, so the second scale is the travel's.
    np.testing.assert_allclose(lines_of(axes)["actual"], mission_run.travel.values / 0.125)


def test_a_mission_has_no_made_up_heading_reference(states: Figure, climb: xarray.Dataset) -> None:
    def references(figure: Figure) -> int:
        return sum(line.get_color() == REFERENCE for line in panel(figure, "Heading").lines)

    assert references(states) == 0
    assert references(draw_states(climb)) == 1


def test_forces_are_drawn_only_while_it_balances(forces: Figure, mission_run: xarray.Dataset) -> None:
    balancing = balancing_samples(mission_run)
    for label, variable in (
        ("simulated contact", "ground_force_simulated"),
        ("model of the controller", "ground_force_model"),
    ):
        along, normal = mission_run[variable].values.T
        drawn = lines_of(panel(forces, "Friction reserve"))[label]
        np.testing.assert_array_equal(np.isfinite(drawn), balancing)
        np.testing.assert_allclose(drawn[balancing], (0.8 * normal - np.abs(along))[balancing])
    time = mission_run.time.values[balancing]
    for title in ("Friction reserve", "Slip speed of the contact points", "Cost"):
        axes = panel(forces, title)
        assert axes.get_xlim() == (time[0], time[-1])
        assert len(bands(axes)) == 3


def test_only_drive_wheels_slip_while_it_balances(forces: Figure, mission_run: xarray.Dataset) -> None:
    drawn = lines_of(panel(forces, "Slip speed of the contact points"))
    assert {label for label in drawn if "wheel" in label} == {"rear left wheel", "rear right wheel"}
    balancing = balancing_samples(mission_run)
    slip = 1e3 * mission_run.slip_speed.sel(wheel="rear_left_wheel").values
    np.testing.assert_allclose(drawn["rear left wheel"][balancing], np.maximum(slip, 1e-3)[balancing])


def test_a_mission_that_never_balanced_says_so(mission_run: xarray.Dataset) -> None:
    lying = mission_run.isel(time=mission_run.phase.values < 2)
    figure = draw_ground_forces(lying)
    assert any("never balanced" in text.get_text() for axes in figure.axes for text in axes.texts)
    draw_states(lying)
    with pytest.raises(ResultFileError, match="no predictive controller"):
        draw_constraints(lying)


def test_a_short_peak_leaves_the_panel_with_its_value() -> None:
    time = np.linspace(0.0, 10.0, 2001)
    values = 50.0 + np.sin(time)
    values[1000] = 400.0
    axes = new_figure(width=4.0, height=3.0).subplots()
    peak_limits(axes, time, values, include=(0.0,))
    assert axes.get_ylim()[1] < 100.0
    (word,) = axes.texts
    assert word.get_text() == "400"
    assert word.xy[0] == pytest.approx(5.0)
    # A deviation that lasts is no peak: it stays in sight.
    values[1000:1100] = 400.0
    axes = new_figure(width=4.0, height=3.0).subplots()
    peak_limits(axes, time, values, include=(0.0,))
    assert axes.get_ylim()[1] > 400.0
    assert not axes.texts


def test_constraints_are_the_papers(mission_run: xarray.Dataset) -> None:
    figure = draw_constraints(mission_run)
    shown = predictive_samples(mission_run)
    for label, variable in (("simulated forces", "ground_force_simulated"), ("reduced model", "ground_force_model")):
        along, normal = mission_run[variable].values.T
        for title, expected in (("Normal force", -normal), ("Friction cone", along**2 - (0.8 * normal) ** 2)):
            drawn = lines_of(panel(figure, title))[label]
            np.testing.assert_array_equal(np.isfinite(drawn), shown)
            np.testing.assert_allclose(drawn[shown], expected[shown])
    cost = panel(figure, "Cost").lines[0]
    np.testing.assert_allclose(np.asarray(cost.get_ydata())[shown], mission_run.cost.values[shown])


def test_model_and_simulation_agree_and_nothing_slips(mission_run: xarray.Dataset) -> None:
    figures = constraint_figures(mission_run)
    weight = mission_run.attrs["weight_N"]
    assert figures.friction_rms < 0.03 * weight
    assert figures.normal_rms < 0.03 * weight
    assert figures.worst_friction < 0.0
    assert figures.worst_normal < 0.0
    assert figures.cost_last < figures.cost_first


def test_a_climb_without_phases_has_constraints_too(climb: xarray.Dataset) -> None:
    drawn = lines_of(panel(draw_constraints(climb), "Normal force"))
    np.testing.assert_allclose(drawn["simulated forces"], -climb.ground_force_simulated.values[:, 1])
    with pytest.raises(ResultFileError, match="friction_static"):
        draw_constraints(climb.drop_attrs())
