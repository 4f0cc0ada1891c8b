"""Where the wheels come to rest when the robot is not as modelled: with the MPC's disturbance estimate, and without.

The error is that of the true axle position in the last half second. What it keeps with the estimate is what the contact
points creep on the slope: odometry cannot see that.

python analysis/offset_free.py
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from m4_dynamics.control.mpc.controller import MpcController
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.errors import M4Error
from m4_dynamics.reduced.reduction import BalanceFrame, reduce_robot
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import FALL_ANGLE, ClimbSettings, prepare_climb
from m4_dynamics.simulation.plant_errors import PlantErrors
from m4_dynamics.simulation.trajectory import true_motion
from m4_dynamics.view.progress import progress_bar
from m4_dynamics.view.tables import make_console, make_table, print_note, print_tables

COLUMNS = ("plant", "slope [deg]", "without [mm]", "with [mm]", "d_1 [N m]", "d_2 [N m]", "thrust [N]", "reference [N]")


class Rest(NamedTuple):
    """Where a climb ended: wheel error [m], estimate (d_1, d_2) [N m], thrust and its reference [N]."""

    wheel_error: float
    disturbance: tuple[float, float]
    thrust: float
    thrust_reference: float


def plants(frame: BalanceFrame) -> dict[str, PlantErrors]:
    """The errors to look at, those of the centre of mass along the pendulum's axes."""
    forward, up = 0.02 * frame.forward_in_base, 0.02 * frame.up_in_base
    return {
        "as modelled": PlantErrors(),
        "thrust -15 %": PlantErrors(thrust_scale=0.85),
        "mass +10 %": PlantErrors(mass_scale=1.1),
        "mass -10 %": PlantErrors(mass_scale=0.9),
        "CoM 2 cm forward": PlantErrors(com_offset_in_base=tuple(forward)),
        "CoM 2 cm back": PlantErrors(com_offset_in_base=tuple(-forward)),
        "CoM 2 cm up": PlantErrors(com_offset_in_base=tuple(up)),
        "CoM 2 cm down": PlantErrors(com_offset_in_base=tuple(-up)),
        "weak, heavy, CoM back": PlantErrors(
            thrust_scale=0.85, mass_scale=1.1, com_offset_in_base=tuple(-forward)
        ),
    }  # fmt: skip


def rounded(values: Iterable[float]) -> list[float]:
    """Two decimals, and no minus before a zero."""
    return [round(value, 2) + 0.0 for value in values]


def climb(robot: Robot, slope: float, errors: PlantErrors, *, estimate: bool) -> Rest:
    """Climb and stand; NaN if it fell."""
    ready = prepare_climb(robot, ClimbSettings(slope=slope, plant_errors=errors))
    settings = MpcSettings(
        friction_static=robot.ground.friction_static,
        thrust_limits=(0.0, ready.reduction.thrust_max),
        disturbance_rejection=estimate,
    )
    controller = MpcController(ready.reduction.parameters, ready.reference, settings)
    ready.loop.follow(controller, ready.reference)
    for pitch in ready.reference.state[:, 1]:
        ready.loop.advance()
        if abs(ready.loop.estimator.pitch - pitch) > FALL_ANGLE:
            return Rest(math.nan, (math.nan, math.nan), math.nan, float(ready.reference.inputs[-1, 1]))
    recorder, count = ready.recorder, ready.recorder.count
    rows = np.array([0, *range(count - 100, count)])
    motion = true_motion(ready.plant.model, ready.reduction, recorder.configuration[rows], recorder.velocity[rows])
    off = motion.state[1:, 0] - recorder.state_reference[rows[1:], 0]
    found = (0.0, 0.0) if controller.estimator is None else tuple(controller.estimator.estimate.tolist())
    return Rest(
        ready.reduction.parameters.wheel_radius * float(off.mean()),
        found,
        float(recorder.inputs[count - 1, 1]),
        float(ready.reference.inputs[-1, 1]),
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", type=Path, help="the robot's TOML (default: M4)")
    parser.add_argument("--slopes", type=float, nargs="+", default=[15.0, 30.0, 45.0], help="inclinations [deg]")
    parser.add_argument("--plants", nargs="+", help="rows to compute, by name (default: all)")
    options = parser.parse_args()

    try:
        robot = load_robot(options.robot)
        known = plants(reduce_robot(robot).frame)
        for name in options.plants or ():
            if name not in known:
                parser.error(f"unknown plant '{name}'; valid: {', '.join(known)}")
        chosen = options.plants or list(known)
        jobs = [(name, slope) for name in chosen for slope in options.slopes]
        table = []
        with progress_bar("climbs", len(jobs), unit="pairs") as advance:
            for done, (name, slope) in enumerate(jobs, start=1):
                without, rest = (climb(robot, math.radians(slope), known[name], estimate=on) for on in (False, True))
                ends = (1e3 * without.wheel_error, 1e3 * rest.wheel_error)
                table.append((name, slope, *rounded((*ends, *rest.disturbance, rest.thrust, rest.thrust_reference))))
                if advance is not None:
                    advance(done)
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    console = make_console()
    print_tables(console, [make_table("Steady wheel error (true axle position)", COLUMNS, table)])
    print_note(
        console, "with and without the MPC's disturbance estimate; d is what it found, thrust what it then asks for"
    )
