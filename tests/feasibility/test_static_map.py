"""Static maps against hand figures, single trims and the full model's equations of motion."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
import xarray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.feasibility.curves import map_curves
from m4_dynamics.feasibility.grid import MapGrid
from m4_dynamics.feasibility.limits import Limit
from m4_dynamics.feasibility.postures import posture_case, posture_cases
from m4_dynamics.feasibility.static import PostureCase, best_branch, static_map
from m4_dynamics.reduced.reduction import Reduction, configuration_on_slope, reduce_robot
from m4_dynamics.reduced.trim import trim_branches
from m4_dynamics.robot.robot import Robot


@pytest.fixture(scope="module")
def grid() -> MapGrid:
    return MapGrid(
        slope=np.radians(np.linspace(0.0, 85.0, 35)),
        thrust=np.linspace(0.0, 48.0, 33),
        friction=[0.3, 0.8],
        speed=[0.0, 0.4],
    )


@pytest.fixture(scope="module")
def m4_map(m4: Robot, grid: MapGrid) -> xarray.Dataset:
    return static_map(posture_cases(m4, grid), grid)


@pytest.mark.parametrize(
    ("thrust", "pitch_deg", "friction_needed", "torque"),
    [(0.0, 10.8, 1.00, 5.2), (6.6, -3.5, 0.80, 4.6), (14.4, -21.4, 0.60, 3.6), (26.7, -56.0, 0.42, 1.9)],
)
def test_hand_figures_at_45_degrees(
    m4_reduction: Reduction, thrust: float, pitch_deg: float, friction_needed: float, torque: float
) -> None:
    grid = MapGrid(slope=math.radians(45.0), thrust=thrust, friction=0.8)
    case = PostureCase(m4_reduction.parameters, m4_reduction.trim_limits())
    cell = best_branch(static_map([case], grid)).squeeze()
    assert math.degrees(float(cell["pitch"])) == pytest.approx(pitch_deg, abs=0.1)
    assert float(cell["friction_needed"]) == pytest.approx(friction_needed, abs=0.005)
    assert float(cell["torque"]) == pytest.approx(torque, abs=0.05)


def test_every_cell_agrees_with_single_trims(m4_map: xarray.Dataset, m4_reduction: Reduction) -> None:
    rng = np.random.default_rng(1)
    compared = 0
    for _ in range(150):
        i, j, m, s = (int(rng.integers(m4_map.sizes[d])) for d in ("slope", "thrust", "friction", "speed"))
        cell = m4_map.isel(posture_angle=0, slope=i, thrust=j, friction=m, speed=s)
        limits = m4_reduction.trim_limits(friction_static=float(cell["friction"]))
        members = {
            trim.branch: trim
            for trim in trim_branches(
                m4_reduction.parameters, float(cell["slope"]), float(cell["thrust"]), speed=float(cell["speed"]),
                limits=limits,
            )
        }  # fmt: skip
        for branch in ("upright", "hanging"):
            one = cell.sel(branch=branch)
            if branch not in members:
                assert np.isnan(one["pitch"])
                assert not one["feasible"]
                assert int(one["active_limit"]) == Limit.EQUILIBRIUM
                continue
            trim = members[branch]
            compared += 1
            assert float(one["pitch"]) == pytest.approx(trim.pitch, abs=1e-12)
            assert float(one["duty"]) == pytest.approx(trim.duty, abs=1e-12)
            assert float(one["friction_force"]) == pytest.approx(trim.friction_force, abs=1e-9)
            assert float(one["normal_force"]) == pytest.approx(trim.normal_force, abs=1e-9)
            assert float(one["margin_friction"]) == pytest.approx(trim.margins.friction, abs=1e-9)
            assert float(one["margin_thrust"]) == pytest.approx(trim.margins.thrust, abs=1e-9)
            assert float(one["margin_clearance"]) == pytest.approx(trim.margins.clearance, abs=1e-9)
            assert bool(one["feasible"]) == trim.within_limits
    assert compared > 100


def test_the_active_limit_is_missed_where_a_cell_is_not_feasible(m4_map: xarray.Dataset) -> None:
    margins = {
        Limit.FRICTION: "margin_friction",
        Limit.NORMAL_FORCE: "margin_normal_force",
        Limit.THRUST: "margin_thrust",
        Limit.TORQUE: "margin_torque",
        Limit.MOTOR_SPEED: "margin_motor_speed",
        Limit.CLEARANCE: "margin_clearance",
        Limit.PITCH_WINDOW: "margin_pitch_window",
    }
    active, feasible = m4_map["active_limit"], m4_map["feasible"]
    named = set()
    for limit, name in margins.items():
        here = (active == limit) & ~feasible
        margin = m4_map[name].broadcast_like(active).transpose(*active.dims)
        assert (margin.where(here).fillna(-1.0) < 0.0).all()
        if bool(here.any()):
            named.add(limit)
    assert {Limit.FRICTION, Limit.NORMAL_FORCE, Limit.CLEARANCE, Limit.MOTOR_SPEED} <= named
    assert (m4_map["pitch"].isnull() == (active == Limit.EQUILIBRIUM).any(["speed", "friction"])).all()


def test_speed_and_not_torque_is_blamed_where_only_the_speed_is_too_much(m4_reduction: Reduction) -> None:
    case = PostureCase(m4_reduction.parameters, m4_reduction.trim_limits())
    grid = MapGrid(slope=math.radians(45.0), thrust=5.0, friction=5.0, speed=[0.0, 0.5, 1.0])
    cell = static_map([case], grid).isel(branch=0).squeeze()
    assert cell["feasible"].to_numpy().tolist() == [True, False, False]
    assert cell["active_limit"].to_numpy().tolist()[1:] == [Limit.MOTOR_SPEED] * 2
    motor = m4_reduction.parameters
    assert float(cell["margin_torque"]) > 0.0
    # The speed to spare at standstill is the speed at which the duty just saturates.
    at_full_duty = float(cell["margin_motor_speed"][0])
    assert motor.torque_constant - motor.back_emf_constant * at_full_duty == pytest.approx(float(cell["torque"]))
    steep = MapGrid(slope=math.radians(60.0), thrust=0.0, friction=5.0, speed=[0.0, 0.5])
    limits = static_map([case], steep).isel(branch=0).squeeze()["active_limit"]
    assert limits.to_numpy().tolist() == [Limit.TORQUE] * 2


def test_thrust_beyond_the_thrusters_is_refused(m4_map: xarray.Dataset) -> None:
    assert not m4_map["feasible"].sel(thrust=slice(43.3, None)).any()
    assert (m4_map["margin_thrust"].sel(thrust=slice(43.3, None)) < 0.0).all()


def full_model_acceleration(robot: Robot, reduction: Reduction, cell: xarray.Dataset) -> np.ndarray:
    """Acceleration of all degrees of freedom with the cell's ground force, thrust and torque; servos hold the legs."""
    slope, model, frame = float(cell["slope"]), robot.model, reduction.frame
    q = configuration_on_slope(robot, reduction, slope=slope, pitch=float(cell["pitch"]))
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    pin.updateFramePlacements(model, data)
    tangent, normal = np.array([math.cos(slope), 0, math.sin(slope)]), np.array([-math.sin(slope), 0, math.cos(slope)])
    outside = [np.zeros(6) for _ in range(model.njoints)]

    def push(joint: int, point: np.ndarray, force: np.ndarray) -> None:
        """Add a force at a point of the world, in the joint's own axes."""
        local = data.oMi[joint].rotation.T @ force
        arm = data.oMi[joint].actInv(point)
        outside[joint] += np.concatenate([local, np.cross(arm, local)])

    on_each_wheel = 0.5 * (float(cell["friction_force"]) * tangent + float(cell["normal_force"]) * normal)
    torque = np.zeros(model.nv)
    for name, sign in zip(frame.wheel_joints, frame.wheel_signs, strict=True):
        wheel = robot.wheel(name)
        push(wheel.joint_id, data.oMi[wheel.joint_id].translation - frame.wheel_radius * normal, on_each_wheel)
        torque[wheel.index_v] = 0.5 * sign * float(cell["torque"])
    for thruster, share in zip(robot.thrusters, reduction.thrust_shares, strict=True):
        direction = data.oMi[thruster.joint_id].rotation @ thruster.direction_in_joint
        push(thruster.joint_id, data.oMf[thruster.frame_id].translation, share * float(cell["thrust"]) * direction)
    forces = pin.StdVec_Force()
    for wrench in outside:
        forces.append(pin.Force(wrench))
    # A position servo gives whatever torque holds its leg; base and wheels have nothing of the kind.
    zero = np.zeros(model.nv)
    needed = pin.rnea(model, data, q, zero, zero, forces)
    for servo in robot.servos:
        torque[servo.index_v] = needed[servo.index_v]
    return np.array(pin.aba(model, data, q, zero, torque, forces))


def test_no_degree_of_freedom_of_the_full_model_accelerates(m4: Robot, m4_reduction: Reduction) -> None:
    rng = np.random.default_rng(7)
    grid = MapGrid(
        slope=np.sort(rng.uniform(0.0, math.radians(80.0), 12)),
        thrust=np.sort(rng.uniform(0.0, 43.2, 12)),
        friction=0.8,
    )
    dataset = static_map([posture_case(m4, m4_reduction)], grid).squeeze()
    checked = 0
    for branch in dataset["branch"]:
        for slope in dataset["slope"]:
            for thrust in dataset["thrust"]:
                cell = dataset.sel(branch=branch, slope=slope, thrust=thrust)
                if np.isnan(cell["pitch"]):
                    continue
                acceleration = full_model_acceleration(m4, m4_reduction, cell)
                assert acceleration.shape == (18,)
                np.testing.assert_allclose(acceleration, 0.0, atol=1e-6)
                checked += 1
                known = cell
    assert checked > 150
    wrong = known.assign(pitch=known["pitch"] + 1e-3)
    assert np.abs(full_model_acceleration(m4, m4_reduction, wrong)).max() > 1e-3


def test_curves_are_maxima_and_minima_of_the_map(m4_map: xarray.Dataset) -> None:
    curves = map_curves(m4_map)
    one = curves.isel(posture_angle=0).sel(speed=0.0, friction=0.8)
    best = best_branch(m4_map).isel(posture_angle=0).sel(speed=0.0, friction=0.8)
    feasible = best["feasible"].transpose("slope", "thrust").to_numpy()
    slopes = m4_map["slope"].to_numpy()
    steepest = [slopes[column].max() if column.any() else np.nan for column in feasible.T]
    np.testing.assert_array_equal(one["steepest_slope"], steepest)
    assert float(one["steepest_slope_best_thrust"]) == np.nanmax(steepest)
    chosen = best.sel(slope=one["steepest_slope_best_thrust"], thrust=one["best_thrust"])
    assert bool(chosen["feasible"])
    # A thruster that presses into the slope makes steeper slopes possible than the friction cone alone.
    assert float(one["steepest_slope_best_thrust"]) > math.atan(0.8) + math.radians(15.0)
    # On gentle slopes some thrust makes do without friction; steeper ones need ever more.
    assert float(one["least_friction"].sel(slope=slice(0.0, math.radians(15.0))).max()) < 0.02
    assert (np.diff(one["least_friction"].sel(slope=slice(math.radians(20.0), None))) > 0.0).all()
    at_45 = one.sel(slope=math.radians(45.0))
    assert 0.40 < float(at_45["least_friction"]) < 0.43
    assert 20.0 < float(at_45["thrust_of_least_friction"]) < 30.0


def test_a_posture_angle_is_an_axis(m4: Robot) -> None:
    joints = ("rear_left_hip_sagittal", "rear_right_hip_sagittal")
    angles = np.radians([60.0, 75.0, 90.0])
    grid = MapGrid(
        slope=math.radians(45.0), thrust=[0.0, 10.0], friction=0.8, posture_angle=angles, posture_joints=joints
    )
    dataset = static_map(posture_cases(m4, grid), grid)
    for k, angle in enumerate(angles):
        q = np.array(m4.posture("mip").configuration)
        for name in joints:
            q[m4.model.joints[m4.joint_id(name)].idx_q] = angle
        reduction = reduce_robot(m4, configuration=q)
        for trim in trim_branches(reduction.parameters, math.radians(45.0), 10.0, limits=reduction.trim_limits()):
            pitch = dataset["pitch"].isel(posture_angle=k, slope=0, thrust=1).sel(branch=trim.branch)
            assert float(pitch) == pytest.approx(trim.pitch, abs=1e-12)


def test_overlapping_bodies_are_not_feasible(m4: Robot) -> None:
    joints = ("front_left_hip_sagittal", "front_right_hip_sagittal")
    angles = np.radians([-90.0, -57.7])
    grid = MapGrid(slope=math.radians(20.0), thrust=5.0, friction=0.8, posture_angle=angles, posture_joints=joints)
    dataset = static_map(posture_cases(m4, grid), grid).squeeze().sel(branch="upright")
    assert dataset["self_collision"].to_numpy().tolist() == [True, False]
    assert dataset["feasible"].to_numpy().tolist() == [False, True]
    assert int(dataset["active_limit"][0]) == Limit.COLLISION


def test_a_robot_without_thrusters_has_a_map(scooter: Robot) -> None:
    grid = MapGrid(slope=np.radians([0.0, 10.0, 60.0]), thrust=0.0, friction=0.8)
    best = best_branch(static_map(posture_cases(scooter, grid), grid)).squeeze()
    assert bool(best["feasible"][0])
    assert not bool(best["feasible"][2])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"slope": [0.1, 0.1]}, "increasing"),
        ({"slope": math.radians(95.0)}, "0 to 89.9"),
        ({"thrust": [-1.0]}, "thrust"),
        ({"thrust": []}, "at least one"),
        ({"friction": 0.0}, "friction"),
        ({"speed": math.nan}, "speed"),
        ({"posture_angle": [0.1]}, "joints that turn"),
        ({"slope": np.linspace(0, 1, 5000), "thrust": np.linspace(0, 1, 5000)}, "cells of the map"),
    ],
)
def test_bad_axes_are_refused(changes: dict, message: str) -> None:
    with pytest.raises(InvalidSettingError, match=message):
        MapGrid(**{"slope": 0.1, "thrust": 1.0, "friction": 0.8, **changes})


def test_a_joint_that_cannot_turn_so_far_is_refused(m4: Robot) -> None:
    grid = MapGrid(slope=0.1, thrust=1.0, friction=0.8, posture_angle=3.0, posture_joints=("rear_left_hip_sagittal",))
    with pytest.raises(InvalidSettingError, match="rear_left_hip_sagittal"):
        posture_cases(m4, grid)
    wheel = MapGrid(slope=0.1, thrust=1.0, friction=0.8, posture_angle=0.5, posture_joints=("rear_left_wheel",))
    with pytest.raises(InvalidSettingError, match="one angle"):
        posture_cases(m4, wheel)
