"""Draw where the robot can climb over slope and thrust, and its steepest slope against friction.

python analysis/slope_thrust_map.py --out runs/analysis
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from m4_dynamics.errors import M4Error
from m4_dynamics.feasibility.curves import map_curves
from m4_dynamics.feasibility.grid import MapGrid
from m4_dynamics.feasibility.postures import posture_cases
from m4_dynamics.feasibility.static import static_map
from m4_dynamics.reduced.power import PowerModel
from m4_dynamics.reduced.reduction import reduce_robot
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.view.map_plots import plot_static_curves, plot_static_map


def main() -> None:
    """Compute, draw, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", type=Path, help="the robot's TOML or URDF (default: M4)")
    parser.add_argument("--speed", type=float, default=0.3, help="climbing speed [m/s] (default: 0.3)")
    parser.add_argument("--out", type=Path, default=Path("runs/analysis"), help="folder of the pictures")
    options = parser.parse_args()
    try:
        robot = load_robot(options.robot)
        grid = MapGrid(
            slope=np.radians(np.linspace(0.0, 85.0, 341)),
            thrust=np.unique(np.linspace(0.0, reduce_robot(robot).thrust_max, 433)),
            friction=np.linspace(0.3, 1.3, 11),
            speed=options.speed,
        )
        dataset = static_map(posture_cases(robot, grid), grid)
        dataset.attrs.update(robot=robot.name, figure_of_merit=PowerModel().figure_of_merit)
        curves = map_curves(dataset)
        options.out.mkdir(parents=True, exist_ok=True)
        pictures = [
            plot_static_map(dataset, options.out / "slope_thrust_map.png"),
            plot_static_curves(curves, options.out / "steepest_slope.png"),
        ]
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    one = curves.isel(posture_angle=0, speed=0)
    print("friction  steepest slope [deg]  with thrust [N]")
    for m, friction in enumerate(one["friction"].to_numpy()):
        steepest = math.degrees(float(one["steepest_slope_best_thrust"][m]))
        print(f"{friction:8.2f}  {steepest:20.2f}  {float(one['best_thrust'][m]):15.1f}")
    print("wrote " + ", ".join(str(picture) for picture in pictures))


if __name__ == "__main__":
    main()
