"""The plots draw the data of the trajectory, label their axes and appear whole or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray
from matplotlib.figure import Figure
from matplotlib.image import imread

from m4_dynamics.errors import M4Error, ResultFileError
from m4_dynamics.view.plots import draw_ground_forces, draw_states, plot_ground_forces, plot_states

PLOTS = [(draw_states, plot_states), (draw_ground_forces, plot_ground_forces)]


def lines_of(figure: Figure, title: str) -> dict[str, np.ndarray]:
    """Label -> drawn ordinates of the panel with that title."""
    axes = next(axes for axes in figure.axes if axes.get_title(loc="left") == title)
    return {str(line.get_label()): np.asarray(line.get_ydata(), dtype=float) for line in axes.lines}


@pytest.mark.parametrize(("draw", "plot"), PLOTS)
def test_picture_is_written_and_not_blank(draw, plot, climb: xarray.Dataset, tmp_path: Path) -> None:
    path = plot(climb, tmp_path / "picture.png")
    assert [file.name for file in tmp_path.iterdir()] == ["picture.png"]
    image = imread(path)
    assert min(image.shape[:2]) > 900
    assert len(np.unique(image.reshape(-1, image.shape[2]), axis=0)) > 100
    assert 10e3 < path.stat().st_size < 1e6


@pytest.mark.parametrize(("draw", "plot"), PLOTS)
def test_every_panel_names_quantity_and_unit(draw, plot, climb: xarray.Dataset) -> None:
    figure = draw(climb)
    for axes in figure.axes:
        assert axes.get_title(loc="left")
        assert "[" in axes.get_ylabel(), axes.get_title(loc="left")
        assert axes.get_xlim() == (climb.time.values[0], climb.time.values[-1])
    assert any(axes.get_xlabel() == "time [s]" for axes in figure.axes)
    words = " ".join(text.get_text() for text in figure.texts)
    for fact in ("m4", "45", "0.8", "default", "climbed"):
        assert fact in words


def test_states_are_those_of_the_trajectory(climb: xarray.Dataset) -> None:
    figure = draw_states(climb)
    for title, column, scale in (
        ("Wheel angle", 0, 1.0),
        ("Body pitch", 1, 180.0 / np.pi),
        ("Wheel rate", 2, 1.0),
        ("Body pitch rate", 3, 180.0 / np.pi),
    ):
        lines = lines_of(figure, title)
        np.testing.assert_allclose(lines["actual"], scale * climb.state.values[:, column])
        np.testing.assert_allclose(lines["reference"], scale * climb.state_reference.values[:, column])
    np.testing.assert_allclose(lines_of(figure, "Motor duty")["mean"], climb.inputs.values[:, 0])
    np.testing.assert_allclose(lines_of(figure, "Motor duty")["rear left wheel"], climb.wheel_duty.values[:, 2])
    np.testing.assert_allclose(lines_of(figure, "Thrust")["total"], climb.inputs.values[:, 1])
    assert any(np.all(line == climb.attrs["thrust_limit_N"]) for line in lines_of(figure, "Thrust").values())


def test_ground_constraints_are_those_of_the_trajectory(climb: xarray.Dataset) -> None:
    figure = draw_ground_forces(climb)
    for label, variable in (
        ("simulated contact", "ground_force_simulated"),
        ("model of the controller", "ground_force_model"),
    ):
        along, normal = climb[variable].values.T
        np.testing.assert_allclose(lines_of(figure, "Friction reserve")[label], 0.8 * normal - np.abs(along))
        np.testing.assert_allclose(lines_of(figure, "Normal force, both wheels")[label], normal)
        np.testing.assert_allclose(lines_of(figure, "Friction use")[label], np.abs(along) / (0.8 * normal))
    np.testing.assert_allclose(
        lines_of(figure, "Slip speed of the contact points")["rear right wheel"], 1e3 * climb.slip_speed.values[:, 3]
    )
    np.testing.assert_allclose(lines_of(figure, "Cost")["MPC cost $J$"], climb.cost.values)


def test_sideways_forces_count_where_they_are_recorded(climb: xarray.Dataset) -> None:
    use = np.zeros((climb.sizes["time"], climb.sizes["wheel"]))
    use[:, 2], use[:, 3] = 0.7, 0.9
    use[50:60] = np.nan
    recorded = climb.assign(friction_use=(("time", "wheel"), use))
    drawn = lines_of(draw_ground_forces(recorded), "Friction use")["worst wheel, sideways included"]
    assert np.isnan(drawn[50:60]).all()
    np.testing.assert_array_equal(np.delete(drawn, np.s_[50:60]), 0.9)
    assert "worst wheel, sideways included" not in lines_of(draw_ground_forces(climb), "Friction use")


def test_lost_contact_leaves_a_gap_in_the_friction_use(climb: xarray.Dataset) -> None:
    airborne = climb.copy(deep=True)
    airborne["ground_force_simulated"][100:120] = 0.0
    use = lines_of(draw_ground_forces(airborne), "Friction use")["simulated contact"]
    assert np.isnan(use[100:120]).all()
    assert np.isfinite(use[:100]).all()


def test_a_controller_without_a_cost_is_drawn(climb: xarray.Dataset, tmp_path: Path) -> None:
    costless = climb.copy(deep=True)
    costless["cost"][:] = np.nan
    costless["tracking_cost"][:] = np.nan
    plot_ground_forces(costless, tmp_path / "ground_forces.png")
    axes = next(axes for axes in draw_ground_forces(costless).axes if axes.get_title(loc="left") == "Cost")
    assert "no cost" in axes.texts[0].get_text()


def test_missing_data_is_named(climb: xarray.Dataset, tmp_path: Path) -> None:
    with pytest.raises(ResultFileError, match="no variable inputs_reference"):
        plot_states(climb.drop_vars("inputs_reference"), tmp_path / "states.png")
    without_friction = climb.copy()
    without_friction.attrs = {}
    with pytest.raises(ResultFileError, match="friction_static"):
        plot_ground_forces(without_friction, tmp_path / "ground_forces.png")
    with pytest.raises(ResultFileError, match="two samples"):
        plot_states(climb.isel(time=[0]), tmp_path / "states.png")
    assert list(tmp_path.iterdir()) == []


def test_missing_folder_is_named(climb: xarray.Dataset, tmp_path: Path) -> None:
    with pytest.raises(M4Error, match="does not exist"):
        plot_states(climb, tmp_path / "nowhere" / "states.png")


def test_a_failed_write_leaves_the_old_picture(climb: xarray.Dataset, tmp_path: Path) -> None:
    path = plot_states(climb, tmp_path / "states.png")
    before = path.read_bytes()
    with pytest.raises(ResultFileError):
        plot_states(climb.drop_vars("heading"), path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["states.png"]
