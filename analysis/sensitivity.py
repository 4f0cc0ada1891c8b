"""Show how much wheel radius, height of the CoM and arm of the thrust matter to the steepest slope.

Each is varied alone, the rest of the pendulum kept: a larger wheel without heavier legs, a thrust that acts elsewhere.

python analysis/sensitivity.py --out runs/analysis
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from m4_dynamics.errors import M4Error
from m4_dynamics.feasibility.curves import map_curves
from m4_dynamics.feasibility.grid import MapGrid
from m4_dynamics.feasibility.static import PostureCase, static_map
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.reduction import reduce_robot
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.view.style import dress_axes, new_figure, save_figure, series_colours, title_figure

SCALES = np.linspace(0.7, 1.3, 13)
REFERENCE_SLOPE = math.radians(60.0)


def varied(parameters: MipParameters, what: str, scale: float) -> MipParameters:
    """Scale one property of the pendulum."""
    if what == "wheel radius":
        return parameters.with_(wheel_radius=scale * parameters.wheel_radius)
    if what == "height of the CoM":
        forward, up = parameters.com_in_body
        return parameters.with_(com_in_body=(forward, scale * up))
    forward, up = parameters.thrust_point_in_body
    return parameters.with_(thrust_point_in_body=(forward, scale * up))


def main() -> None:
    """Compute, draw, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", type=Path, help="the robot's TOML or URDF (default: M4)")
    parser.add_argument("--friction", type=float, default=0.8, help="static friction (default: 0.8)")
    parser.add_argument("--out", type=Path, default=Path("runs/analysis"), help="folder of the picture")
    options = parser.parse_args()
    try:
        robot = load_robot(options.robot)
        reduction = reduce_robot(robot)
        grid = MapGrid(
            slope=np.radians(np.linspace(20.0, 85.0, 651)),
            thrust=np.unique(np.linspace(0.0, reduction.thrust_max, 217)),
            friction=options.friction,
        )
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    figure = new_figure(width=10.5, height=4.4)
    steepest_axes, friction_axes = figure.subplots(1, 2)
    names = ("wheel radius", "height of the CoM", "arm of the thrust")
    print("property            scale  steepest slope [deg]  least friction at 60 deg")
    for name, colour in zip(names, series_colours(len(names)), strict=True):
        steepest, needed = [], []
        for scale in SCALES:
            case = PostureCase(varied(reduction.parameters, name, float(scale)), reduction.trim_limits())
            curves = map_curves(static_map([case], grid)).squeeze()
            steepest.append(math.degrees(float(curves["steepest_slope_best_thrust"])))
            needed.append(float(curves["least_friction"].sel(slope=REFERENCE_SLOPE, method="nearest")))
            if round(float(scale), 6) in (0.8, 1.0, 1.2):
                print(f"{name:18}  {scale:5.2f}  {steepest[-1]:20.1f}  {needed[-1]:24.3f}")
        nominal = steepest[len(SCALES) // 2]
        steepest_axes.plot(SCALES, steepest, color=colour, label=name)
        friction_axes.plot(SCALES, needed, color=colour, label=name)
    dress_axes(
        steepest_axes,
        title=f"Steepest slope, as described {nominal:.1f}°",
        xlabel="scale of the property [1]",
        ylabel="slope [deg]",
    )
    dress_axes(
        friction_axes, title="Least friction at 60°", xlabel="scale of the property [1]", ylabel="coefficient [1]"
    )
    steepest_axes.legend(loc="upper center", fontsize=8.5, frameon=False)
    title_figure(
        figure,
        "What the steepest slope depends on",
        f"{robot.name}   ·   friction μₛ {options.friction:g}   ·   each property varied alone, best thrust",
    )
    options.out.mkdir(parents=True, exist_ok=True)
    print(f"wrote {save_figure(figure, options.out / 'sensitivity.png')}")


if __name__ == "__main__":
    main()
