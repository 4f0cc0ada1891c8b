"""Draw states, references and inputs of a whole mission over time, phase by phase (paper, Fig. plot_states B).

python analysis/mission_states.py                        # runs the paper's mission first
python analysis/mission_states.py runs/wair45            # a finished run
python analysis/mission_states.py --mission wair45 --robot my_robot.toml
"""

from __future__ import annotations

from pathlib import Path

import xarray

from m4_dynamics.cli.figure_script import draw_from_run
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.plots import plot_states


def draw(dataset: xarray.Dataset, robot: Robot, folder: Path) -> None:
    """Draw the states."""
    print(f"wrote {plot_states(dataset, folder / 'mission_states.png')}")


if __name__ == "__main__":
    draw_from_run(__doc__, draw, mission="wair15")
