"""Show that a plain rover cannot climb 45 degrees, and the same robot on two wheels with thrust can.

The rover is the robot on four wheels, each driven by its own speed loop, on the full model. With a friction of 0.8 it
slips beyond atan(0.8) = 38.7 degrees, and a few degrees before that: its front wheels bear less weight than torque.
More friction helps up to 46.6 degrees, where its centre of mass stands over the rear wheels. At 45 degrees so little is
left that with a friction of 1.2 it tips over at 0.3 m/s, and just gets up at 0.1 m/s. On two wheels (set on the slope
in balance, above its foot) the thrust presses the robot on, so that 45 degrees need less friction than there is.

python analysis/rover_cannot_climb.py --out runs/analysis
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from m4_dynamics.cli.results import make_folder
from m4_dynamics.errors import M4Error
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import ClimbSettings, run_climb
from m4_dynamics.simulation.rover import RoverSettings, drive_rover
from m4_dynamics.view.rover_picture import RoverComparison, rover_table, write_rover_picture
from m4_dynamics.view.tables import make_console, print_tables


def compare(robot: Robot, slope: float, friction: float, speed: float, posture: str) -> RoverComparison:
    """Drive as a rover, and climb on two wheels, on the same ground."""
    settings = RoverSettings(
        slope=slope, friction_static=friction, speed=speed, duration=3.0 / speed, posture=posture
    )  # fmt: skip
    climb = run_climb(robot, ClimbSettings(slope=slope, friction_static=friction, duration=8.0))
    return RoverComparison(slope, friction, speed, drive_rover(robot, settings), climb)


def main() -> None:
    """Drive, climb, print and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--slopes", type=float, nargs="+", default=[15.0, 30.0, 45.0], metavar="DEG")
    parser.add_argument("--frictions", type=float, nargs="+", default=[0.8, 1.2], metavar="MU")
    parser.add_argument("--speeds", type=float, nargs="+", default=[0.3, 0.1], metavar="M/S", help="of the rover")
    parser.add_argument("--posture", default="ugv", help="in which the rover drives (default: ugv)")
    parser.add_argument("--robot", type=Path, help="the robot's TOML (default: M4)")
    parser.add_argument("--out", type=Path, default=Path("runs/analysis"), help="folder of the picture")
    options = parser.parse_args()
    try:
        robot = load_robot(options.robot)
        make_folder(options.out)
        comparisons = [
            compare(robot, math.radians(slope), friction, speed, options.posture)
            for slope in options.slopes
            for friction in options.frictions
            for speed in options.speeds
        ]
        print_tables(make_console(), [rover_table(comparisons)])
        print(f"wrote {write_rover_picture(comparisons, robot, options.out / 'rover_cannot_climb.png')}")
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")


if __name__ == "__main__":
    main()
