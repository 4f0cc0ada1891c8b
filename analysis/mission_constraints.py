"""Compare the MPC's constraints with the simulated ground forces, and look at its cost (paper, Fig. plot_mpc).

The paper's model and its simulator agree, but its cost climbs, because a horizon of 0.05 s cannot hold the wheel. With
the terminal cost of the default controller it does not; `m4 wair --controller paper` shows the paper's.

python analysis/mission_constraints.py                   # runs the paper's mission first
python analysis/mission_constraints.py runs/wair45       # a finished run
"""

from __future__ import annotations

from pathlib import Path

import xarray

from m4_dynamics.cli.figure_script import draw_from_run
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.constraint_plot import constraint_figures, plot_constraints


def draw(dataset: xarray.Dataset, robot: Robot, folder: Path) -> None:
    """Draw the constraints and print their figures."""
    figures, weight = constraint_figures(dataset), robot.mass * robot.gravity
    print("away from the corners of the ground, while the MPC balances:")
    print(
        f"  friction force, model against simulation: {100.0 * figures.friction_rms / weight:.3f} % of the weight RMS"
    )
    print(f"  normal force, model against simulation:   {100.0 * figures.normal_rms / weight:.3f} % of the weight RMS")
    print(f"  largest -f_n: {figures.worst_normal:.1f} N, largest f_x^2 - (mu f_n)^2: {figures.worst_friction:.0f} N^2")
    print(f"  cost, median of the first and the last quarter: {figures.cost_first:.2g}, {figures.cost_last:.2g}")
    print(f"wrote {plot_constraints(dataset, folder / 'mission_constraints.png')}")


if __name__ == "__main__":
    draw_from_run(__doc__, draw, mission="wair15")
