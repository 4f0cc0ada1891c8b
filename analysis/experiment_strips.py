"""Cut strips of pictures from a mission, like the paper's experiments: the transformation and the climb (paper, Figs.
m4_experiment and wair_experiment).

python analysis/experiment_strips.py                     # runs the 45 degree mission first
python analysis/experiment_strips.py runs/landing        # a finished run; it may have something for one strip alone
"""

from __future__ import annotations

from pathlib import Path

import xarray

from m4_dynamics.cli.figure_script import draw_from_run
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.phases import phases_of
from m4_dynamics.view.strips import write_climb_strip, write_transformation_strip


def draw(dataset: xarray.Dataset, robot: Robot, folder: Path) -> None:
    """Draw the strips that the run has something for."""
    if phases_of(dataset):
        print(f"wrote {write_transformation_strip(dataset, robot, folder / 'm4_experiment.png')}")
    if float(dataset.slope.max()) > 0.0:
        print(f"wrote {write_climb_strip(dataset, robot, folder / 'wair_experiment.png')}")


if __name__ == "__main__":
    draw_from_run(__doc__, draw, mission="wair45")
