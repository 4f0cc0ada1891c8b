"""How often M4 climbs when it is not the robot that its controller believes: mass, CoM, thrust, grip, noise, start.

python analysis/robustness.py --runs 200 --workers 2
"""

from __future__ import annotations

import argparse
import math
import os
from collections import Counter
from pathlib import Path

import numpy as np

from m4_dynamics.control.imu import ImuErrors
from m4_dynamics.errors import M4Error
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.simulation.climb import ClimbSettings
from m4_dynamics.simulation.fidelity import Fidelity
from m4_dynamics.simulation.robustness import Spread, draw_cases, run_cases
from m4_dynamics.view.progress import progress_bar
from m4_dynamics.view.tables import make_console, make_table, print_tables

SENSORS = Fidelity(imu=ImuErrors(), encoder_counts=4096, attitude_estimated=True)

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", type=Path, help="the robot's TOML (default: M4)")
    parser.add_argument("--slope", type=float, default=45.0, help="inclination [deg] (default: 45)")
    parser.add_argument("--runs", type=int, default=200, help="number of climbs (default: 200)")
    parser.add_argument("--seed", type=int, default=1, help="of the whole table (default: 1)")
    parser.add_argument("--realistic", action="store_true", help="every imperfection, not only those of the sensors")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes (default: one per processor)")
    options = parser.parse_args()

    try:
        spread = Spread()
        nominal = ClimbSettings(
            slope=math.radians(options.slope), fidelity=Fidelity.realistic() if options.realistic else SENSORS
        )
        friction = load_robot(options.robot).ground.friction_static
        cases = draw_cases(nominal, spread, count=options.runs, seed=options.seed, friction_nominal=friction)
        with progress_bar("climbs", len(cases), unit="runs") as advance:
            outcomes = run_cases(cases, robot=options.robot, workers=options.workers, on_progress=advance)
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    causes = Counter(outcome.cause for outcome in outcomes)
    arrived = [outcome for outcome in outcomes if outcome.cause == "climbed"]
    console = make_console()
    title = (
        f"{len(outcomes)} climbs of {options.slope:g} deg: "
        f"mass +-{100 * spread.mass:.0f} %, CoM +-{100 * spread.com:.0f} cm, "
        f"thrust x {spread.thrust_scale:g}, mu_s {spread.friction[0]:g} to {spread.friction[1]:g}, "
        f"pitch +-{math.degrees(spread.pitch_error):.0f} deg, noisy sensors"
    )
    rows = [(cause, count, f"{100 * count / len(outcomes):.1f} %") for cause, count in causes.most_common()]
    figures = []
    if arrived:
        ends = 100.0 * np.array([outcome.wheel_error_at_end for outcome in arrived])
        pitches = np.array([outcome.pitch_rms_deg for outcome in arrived])
        uses = np.array([outcome.friction_use for outcome in arrived])
        figures = [
            ("wheel error at the end [cm]", float(np.median(ends)), float(ends.max())),
            ("pitch RMS [deg]", float(np.median(pitches)), float(pitches.max())),
            ("friction use along the slope", float(np.median(uses)), float(uses.max())),
        ]
    failures = [(o.index, o.cause, o.reason) for o in outcomes if o.cause != "climbed"]
    tables = [make_table(title, ("outcome", "runs", "share"), rows)]
    if figures:
        tables.append(make_table("Those that arrived", ("figure", "median", "worst"), figures))
    if failures:
        tables.append(make_table("Those that did not", ("run", "cause", "what happened"), failures))
    print_tables(console, tables)
