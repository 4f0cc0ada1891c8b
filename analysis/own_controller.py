"""A controller of one's own on the full model: a state feedback and a heading loop balance M4 on a 30 degree slope.

python analysis/own_controller.py
"""

import math

from m4_dynamics import ClimbSettings, linearise, load_robot, prepare_climb
from m4_dynamics.control.lqr import lqr_gain
from m4_dynamics.reduced.linear import discretise_zoh
from m4_dynamics.simulation.balance import drive_wheels

# The full model stands on the slope, 3 deg off its equilibrium; nothing is simulated yet.
start = ClimbSettings(slope=math.radians(30), speed=0.0, pitch_error=math.radians(3))
climb = prepare_climb(load_robot(), start)
plant, estimator, trim, reduction = climb.plant, climb.loop.estimator, climb.trim, climb.reduction
left, right, sign_left, sign_right = drive_wheels(plant.model.robot, reduction.frame)
A, B = linearise(reduction.parameters, trim.slope, trim.state, trim.inputs)  # of the reduced model
K, _ = lqr_gain(*discretise_zoh(A, B, plant.control_period), [10, 1e4, 5, 25], [5, 0.5])

while plant.time < 5.0:
    state = estimator.update(plant.measurement)  # wheel angle, pitch, and their rates, from odometry and IMU
    duty, thrust = trim.inputs - K @ (state - trim.state)
    turn = -3.0 * estimator.heading - 0.7 * estimator.heading_rate  # without it the robot spins out
    plant.command.wheel_duty[[left, right]] = sign_left * (duty - turn), sign_right * (duty + turn)
    plant.command.thrust[:] = thrust * reduction.thrust_shares
    plant.step()  # 5 ms

travel, lean = 1e3 * reduction.parameters.wheel_radius * state[0], math.degrees(state[1] - trim.pitch)
print(f"after {plant.time:.0f} s: {travel:.1f} mm uphill of the start, {lean:.2f} deg off the trim's pitch")
