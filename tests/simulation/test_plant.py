"""The stepping API for one's own controllers: reset, step, measurements with and without imperfections."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from m4_dynamics.control.estimator import IMU_ENTRIES
from m4_dynamics.errors import InvalidSettingError, NonFiniteError
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.stepping import SimulationDivergedError
from m4_dynamics.full.terrain import flat_terrain, incline_terrain
from m4_dynamics.reduced.reduction import configuration_on_slope, reduce_robot, velocity_on_slope
from m4_dynamics.simulation.balance import balance_estimator, drive_wheels
from m4_dynamics.simulation.plant import Plant


@pytest.fixture(scope="module")
def reduction(m4):
    return reduce_robot(m4)


def standing(m4):
    q = m4.posture("ugv").configuration.copy()
    q[2] = 0.2939
    return q


def test_a_robot_at_rest_measures_gravity_and_nothing_else(m4):
    plant = Plant(FullModel.build(m4, flat_terrain()))
    plant.reset(standing(m4))
    for _ in range(400):
        plant.step()
    seen = plant.measurement_now
    assert seen.time == pytest.approx(2.0)
    # The accelerometer reads the reaction to gravity, upwards, in base axes.
    rotation = pin.Quaternion(seen.attitude).toRotationMatrix()
    np.testing.assert_allclose(rotation @ seen.proper_acceleration_in_base, [0.0, 0.0, 9.81], atol=1e-3)
    np.testing.assert_allclose(seen.angular_rate_in_base, 0.0, atol=1e-4)
    np.testing.assert_allclose(seen.wheel_rate, 0.0, atol=1e-3)


def test_in_free_fall_the_accelerometer_reads_nothing(m4):
    plant = Plant(FullModel.build(m4, flat_terrain()))
    q = standing(m4)
    q[2] = 50.0
    q[3:7] = pin.Quaternion(pin.utils.rpyToMatrix(0.3, -0.4, 1.0)).coeffs()
    plant.reset(q)
    plant.step()
    plant.step()
    np.testing.assert_allclose(plant.measurement_now.proper_acceleration_in_base, 0.0, atol=1e-3)


def test_drives_forward_by_wheel_duty(m4):
    plant = Plant(FullModel.build(m4, flat_terrain()))
    plant.reset(standing(m4))
    plant.command.wheel_duty[:] = 0.1
    start = plant.configuration[0]
    for _ in range(400):
        measurement = plant.step()
    wheels = len(m4.wheels)
    rolled = measurement[IMU_ENTRIES : IMU_ENTRIES + wheels].mean() * m4.wheels[0].radius
    assert plant.configuration[0] - start > 0.1
    # The rim's deepest point rolls without slip: travel is radius times angle.
    assert plant.configuration[0] - start == pytest.approx(rolled, rel=5e-3)


def test_actuators_are_limited(m4):
    plant = Plant(FullModel.build(m4, flat_terrain()))
    plant.reset(standing(m4))
    plant.command.wheel_duty[:] = 7.0
    plant.command.thrust[:] = 1e6
    plant.step()
    np.testing.assert_array_equal(plant.stepper.actuation.wheel_duty, 1.0)
    np.testing.assert_array_equal(plant.stepper.actuation.thrust, [t.maximum_thrust for t in m4.thrusters])


@pytest.mark.parametrize("yaw", [0.0, 0.05, -0.2])
@pytest.mark.parametrize("slope", [0.0, 0.5])
def test_estimator_reads_the_placement_back(m4, reduction, slope, yaw):
    plant = Plant(FullModel.build(m4, incline_terrain(slope)))
    q = configuration_on_slope(m4, reduction, slope=slope, pitch=-0.2, yaw=0.0)
    v = velocity_on_slope(m4, reduction, slope=slope, pitch=-0.2, yaw=0.0, speed=0.4, pitch_rate=0.3, yaw_rate=0.1)
    measurement = plant.reset(q, v)
    estimator = balance_estimator(m4, reduction, slope=slope)
    estimator.reset(measurement, wheel_angle=2.0, heading=yaw)
    phi, pitch, phi_rate, pitch_rate = estimator.state
    assert (phi, pitch) == pytest.approx((2.0, -0.2), abs=1e-12)
    assert phi_rate == pytest.approx(0.4 / reduction.frame.wheel_radius, abs=1e-12)
    assert pitch_rate == pytest.approx(0.3, abs=1e-12)
    assert estimator.heading == pytest.approx(yaw, abs=1e-12)
    assert estimator.heading_rate == pytest.approx(0.1, abs=1e-12)


def test_the_robots_left_wheel_is_on_the_pendulums_right(m4, reduction):
    wheels = drive_wheels(m4, reduction.frame)
    names = [wheel.joint for wheel in m4.wheels]
    assert (names[wheels.left], names[wheels.right]) == ("rear_right_wheel", "rear_left_wheel")
    assert (wheels.sign_left, wheels.sign_right) == (-1.0, -1.0)


def test_refusals_say_what_was_wrong(m4):
    model = FullModel.build(m4, flat_terrain())
    with pytest.raises(InvalidSettingError, match="control_period"):
        Plant(model, control_period=5.5e-3)
    with pytest.raises(InvalidSettingError, match="time_step"):
        Plant(model, time_step=-1e-3, control_period=5e-3)
    plant = Plant(model)
    with pytest.raises(InvalidSettingError, match="configuration"):
        plant.reset(np.zeros(3))
    bad = standing(m4)
    bad[0] = np.nan
    with pytest.raises(NonFiniteError, match="configuration"):
        plant.reset(bad)


def test_divergence_is_reported_with_joint_and_time(m4):
    plant = Plant(FullModel.build(m4, flat_terrain()))
    plant.reset(standing(m4))
    plant.command.external_wrench[0] = 1e12
    with pytest.raises(SimulationDivergedError, match="diverged at t"):
        plant.step()
