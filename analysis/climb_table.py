"""Climb every slope from both sides of its equilibrium, with the default controller and with the paper's settings.

python analysis/climb_table.py
python analysis/climb_table.py --slopes 45 --pitch-errors 2 --friction 0.7
"""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from m4_dynamics import ClimbSettings, M4Error, load_robot, run_climb
from m4_dynamics.view.tables import cell, make_console, make_table, print_note, print_tables

if TYPE_CHECKING:
    from m4_dynamics.robot.robot import Robot
    from m4_dynamics.simulation.climb import ClimbResult
    from m4_dynamics.simulation.controllers import ControllerName
    from m4_dynamics.simulation.verdict import ClimbSummary

COLUMNS = (
    "slope [deg]", "start [deg]", "verdict", "fastest slip [mm/s]", "slid [mm]", "wheel RMS [mm]", "pitch RMS [deg]",
    "heading [deg]", "force RMS [%]", "cost", "paper's cost", "with the paper's", "real-time factor",
)  # fmt: skip


def climb(
    robot: Robot, slope_deg: float, pitch_error_deg: float, controller: ControllerName, friction: float | None
) -> ClimbResult:
    """One climb."""
    settings = ClimbSettings(
        slope=math.radians(slope_deg),
        pitch_error=math.radians(pitch_error_deg),
        friction_static=friction,
        controller=controller,
    )
    return run_climb(robot, settings)


def row(ours: ClimbSummary, papers: ClimbResult) -> list[object]:
    """A climb with the default controller beside the same climb with the paper's settings."""

    def scaled(value: float | None, factor: float) -> str:
        return cell(None if value is None else float(f"{factor * value:.3g}"))

    outcome = papers.summary.verdict
    if outcome == "fell" and papers.dataset is not None:
        outcome = f"fell after {float(papers.dataset.time[-1]):.1f} s"
    return [
        f"{ours.slope_deg:g}",
        f"{ours.pitch_error_deg:+g}",
        ours.verdict,
        scaled(ours.max_slip_speed_m_s, 1e3),
        scaled(ours.slip_distance_m, 1e3),
        scaled(ours.wheel_rms_m, 1e3),
        scaled(ours.pitch_rms_deg, 1.0),
        scaled(ours.yaw_max_deg, 1.0),
        scaled(ours.ground_force_rms_over_weight, 1e2),
        scaled(ours.steady_cost, 1.0),
        scaled(papers.summary.steady_cost, 1.0),
        outcome,
        cell(None if ours.real_time_factor is None else round(ours.real_time_factor)),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot", nargs="?", help="the robot's TOML (default: M4)")
    parser.add_argument("--slopes", type=float, nargs="+", default=[15.0, 30.0, 45.0, 55.0], help="[deg]")
    parser.add_argument(
        "--pitch-errors", type=float, nargs="+", default=[5.0, -5.0], help="initial, off the trim [deg]"
    )
    parser.add_argument("--friction", type=float, help="mu_s of the ground (default: the robot's, 0.8 for M4)")
    options = parser.parse_args()

    try:
        robot = load_robot(options.robot)
        rows = [
            row(
                climb(robot, slope, error, "default", options.friction).summary,
                climb(robot, slope, error, "paper", options.friction),
            )
            for slope in options.slopes
            for error in options.pitch_errors
        ]
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    friction = robot.ground.friction_static if options.friction is None else options.friction
    console = make_console()
    print_tables(console, [make_table(f"Climbs of {robot.name}, 10 s at 0.3 m/s, mu_s {friction:g}", COLUMNS, rows)])
    for note in (
        "Slip and slid distance: worst wheel, sideways included, after 0.5 s. RMS, heading, force, cost: after 1 s.",
        "Force: ground force of the planar model less the simulated one, in percent of the weight.",
        "Cost: sum of e' Q e over the samples from 1 s to the end or the fall; '-' if it fell before 1 s.",
    ):
        print_note(console, note)
