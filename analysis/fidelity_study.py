"""What each imperfection of a real robot does to the climb: every switch alone, then all together.

Figures are the worst over both signs of the first initial pitch error and over a few seeds where there is noise. The
last column goes on to larger errors until one side no longer climbs.

python analysis/fidelity_study.py --slope 45 --out runs/analysis
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from m4_dynamics.control.imu import ImuErrors
from m4_dynamics.errors import M4Error
from m4_dynamics.simulation.batch import run_climbs
from m4_dynamics.simulation.battery import Battery
from m4_dynamics.simulation.climb import ClimbSettings
from m4_dynamics.simulation.fidelity import Fidelity
from m4_dynamics.simulation.verdict import ClimbSummary
from m4_dynamics.view.style import COLOURS, dress_axes, new_figure, save_figure, title_figure
from m4_dynamics.view.tables import make_console, make_table, print_note, print_tables

REALISTIC = Fidelity.realistic()
PLANTS: dict[str, Fidelity] = {
    "ideal": Fidelity.ideal(),
    "rotor lag": Fidelity(rotor_time_constant=REALISTIC.rotor_time_constant),
    "servo speed limits": Fidelity(servo_speed_limit=True),
    "motor limits": Fidelity(motor_limits=True),
    "encoder counts": Fidelity(encoder_counts=REALISTIC.encoder_counts),
    "IMU noise and offsets": Fidelity(imu=ImuErrors()),
    "attitude estimated": Fidelity(attitude_estimated=True),
    "all three sensors": Fidelity(imu=ImuErrors(), attitude_estimated=True, encoder_counts=REALISTIC.encoder_counts),
    "control delay": Fidelity(control_delay=REALISTIC.control_delay),
    "fresh battery": Fidelity(battery=Battery()),
    "battery at 30 %": Fidelity(battery=Battery(charge=0.3)),
    "all but the rotor lag": replace(REALISTIC, rotor_time_constant=None),
    "everything": REALISTIC,
}
COLUMNS = ("plant", "verdict", "fastest slip [mm/s]", "wheel RMS [cm]", "pitch RMS [deg]", "heading [deg]",
           "friction use", "end speed [mm/s]", "pitch estimate [deg]", "recovers from [deg]")  # fmt: skip


def worst(runs: Sequence[ClimbSummary], figure: str, scale: float = 1.0) -> float | None:
    """The largest of a figure over runs; None if one of them has none."""
    values = [getattr(run, figure) for run in runs]
    return None if any(value is None for value in values) else scale * max(values)


def row(name: str, runs: Sequence[ClimbSummary], recovers: float | None) -> list[object]:
    """One line of the table."""
    verdicts = [run.verdict for run in runs]
    climbed = sum(verdict == "climbed" for verdict in verdicts)
    verdict = "climbed" if climbed == len(runs) else f"{climbed} of {len(runs)} climbed"
    return [
        name,
        verdict,
        worst(runs, "max_slip_speed_m_s", 1e3),
        worst(runs, "wheel_rms_m", 1e2),
        worst(runs, "pitch_rms_deg"),
        worst(runs, "yaw_max_deg"),
        worst(runs, "max_friction_use_along_slope"),
        worst(runs, "end_speed_m_s", 1e3),
        worst(runs, "pitch_estimate_rms_deg"),
        recovers,
    ]


def draw(rows: Sequence[Sequence[object]], conditions: str, path: Path) -> Path:
    """The three figures that tell most, one dot for each plant."""
    names = [str(line[0]) for line in rows]
    figure = new_figure(width=11.0, height=0.6 + 0.34 * (len(names) + 3))
    title_figure(figure, "What each imperfection does to the climb", conditions)
    panels = figure.subplots(1, 3, sharey=True)
    titles = ("Wheel position", "Pitch", "Friction use along the slope")
    labels = ("RMS error [cm]", "RMS error [°]", "share of μₛ")
    for axes, column, title, label in zip(panels, (3, 4, 6), titles, labels, strict=True):
        values = [float(line[column]) if line[column] is not None else math.nan for line in rows]  # type: ignore[arg-type]
        for place, value in enumerate(values):
            alone = names[place] in ("ideal", "everything")
            axes.plot(value, place, "o", color=COLOURS["vermilion" if alone else "blue"], markersize=6)
        axes.axvline(values[0], color=COLOURS["slate"], linestyle=":", linewidth=1.0)
        dress_axes(axes, title=title, ylabel="", xlabel=label)
        if column != 6:
            finite = [value for value in values if value > 0.0]
            axes.set_xscale("log")
            axes.set_xlim(10.0 ** math.floor(math.log10(min(finite))), 10.0 ** math.ceil(math.log10(max(finite))))
            axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
            axes.xaxis.set_minor_formatter(lambda value, _: "")
    panels[2].axvline(1.0, color=COLOURS["slate"], linestyle=(0, (1, 1.6)), linewidth=1.3)
    panels[0].set_yticks(range(len(names)), names)
    panels[0].invert_yaxis()
    return save_figure(figure, path)


def main() -> None:
    """Climb, print and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--slope", type=float, default=45.0, metavar="DEG", help="inclination (default: 45)")
    parser.add_argument("--robot", type=Path, help="the robot's TOML description (default: M4)")
    parser.add_argument("--seeds", type=int, default=3, metavar="N", help="runs of a noisy plant (default: 3)")
    parser.add_argument(
        "--errors", nargs="+", type=float, default=[5.0, 8.0, 10.0, 12.0], metavar="DEG",
        help="initial pitch errors, rising, each tried both ways (default: 5 8 10 12)",
    )  # fmt: skip
    parser.add_argument("--workers", type=int, metavar="N", help="processes (default: one for each processor)")
    parser.add_argument("--plants", nargs="+", metavar="NAME", choices=PLANTS, default=list(PLANTS), help="only these")
    parser.add_argument("--out", type=Path, default=Path("runs/analysis"), help="folder of the picture")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)

    cases = []
    for name in options.plants:
        seeds = 1 if PLANTS[name].imu is None else options.seeds
        first, *harder = options.errors
        cases += [(name, sign * first, seed) for seed in range(seeds) for sign in (1.0, -1.0)]
        cases += [(name, sign * error, 0) for error in harder for sign in (1.0, -1.0)]
    settings = [
        ClimbSettings(
            slope=math.radians(options.slope),
            pitch_error=math.radians(error),
            fidelity=replace(PLANTS[name], seed=seed),
        )
        for name, error, seed in cases
    ]
    try:
        summaries = run_climbs(settings, description=options.robot, workers=options.workers)
    except M4Error as problem:
        parser.exit(2, f"{parser.prog}: {problem}\n")

    rows = []
    for name in options.plants:
        mine = [(error, run) for (plant, error, _), run in zip(cases, summaries, strict=True) if plant == name]
        recovers: float | None = None
        for size in options.errors:
            if not all(run.verdict == "climbed" for error, run in mine if abs(error) == size):
                break
            recovers = size
        rows.append(row(name, [run for error, run in mine if abs(error) == options.errors[0]], recovers))
    console = make_console()
    print_tables(console, [make_table(f"Imperfections one by one on {options.slope:g} deg", COLUMNS, rows)])
    conditions = f"slope {options.slope:g}°   ·   initial pitch error ±{options.errors[0]:g}°   ·   worst of all runs"
    print_note(console, f"wrote {draw(rows, conditions, options.out / 'fidelity_study.png')}")


if __name__ == "__main__":
    main()
