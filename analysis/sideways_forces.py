"""How the drive wheels press against each other sideways while they roll, and on which slopes they do.

A wheel whose contact point lies ahead of its leg's steering axis (the hip-frontal joint of M4) has negative trail: the
leg's servo, a spring, lets it toe in until the friction sideways is used up. Ahead of the axle the contact point is by
r sin(pitch + slope).

python analysis/sideways_forces.py
python analysis/sideways_forces.py --servo-stiffness 4000
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from m4_dynamics import ClimbSettings, M4Error, load_robot, run_climb
from m4_dynamics.view.tables import make_console, make_table, print_note, print_tables

if TYPE_CHECKING:
    from m4_dynamics.robot.robot import Robot


def row(robot: Robot, slope_deg: float, thrust: float | None) -> list[object]:
    """Figures of one climb at constant speed, from the middle half of the cruise."""
    result = run_climb(robot, ClimbSettings(slope=math.radians(slope_deg), thrust=thrust))
    if result.dataset is None:
        raise M4Error(result.summary.reason)
    data = result.dataset.sel(wheel=list(result.dataset.attrs["drive_wheels"]))
    rate = data.state_reference.sel(reduced_state="wheel_rate").to_numpy()
    cruise = np.flatnonzero(rate > 0.999 * rate.max())
    cruise = cruise[len(cruise) // 4 : -len(cruise) // 4]
    friction, radius = float(data.attrs["friction_static"]), float(data.attrs["wheel_radius_m"])
    slope = math.radians(slope_deg)
    force = data.contact_force_in_world.to_numpy()[cruise]
    along = force[..., 0] * math.cos(slope) + force[..., 2] * math.sin(slope)
    normal = force[..., 2] * math.cos(slope) - force[..., 0] * math.sin(slope)
    pitch = float(data.state.sel(reduced_state="pitch").to_numpy()[cruise].mean())
    slip = 1e3 * data.slip_speed.to_numpy()[cruise]
    return [
        f"{slope_deg:g}",
        f"{math.degrees(pitch):.1f}",
        f"{1e3 * radius * math.sin(pitch + slope):.0f}",
        f"{np.abs(along / normal).max() / friction:.2f}",
        f"{np.abs(force[..., 1] / normal).max() / friction:.2f}",
        f"{np.hypot(along, force[..., 1]).max():.1f}",
        f"{np.abs(force[..., 1]).max():.1f}",
        f"{slip.min():.2f} to {slip.max():.2f}",
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slopes", type=float, nargs="+", default=[15.0, 30.0, 45.0, 55.0], help="[deg]")
    parser.add_argument("--thrust", type=float, help="of the trim [N] (default: chosen inside all limits)")
    parser.add_argument("--servo-stiffness", type=float, help="of every servo [N m/rad] (default: the robot's)")
    options = parser.parse_args()

    try:
        robot = load_robot()
        if options.servo_stiffness is not None:
            stiffer = tuple(dataclasses.replace(s, stiffness=options.servo_stiffness) for s in robot.servos)
            robot = dataclasses.replace(robot, servos=stiffer)
        rows = [row(robot, slope, options.thrust) for slope in options.slopes]
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    columns = (
        "slope [deg]", "pitch [deg]", "contact ahead of axle [mm]", "use along slope", "use sideways",
        "friction per wheel [N]", "sideways [N]", "slip [mm/s]",
    )  # fmt: skip
    console = make_console()
    print_tables(console, [make_table(f"Friction of {robot.name} while cruising at 0.3 m/s", columns, rows)])
    print_note(
        console, "Use: share of mu_s times the normal force, worst wheel. Slip: least and greatest, both wheels."
    )
