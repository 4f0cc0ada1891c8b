"""What is drawn over robot and ground: cones, trail, reduced model, ghost, discs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
import xarray
from hypothesis import given
from hypothesis import strategies as st

from m4_dynamics.reduced.pendulum import com_position, rotation, thrust_position, wheel_position
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.arrows import HIDDEN_SCALE
from m4_dynamics.view.cones import cone_motion, ground_normals
from m4_dynamics.view.frames import Frames, sample_frames
from m4_dynamics.view.motion import Motion, motion_matrix
from m4_dynamics.view.overlays import Overlays, legend_entries, overlay_commands, overlays_of
from m4_dynamics.view.scene import scene_motions
from m4_dynamics.view.trail import piece_matrix, trail_corners, trail_motions

SCALE = 0.02
ALONG = np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0)
NORMAL = np.array([-1.0, 0.0, 1.0]) / np.sqrt(2.0)


@pytest.fixture(scope="module")
def frames(climb: xarray.Dataset, robot: Robot) -> Frames:
    return sample_frames(climb, robot, frames_per_second=20.0)


@pytest.fixture(scope="module")
def overlays(climb: xarray.Dataset, robot: Robot, frames: Frames) -> Overlays:
    return overlays_of(climb, robot, frames)


@pytest.fixture(scope="module")
def motions(robot: Robot, frames: Frames, overlays: Overlays) -> dict[str, Motion]:
    found = scene_motions(robot, frames, overlays, metres_per_newton=SCALE)
    paths = [motion.path for motion in found]
    assert len(set(paths)) == len(paths)
    return {motion.path: motion for motion in found}


def nodes_of(robot: Robot, frames: Frames, overlays: Overlays) -> list[str]:
    return [one["path"] for one in overlay_commands(robot, frames, overlays) if one["type"] == "set_object"]


# ---- cones -----------------------------------------------------------------------------------------------------------


@given(st.floats(0.0, 2.0), st.floats(0.0, 2.0 * np.pi), st.floats(1.0, 60.0))
def test_a_force_ends_within_the_rim_if_and_only_if_friction_suffices(
    use: float, angle: float, pressing: float
) -> None:
    friction = 0.8
    sideways = np.cos(angle) * ALONG + np.sin(angle) * np.array([0.0, 1.0, 0.0])
    force = pressing * (NORMAL + use * friction * sideways)
    place = np.array([0.3, 0.1, 0.4])
    motion = cone_motion("/cone", place[None], force[None], NORMAL[None], metres_per_newton=SCALE)
    tip = np.linalg.inv(motion_matrix(motion, 0)) @ [*(place + SCALE * force), 1.0]
    assert tip[2] == pytest.approx(1.0)  # in the plane of the rim of the cone of unit height
    assert np.hypot(tip[0], tip[1]) == pytest.approx(use * friction, abs=1e-9)


def test_cones_hide_without_contact(motions: dict[str, Motion], robot: Robot) -> None:
    for wheel in robot.wheels:
        size = motions[f"/cone/{wheel.joint}"].scale
        assert size is not None
        if wheel.joint in robot.balance.drive_wheels:
            assert size.min() > 0.05
        else:
            np.testing.assert_array_equal(size, HIDDEN_SCALE)


def test_cones_stand_on_the_ground_where_the_wheel_touches(
    motions: dict[str, Motion], frames: Frames, robot: Robot
) -> None:
    for joint in robot.balance.drive_wheels:
        motion = motions[f"/cone/{joint}"]
        matrix = motion_matrix(motion, 30)
        np.testing.assert_allclose(matrix[:3, 3], frames.contact_position[joint][30])
        height = SCALE * frames.contact_force[joint][30] @ NORMAL
        np.testing.assert_allclose(matrix[:3, 2], height * NORMAL, atol=1e-9)


def test_normals_follow_the_ground_and_turn_over_a_crest() -> None:
    profile = np.array([[-2.0, 0.0], [0.0, 0.0], [1.0, 1.0], [3.0, 1.0]])
    radius, crest = 0.125, np.array([1.0, 0.0, 1.0])
    turn = np.array([np.sin(-0.4), 0.0, np.cos(-0.4)])
    contact = np.array([[-1.0, 0.1, -1e-4], [0.5, 0.0, 0.5], crest, [2.0, 0, 1.0], [np.nan] * 3])
    normal = np.array([[0.0, 0.0, 1.0], NORMAL, turn, [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    centre = np.nan_to_num(contact) + radius * normal
    np.testing.assert_allclose(ground_normals(profile, contact, centre), normal, atol=1e-9)


def test_no_cones_for_ground_of_unknown_friction(climb: xarray.Dataset, robot: Robot, frames: Frames) -> None:
    unknown = climb.copy()
    unknown.attrs = {key: value for key, value in climb.attrs.items() if key != "friction_static"}
    overlays = overlays_of(unknown, robot, frames)
    assert not [path for path in nodes_of(robot, frames, overlays) if path.startswith("/cone")]
    assert "friction cone" not in [entry.text for entry in legend_entries(robot, overlays)]


# ---- trail -----------------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**32 - 1))
def test_the_trail_keeps_up_with_its_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.01, 0.1, 120))
    points = np.cumsum(rng.normal(0.0, 0.01, (120, 3)), axis=0)
    corners = trail_corners(time, points, tolerance=0.02, most=1000)
    even = np.column_stack([np.interp(time, time[corners], column) for column in points[corners].T])
    assert np.linalg.norm(points - even, axis=1).max() <= 0.02 + 1e-12


def test_a_long_way_has_few_pieces() -> None:
    time = np.linspace(0.0, 60.0, 1801)
    points = np.column_stack([np.sin(3.0 * time), np.cos(2.0 * time), np.sin(5.0 * time)])
    assert len(trail_corners(time, points, most=50)) <= 51


def test_pieces_grow_one_after_another() -> None:
    time = np.array([0.0, 1.0, 3.0])
    points = np.array([[0.0, 0, 0], [0.5, 0, 0], [0.5, 0, 2.0]])
    first, second = trail_motions("/trail", time, points, 4.0)
    for motion, length, began, ended in ((first, 0.5, 0.0, 1.0), (second, 2.0, 1.0, 3.0)):
        assert motion.times is not None
        assert motion.scale is not None
        assert motion.times[0] == 0.0
        assert motion.times[-1] == 4.0
        assert (np.diff(motion.times) >= 0.0).all()
        width = np.interp([began - 0.01, ended], motion.times, motion.scale[:, 0])
        assert width[1] == 1.0
        assert began == 0.0 or width[0] < 1e-3
        middle = np.interp(0.5 * (began + ended), motion.times, motion.scale[:, 2])
        assert middle == pytest.approx(0.5 * length, abs=2e-3)


def test_a_piece_lies_between_its_ends() -> None:
    start, end = np.array([1.0, 2.0, 3.0]), np.array([0.5, 2.5, 3.2])
    matrix = piece_matrix(start, end)
    np.testing.assert_allclose(matrix @ [0, 0, 0, 1], [*start, 1.0])
    np.testing.assert_allclose(matrix @ [0, 0, 1, 1], [*end, 1.0])


# ---- reduced model and reference -------------------------------------------------------------------------------------


def test_the_reduced_model_stands_where_its_equations_say(
    motions: dict[str, Motion], frames: Frames, overlays: Overlays, climb: xarray.Dataset
) -> None:
    """Against the pendulum's own kinematics, from where its wheel angle was zero."""
    assert overlays.reduced is not None
    parameters = overlays.reduced.reduction.parameters
    slope = np.deg2rad(45.0)
    for index in (0, 25, 60):
        state = climb.sel(time=frames.time[index], method="nearest").state.values
        origin = parameters.wheel_radius * NORMAL[[0, 2]]
        wheel = motion_matrix(motions["/reduced/wheel"], index)
        np.testing.assert_allclose(wheel[[0, 2], 3], origin + wheel_position(parameters, slope, state), atol=1e-3)
        body = motion_matrix(motions["/reduced/body"], index)
        np.testing.assert_allclose(body[np.ix_([0, 2], [0, 2])], rotation(state[1]), atol=1e-6)
        com = body @ [parameters.com_in_body[0], 0.0, parameters.com_in_body[1], 1.0]
        np.testing.assert_allclose(com[[0, 2]], origin + com_position(parameters, slope, state), atol=1e-3)
        thrust = motions["/reduced/thrust"].position
        assert thrust is not None
        np.testing.assert_allclose(thrust[index][[0, 2]], origin + thrust_position(parameters, slope, state), atol=1e-3)
        turned = np.arctan2(wheel[0, 2], wheel[2, 2])
        assert np.cos(turned - state[0]) == pytest.approx(1.0, abs=1e-6)


def test_the_reduced_model_lies_on_the_robot(motions: dict[str, Motion], robot: Robot, overlays: Overlays) -> None:
    """Its axle is the middle of the drive wheels, its mass the centre of mass of all else, in a straight run."""
    assert overlays.reduced is not None
    centres = [motions[f"/robot/{joint}"].position for joint in robot.balance.drive_wheels]
    axle = motions["/reduced/wheel"].position
    np.testing.assert_allclose(axle, np.mean(centres, axis=0), atol=1e-3)


def test_the_ghost_is_the_robot_where_the_reference_is(
    motions: dict[str, Motion], robot: Robot, frames: Frames, overlays: Overlays, climb: xarray.Dataset
) -> None:
    assert overlays.reduced is not None
    frame = overlays.reduced.reduction.frame
    radius = frame.wheel_radius
    for index in (0, 40):
        wanted = climb.sel(time=frames.time[index], method="nearest").state_reference.values
        ghost = motion_matrix(motions["/ghost"], index)
        axle = ghost @ [*frame.axle_in_base, 1.0]
        # The heading moves the real axle a little sideways and uphill; the ghost goes along sideways only.
        np.testing.assert_allclose(axle[[0, 2]], (radius * (wanted[0] * ALONG + NORMAL))[[0, 2]], atol=2e-3)
        forward = ghost[:3, :3] @ frame.forward_in_base
        assert np.arctan2(-forward[2], forward[0]) == pytest.approx(wanted[1], abs=1e-4)
        for joint, sign in zip(frame.wheel_joints, frame.wheel_signs, strict=True):
            turn = motion_matrix(motions[f"/ghost/{joint}"], index)[:3, :3]
            still = np.array(pin.exp3(-sign * (wanted[0] - wanted[1]) * robot.wheel(joint).axis_in_joint))
            data = robot.model.createData()
            pin.forwardKinematics(robot.model, data, overlays.reduced.reduction.configuration)
            placed = data.oMi[robot.joint_id(joint)].rotation
            np.testing.assert_allclose(turn @ still, placed, atol=1e-4)


def test_reduced_model_and_ghost_hide_while_nothing_balances(mission_run: xarray.Dataset, robot: Robot) -> None:
    frames = sample_frames(mission_run, robot, frames_per_second=10.0)
    overlays = overlays_of(mission_run, robot, frames)
    found = {one.path: one for one in scene_motions(robot, frames, overlays, metres_per_newton=SCALE)}
    # It settles and rises for four seconds before anything balances.
    for path in ("/reduced/wheel", "/reduced/body", "/ghost"):
        size = found[path].scale
        assert size is not None
        assert size[:38].max() == HIDDEN_SCALE
        assert size[50:60].min() == 1.0
    for motion in found.values():
        for values in (motion.position, motion.quaternion, motion.scale):
            assert values is None or np.isfinite(values).all(), motion.path


def test_a_robot_that_does_not_balance_has_no_reduced_model(
    climb: xarray.Dataset, robot: Robot, frames: Frames
) -> None:
    still = dataclasses.replace(robot, balance=None)
    overlays = overlays_of(climb, still, frames)
    assert overlays.reduced is None
    assert not {"reduced model", "reference"} & {entry.text for entry in legend_entries(still, overlays)}


# ---- discs and legend ------------------------------------------------------------------------------------------------


def test_discs_tell_pushing_from_idle_propellers(motions: dict[str, Motion], robot: Robot) -> None:
    discs = {path: motion for path, motion in motions.items() if "/rotor_" in path}
    assert len(discs) == len(robot.thrusters)
    for path, motion in discs.items():
        assert motion.scale is not None
        pushing = any(frame in path for frame in robot.balance.thrusters)
        assert motion.scale.max() == (1.0 if pushing else HIDDEN_SCALE)


def test_the_legend_switches_all_that_is_drawn(robot: Robot, frames: Frames, overlays: Overlays) -> None:
    switched = tuple(node for entry in legend_entries(robot, overlays) for node in entry.nodes)
    for path in nodes_of(robot, frames, overlays):
        assert any(path == node or path.startswith(f"{node}/") for node in switched), path
