"""How fast the linear closed loop of the paper's MPC grows, against its horizon: ten steps are too few for this robot.

Near an equilibrium and away from its constraints the MPC is the feedback of a finite-horizon linear-quadratic problem.
Its gain is the first one of the backward Riccati recursion, here with the paper's weights, explicit Euler and no
terminal cost; the largest eigenvalue of A - B K says how fast an error grows or decays in closed loop.

python analysis/paper_horizon.py
python analysis/paper_horizon.py --criterion least-thrust --horizons 10 20 40
"""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

import numpy as np

from m4_dynamics import M4Error, MpcSettings, linearise, load_robot, reduce_robot, select_trim
from m4_dynamics.reduced.linear import discretise_euler
from m4_dynamics.view.tables import make_console, make_table, print_note, print_tables

if TYPE_CHECKING:
    from m4_dynamics.reduced.pendulum import MipParameters
    from m4_dynamics.reduced.trim import Trim


def growth(parameters: MipParameters, trim: Trim, horizon: int) -> float:
    """Fastest growth of the closed loop under the paper's MPC, negative if every error decays.

    Args:
        parameters: The pendulum.
        trim: The equilibrium that the loop is linearised at.
        horizon: Number of steps n_h.

    Returns:
        Real part of the slowest decaying (or fastest growing) closed-loop pole [1/s].
    """
    paper = MpcSettings.paper()
    q, r = np.diag(paper.state_weights), np.diag(paper.input_weights)
    a, b = discretise_euler(*linearise(parameters, trim.slope, trim.state, trim.inputs), paper.time_step)
    cost_to_go = q
    for _ in range(horizon):
        gain = np.linalg.solve(r + b.T @ cost_to_go @ b, b.T @ cost_to_go @ a)
        cost_to_go = q + a.T @ cost_to_go @ (a - b @ gain)
    return float(np.log(np.abs(np.linalg.eigvals(a - b @ gain)).max()) / paper.time_step)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot", nargs="?", help="the robot's TOML (default: M4)")
    parser.add_argument("--slopes", type=float, nargs="+", default=[15.0, 30.0, 45.0, 55.0], help="[deg]")
    parser.add_argument("--horizons", type=int, nargs="+", default=[5, 10, 12, 15, 20, 40], help="numbers of steps n_h")
    parser.add_argument("--criterion", default="automatic", help="which trim: automatic, least-thrust, least-friction")
    options = parser.parse_args()
    if min(options.horizons) < 1:
        parser.error("a horizon has at least 1 step")

    try:
        robot = load_robot(options.robot)
        reduction = reduce_robot(robot)
        # The trims that `m4 wair` climbs at.
        limits = reduction.trim_limits(friction_static=robot.ground.friction_static, friction_fraction=0.8)
        rows = []
        for slope in options.slopes:
            trim = select_trim(
                reduction.parameters, math.radians(slope), limits=limits, criterion=options.criterion, speed=0.3
            )
            rates = [f"{growth(reduction.parameters, trim, n):+.2f}" for n in options.horizons]
            rows.append([f"{slope:g}", f"{math.degrees(trim.pitch):.1f}", f"{trim.thrust:.1f}", *rates])
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    columns = ("slope [deg]", "pitch [deg]", "thrust [N]", *(f"n_h {n}" for n in options.horizons))
    console = make_console()
    print_tables(console, [make_table("Growth of the closed loop under the paper's MPC [1/s]", columns, rows)])
    print_note(
        console,
        "Negative decays. Time step 5 ms, the paper's weights, inputs measured from the trim, constraints idle.",
    )
