"""Show what the paper's ground-force equations do near their singular pitch, beside Newton's law for the whole robot.

The paper solves four equations A_c z = b_c for the forces in the axle and on the ground. A_c is singular where the CoM
lies on the slope normal through the axle. With two slips corrected the system is consistent there: only rounding is
lost, and averaging over a small pitch step bridges it. As printed, the missing wheel weight and the thrust's arm are
divided by the CoM's distance from that normal, so the normal force is wrong everywhere and diverges at the singular
pitch, which lies in the middle of the pitches that a steep climb uses.

python analysis/ground_force_singularity.py --slope 45 --out runs/analysis
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from m4_dynamics.errors import M4Error
from m4_dynamics.reduced.ground_force import (
    ground_force_constraint_system,
    ground_force_in_slope,
    ground_force_paper_uncorrected,
    singular_pitch,
)
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.reduction import reduce_robot
from m4_dynamics.reduced.trim import trim_at_pitch
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.view.style import COLOURS, dress_axes, new_figure, save_figure, title_figure

DISTANCES = np.logspace(-13, -1, 241)  # from the singular pitch [rad]
AVERAGING_STEPS = {
    0.0: ("ink", "no averaging"),
    1e-2: ("orange", "averaging 0.01 rad"),
    1e-3: ("blue", "averaging 0.001 rad"),
}


def corrected_error(parameters: MipParameters, slope: float, distance: float, averaging_step: float) -> float:
    """Error of the corrected system against Newton's law, over the weight, while climbing and pitching."""
    state = np.array([0.0, singular_pitch(parameters, slope) + distance, 2.0, 0.8])
    inputs = np.array([0.6, 15.0])
    try:
        force = ground_force_constraint_system(parameters, slope, state, inputs, averaging_step=averaging_step)
    except M4Error:
        return math.nan  # exactly singular in floating point
    return float(np.linalg.norm(force - ground_force_in_slope(parameters, slope, state, inputs))) / parameters.weight


def main() -> None:
    """Compute, draw and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--slope", type=float, default=45.0, metavar="DEG", help="inclination (default: 45)")
    parser.add_argument("--out", type=Path, default=Path("runs/analysis"), help="folder of the picture")
    options = parser.parse_args()
    slope = math.radians(options.slope)
    parameters = reduce_robot(load_robot()).parameters
    singular = singular_pitch(parameters, slope)

    # Rounding and averaging near the singular pitch.
    errors = {
        step: np.array([corrected_error(parameters, slope, float(d), step) for d in DISTANCES])
        for step in AVERAGING_STEPS
    }

    # Forces at the equilibria of the slope, which cross the singular pitch.
    pitches = np.linspace(singular - math.radians(12.0), singular + math.radians(58.0), 701)
    trims = [trim_at_pitch(parameters, slope, float(pitch)) for pitch in pitches]
    newton = np.array([ground_force_in_slope(parameters, slope, t.state, t.inputs) for t in trims])
    printed = np.full_like(newton, math.nan)
    for row, trim in zip(printed, trims, strict=True):
        if abs(trim.pitch - singular) > math.radians(0.15):  # leaves a gap, so that the arms of the pole are not joined
            row[:] = ground_force_paper_uncorrected(parameters, slope, trim.state, trim.inputs)
    friction_needed = np.abs(newton[:, 0]) / newton[:, 1]
    friction_printed = np.where(printed[:, 1] > 0.0, np.abs(printed[:, 0]) / printed[:, 1], math.nan)

    figure = new_figure(width=12.0, height=4.6)
    near, normal, friction = figure.subplots(1, 3)
    title_figure(
        figure,
        f"Ground force around the singular pitch of {math.degrees(singular):.1f}° on a slope of {options.slope:g}°",
        "Newton's law for the whole robot against the paper's four equations, corrected and as printed",
    )
    for step, (colour, name) in AVERAGING_STEPS.items():
        near.loglog(DISTANCES, np.maximum(errors[step], 1e-17), color=COLOURS[colour], label=name)
    near.set_ylim(1e-17, 1e2)
    distance_label = "distance from the singular pitch [rad]"
    dress_axes(near, title="Corrected equations against Newton", ylabel="error / weight", xlabel=distance_label)
    near.legend(loc="upper right", fontsize=8)

    degrees = np.degrees(pitches)
    for axes, right, wrong in (
        (normal, newton[:, 1] / parameters.weight, printed[:, 1] / parameters.weight),
        (friction, friction_needed, friction_printed),
    ):
        axes.plot(degrees, right, color=COLOURS["blue"], label="Newton, and corrected")
        axes.plot(degrees, wrong, color=COLOURS["vermilion"], dashes=(4, 2), label="as printed")
        axes.axvline(math.degrees(singular), color=COLOURS["slate"], linestyle=":", linewidth=1.0)
    normal.set_ylim(-1.5, 2.5)
    friction.set_ylim(0.0, 2.0)
    pitch_label = "pitch of the equilibrium [°]"
    dress_axes(normal, title="Normal force at the equilibria", ylabel="normal force / weight", xlabel=pitch_label)
    dress_axes(friction, title="Friction needed at the equilibria", ylabel="|f_x| / f_n", xlabel=pitch_label)
    normal.legend(loc="lower right", fontsize=8)
    friction.legend(loc="upper right", fontsize=8)
    options.out.mkdir(parents=True, exist_ok=True)
    picture = save_figure(figure, options.out / "ground_force_singularity.png")

    print(f"singular pitch on {options.slope:g} deg: {math.degrees(singular):.2f} deg")
    for step, (_, name) in AVERAGING_STEPS.items():
        worst = float(np.nanmax(errors[step]))
        print(f"corrected, {name:>19}: error up to {worst:.1e} of the weight, from {DISTANCES[0]:.0e} rad on")
    print("pitch [deg]  thrust [N]  f_n Newton [N]  f_n printed [N]  friction needed  as printed")
    for index in range(0, len(pitches), 100):
        print(
            f"{degrees[index]:11.1f}  {trims[index].thrust:10.1f}  {newton[index, 1]:14.1f}  {printed[index, 1]:15.1f}"
            f"  {friction_needed[index]:15.2f}  {friction_printed[index]:10.2f}"
        )
    print(f"wrote {picture}")


if __name__ == "__main__":
    main()
