"""Draw a finished run as one picture: the robot at several instants of its climb, with the forces that carry it.

python analysis/climb_picture.py runs/demo climb.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

import xarray

from m4_dynamics.robot.loading import load_robot
from m4_dynamics.view.composite import write_climb_picture

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of a run, with its trajectory.nc")
    parser.add_argument("picture", type=Path, nargs="?", help="the picture's file (default: climb.png in the folder)")
    parser.add_argument("--robot", type=Path, help="the robot's TOML or URDF (default: M4)")
    parser.add_argument("--poses", type=int, default=5, help="number of instants shown (default: 5)")
    options = parser.parse_args()

    trajectory = xarray.load_dataset(options.run / "trajectory.nc", engine="h5netcdf")
    picture = options.picture or options.run / "climb.png"
    write_climb_picture(trajectory, load_robot(options.robot), picture, poses=options.poses)
    print(f"wrote {picture}")
