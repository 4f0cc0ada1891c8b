"""A robot that is not what its controllers believe: what the errors change, and that the wheels end in place anyway."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pinocchio as pin
import pytest

from m4_dynamics.errors import InvalidSettingError, NonFiniteError
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.standing import standing_configuration
from m4_dynamics.full.terrain import flat_terrain, incline_terrain
from m4_dynamics.reduced.reduction import reduce_robot
from m4_dynamics.simulation.fidelity import Fidelity
from m4_dynamics.simulation.plant import Plant
from m4_dynamics.simulation.plant_errors import PlantErrors, perturbed_robot


@pytest.fixture(scope="module")
def frame(m4):
    return reduce_robot(m4).frame


def offset(frame, forward=0.0, up=0.0):
    return tuple(forward * frame.forward_in_base + up * frame.up_in_base)


def test_mass_and_inertia_scale_and_the_original_stays(m4):
    before = [inertia.copy() for inertia in m4.model.inertias]
    heavier = perturbed_robot(m4, PlantErrors(mass_scale=1.1))
    assert pin.computeTotalMass(heavier.model) == pytest.approx(6.6)
    q = m4.posture("mip").configuration
    matrices = [pin.crba(model, model.createData(), q) for model in (m4.model, heavier.model)]
    np.testing.assert_allclose(matrices[1], 1.1 * matrices[0], rtol=1e-12, atol=1e-14)
    assert all(a == b for a, b in zip(before, m4.model.inertias, strict=True))


@pytest.mark.parametrize("posture", ["ugv", "mip"])
def test_com_of_the_whole_robot_moves_by_the_offset(m4, posture):
    moved = perturbed_robot(m4, PlantErrors(com_offset_in_base=(0.01, -0.02, 0.03)))
    q = m4.posture(posture).configuration
    base = pin.SE3(pin.Quaternion(q[3:7]).normalized().toRotationMatrix(), q[:3])
    com = [pin.centerOfMass(model, model.createData(), q) for model in (m4.model, moved.model)]
    np.testing.assert_allclose(base.rotation.T @ (com[1] - com[0]), [0.01, -0.02, 0.03], atol=1e-12)
    assert pin.computeTotalMass(moved.model) == pytest.approx(6.0)


def test_no_error_is_the_robot_itself(m4):
    assert perturbed_robot(m4, PlantErrors(thrust_scale=0.5, friction_scale=0.5)) is m4


def test_weak_thrusters_push_less(m4):
    # In free fall the CoM obeys Newton's law, whatever the body does.
    velocities = []
    for scale in (1.0, 0.85):
        plant = Plant(FullModel.build(m4, flat_terrain()), thrust_scale=scale)
        q = m4.posture("uas").configuration.copy()
        q[2] = 50.0
        plant.reset(q)
        plant.command.thrust[:] = 5.0
        for _ in range(4):
            plant.step()
        data = m4.model.createData()
        pin.centerOfMass(m4.model, data, plant.configuration, plant.velocity)
        velocities.append(data.vcom[0].copy())
    directions = [data.oMi[thruster.joint_id].rotation @ thruster.direction_in_joint for thruster in m4.thrusters]
    lost = 0.15 * 5.0 * np.sum(directions, axis=0)
    np.testing.assert_allclose(velocities[0] - velocities[1], lost / 6.0 * plant.time, rtol=0.02, atol=1e-4)
    np.testing.assert_allclose(plant.stepper.actuation.thrust, 4.25)


def test_friction_scales(m4):
    ground = PlantErrors(friction_scale=0.875).applied_to(dataclasses.replace(m4.ground, friction_static=0.8))
    assert ground.friction_static == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"mass_scale": 0.0}, InvalidSettingError),
        ({"thrust_scale": -1.0}, InvalidSettingError),
        ({"friction_scale": math.nan}, InvalidSettingError),
        ({"friction_scale_left": 0.0}, InvalidSettingError),
        ({"thrust_scales": (1.0, -1.0)}, InvalidSettingError),
        ({"com_offset_in_base": (0.0, 0.0)}, InvalidSettingError),
        ({"com_offset_in_base": (0.0, math.nan, 0.0)}, NonFiniteError),
    ],
)
def test_errors_that_cannot_be_are_refused(change, error):
    with pytest.raises(error):
        PlantErrors(**change)


def test_each_thruster_may_err_for_itself(m4):
    errors = PlantErrors(thrust_scale=0.5, thrust_scales=(1.1, 0.9, 1.0, 1.0))
    np.testing.assert_allclose(errors.thrust_given(m4), [0.55, 0.45, 0.5, 0.5])
    plant = Plant(FullModel.build(m4, flat_terrain()), thrust_scale=errors.thrust_given(m4))
    plant.command.thrust[:] = 4.0
    plant.step()
    np.testing.assert_allclose(plant.stepper.actuation.thrust, [2.2, 1.8, 2.0, 2.0])
    with pytest.raises(InvalidSettingError, match="4 factors, one for each thruster"):
        PlantErrors(thrust_scales=(1.0, 1.0)).thrust_given(m4)


def test_the_left_side_may_grip_less(m4):
    # A robot that slides downhill on its wheels, legs braked: each side's friction is its own normal force times mu.
    terrain = PlantErrors(friction_scale_left=0.5).applied_to_terrain(incline_terrain(math.radians(45.0)))
    plant = Plant(FullModel.build(m4, terrain))
    q = standing_configuration(m4, "ugv")
    turn = pin.AngleAxis(-math.radians(45.0), np.array([0.0, 1.0, 0.0])).toRotationMatrix()
    q[:3], q[3:7] = turn @ q[:3], pin.Quaternion(turn).coeffs()
    plant.reset(q)
    plant.command.wheel_brake[:] = 100.0
    for _ in range(100):
        plant.step()
    force = plant.stepper.wheel_force_in_world
    normal = force @ [-math.sqrt(0.5), 0.0, math.sqrt(0.5)]
    friction = np.linalg.norm(force - np.outer(normal, [-math.sqrt(0.5), 0.0, math.sqrt(0.5)]), axis=1)
    left = np.array([plant.model.robot.wheels[i].joint.find("left") >= 0 for i in range(4)])
    dynamic = m4.ground.friction_static * m4.ground.friction_dynamic_fraction
    assert (normal > 1.0).all()
    np.testing.assert_allclose(friction[~left] / normal[~left], dynamic, rtol=0.01)
    np.testing.assert_allclose(friction[left] / normal[left], 0.5 * dynamic, rtol=0.01)


ERRORS = {
    "thrust -15 %": {"thrust_scale": 0.85},
    "mass +10 %": {"mass_scale": 1.1},
    "CoM 2 cm forward": {"forward": 0.02},
    "CoM 2 cm up": {"up": 0.02},
    "all at once": {"thrust_scale": 0.85, "mass_scale": 1.1, "forward": -0.02},
}


def plant_errors(frame, *, forward=0.0, up=0.0, **scales):
    return PlantErrors(com_offset_in_base=offset(frame, forward, up), **scales)


@pytest.mark.parametrize("slope", [15.0, 30.0, 45.0])
@pytest.mark.parametrize("error", ERRORS)
def test_steady_wheel_error_stays_under_a_centimetre(climb, frame, slope, error):
    result = climb(slope, 5.0, plant_errors=plant_errors(frame, **ERRORS[error]), duration=7.0)
    assert result.summary.verdict == "climbed", result.summary.reason
    assert result.summary.max_slip_speed_m_s <= 5e-3
    dataset = result.dataset
    # True axle position, not odometry: the rest of the error is the ground's creep, which wheels cannot measure.
    wheel_error = (dataset.state - dataset.state_reference).sel(reduced_state="wheel_angle").to_numpy() * 0.125
    time = dataset.time.to_numpy()
    assert np.abs(wheel_error[time >= 6.0]).max() <= 0.004  # required 0.01, measured 0.001 to 0.003
    assert np.abs(wheel_error[(time >= 2.5) & (time < 3.5)]).max() <= 0.005


@pytest.mark.parametrize("fidelity", [Fidelity(control_delay=3), Fidelity.realistic()], ids=["delay", "realistic"])
def test_nor_does_it_where_commands_act_late_and_sensors_err(climb, frame, fidelity):
    errors = plant_errors(frame, thrust_scale=0.85, mass_scale=1.1)
    dataset = climb(45.0, 5.0, plant_errors=errors, fidelity=fidelity, duration=8.0).dataset
    wheel_error = (dataset.state - dataset.state_reference).sel(reduced_state="wheel_angle").to_numpy() * 0.125
    assert abs(wheel_error[-100:].mean()) <= 0.01  # measured 0.001 and 0.004


def test_without_the_estimate_it_does_not(climb, frame):
    # The LQR has the same feedback and no estimate.
    result = climb(45.0, 5.0, controller="lqr", plant_errors=plant_errors(frame, thrust_scale=0.85))
    wheel_error = (result.dataset.state - result.dataset.state_reference).sel(reduced_state="wheel_angle") * 0.125
    assert abs(float(wheel_error[-1])) > 0.04  # measured 0.050
