"""Draw a whole mission in one picture: the robot at many instants, from four wheels up the slope (paper, Fig.
plot_states A).

python analysis/mission_composite.py                     # runs the paper's mission first
python analysis/mission_composite.py runs/wair45         # a finished run
"""

from __future__ import annotations

from pathlib import Path

import xarray

from m4_dynamics.cli.figure_script import draw_from_run
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.mission_picture import write_mission_picture


def draw(dataset: xarray.Dataset, robot: Robot, folder: Path) -> None:
    """Draw the picture."""
    print(f"wrote {write_mission_picture(dataset, robot, folder / 'mission_composite.png')}")


if __name__ == "__main__":
    draw_from_run(__doc__, draw, mission="wair15")
