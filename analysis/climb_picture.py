"""Draw a finished run as one picture: the robot at several instants of its climb, with the forces that carry it.

python analysis/climb_picture.py runs/demo climb.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

from m4_dynamics.errors import M4Error
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.simulation.trajectory import load_trajectory
from m4_dynamics.view.composite import write_climb_picture

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of a run, with its trajectory.nc")
    parser.add_argument("picture", type=Path, nargs="?", help="the picture's file (default: climb.png in the folder)")
    parser.add_argument("--robot", type=Path, help="the robot's TOML or URDF (default: M4)")
    parser.add_argument("--poses", type=int, default=5, help="number of instants shown (default: 5)")
    options = parser.parse_args()

    picture = options.picture or options.run / "climb.png"
    try:
        write_climb_picture(load_trajectory(options.run), load_robot(options.robot), picture, poses=options.poses)
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    print(f"wrote {picture}")
