"""Choose integrator, time step and ground figures: how far each is from small explicit steps, and what it costs.

Four scenarios on the full model of M4: landing on four wheels, driving off up 15 degrees, lying on the skids on 30
degrees, and the closed loop climbing 45 degrees on two wheels. An error is the largest distance of the base from where
the reference has it: explicit steps of a microsecond, or, for the climb, implicit steps of a sixteenth of one
millisecond.

A transition width beyond the depth at which the load is carried leaves the contact almost undamped: at 1e6 N/m and
0.1 mm the climb chatters and falls once the steps are too small to damp it numerically, at 0.01 mm it does not.

python analysis/convergence_study.py --out runs/analysis
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from m4_dynamics.errors import M4Error
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.standing import standing_configuration
from m4_dynamics.full.stepping import ExplicitStepper, ImplicitStepper
from m4_dynamics.full.terrain import incline_terrain
from m4_dynamics.robot.loading import load_robot
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import ClimbSettings, prepare_climb
from m4_dynamics.view.style import COLOURS, dress_axes, new_figure, save_figure, title_figure

STEPS = (5e-3, 2.5e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)  # [s], all within the control period of 5 ms
CHOSEN = 1e-3
EXPLICIT_STEPS = (1e-4, 5e-5, 2e-5, 1e-5, 5e-6)
FINEST = 6.25e-5
SAMPLE = 0.02  # [s]
SCENARIO_COLOURS = {"land": "blue", "drive": "vermilion", "lie": "green", "climb": "purple"}


@dataclasses.dataclass(frozen=True)
class Run:
    """Where the base was, shape (n, 3) [m], and what the steps cost."""

    positions: NDArray[np.float64]
    microseconds: float
    iterations: float
    failures: int

    def error(self, reference: Run) -> float:
        """Largest distance from a reference [mm]; infinite where the integration was lost."""
        apart = np.linalg.norm(self.positions - reference.positions, axis=1)
        return 1e3 * float(apart.max()) if np.isfinite(apart).all() and apart.max() < 1.0 else math.inf


Scenario = Callable[[Robot, float], Run]
#: Rows (step [s], error [mm], cost [microseconds a step]).
Curve = list[tuple[float, float, float]]


def put_down(
    robot: Robot, dt: float, *, explicit: bool = False, posture: str, slope_deg: float, above: float, duty: float
) -> Run:
    """Open loop: 0.2 s from a height above a slope, the wheels at a duty, one of them at a tenth less."""
    slope = math.radians(slope_deg)
    model = FullModel.build(robot, incline_terrain(slope))
    stepper: ImplicitStepper | ExplicitStepper = ExplicitStepper(model, dt) if explicit else ImplicitStepper(model, dt)
    q = standing_configuration(robot, posture)
    turn = pin.rpy.rpyToMatrix(0.0, -slope, 0.0)
    q[:7] = pin.SE3ToXYZQUAT(pin.SE3(turn, turn @ (0.0, 0.0, q[2] + above)))
    stepper.reset(q)
    stepper.actuation.wheel_duty[:] = duty * np.array([1.0, 0.9, 1.0, 1.0])
    positions, started = [], time.perf_counter()
    for _ in range(round(0.2 / SAMPLE)):
        stepper.step(round(SAMPLE / dt))
        positions.append(stepper.configuration[:3].copy())
    cost = 1e6 * (time.perf_counter() - started) / round(0.2 / dt)
    if isinstance(stepper, ExplicitStepper):
        return Run(np.array(positions), cost, 0.0, 0)
    counters = stepper.counters
    return Run(np.array(positions), cost, counters.newton_iterations / counters.steps, counters.newton_failures)


def climb(robot: Robot, dt: float) -> Run:
    """Closed loop: 6 s on 45 degrees with the default controller, from 5 deg of pitch and 0.5 deg of yaw error."""
    prepared = prepare_climb(robot, ClimbSettings(slope=math.radians(45.0), duration=6.0, time_step=dt))
    positions, started = [], time.perf_counter()
    for _ in prepared.reference.time:
        prepared.loop.advance()
        positions.append(prepared.plant.configuration[:3].copy())
    counters = prepared.plant.stepper.counters
    cost = 1e6 * (time.perf_counter() - started) / counters.steps
    return Run(np.array(positions), cost, counters.newton_iterations / counters.steps, counters.newton_failures)


OPEN_LOOP = {
    "land": partial(put_down, posture="ugv", slope_deg=0.0, above=0.02, duty=0.0),
    "drive": partial(put_down, posture="ugv", slope_deg=15.0, above=-1e-4, duty=0.5),
    "lie": partial(put_down, posture="uas", slope_deg=30.0, above=-1e-4, duty=0.0),
}


#: What else the ground might be.
GROUNDS: dict[str, dict[str, float]] = {
    "as described": {},
    "stiffness 3e4 N/m": {"stiffness": 3e4},
    "stiffness 1e6 N/m": {"stiffness": 1e6},
    "the same, width 1e-5 m": {"stiffness": 1e6, "transition_width": 1e-5},
    "stiction speed 1e-3 m/s": {"stiction_speed": 1e-3},
    "stiction speed 1e-5 m/s": {"stiction_speed": 1e-5},
}


def study_steps(robot: Robot, reference_step: float, console: Console) -> dict[str, dict[str, Curve]]:
    """Error and cost against the step, by integrator and scenario; prints the table."""
    scenarios: dict[str, Scenario] = {**OPEN_LOOP, "climb": climb}
    references = {name: run(robot, reference_step, explicit=True) for name, run in OPEN_LOOP.items()}
    references["climb"] = climb(robot, FINEST)
    # How far the base goes; lying on the skids it hardly moves, so a part of its way says nothing.
    ways = {name: 1e3 * float(np.ptp(references[name].positions, axis=0).max()) for name in scenarios if name != "lie"}
    headings = ("integrator", "step / ms", *(f"{name} / mm" for name in scenarios), "halved / %", "Newton / step",
                "failures", "µs / step")  # fmt: skip
    table = start_table(f"Error of the base (reference: explicit steps of {1e6 * reference_step:g} µs)", headings)
    curves: dict[str, dict[str, Curve]] = {kind: {name: [] for name in scenarios} for kind in ("implicit", "explicit")}
    for dt, finer in zip(STEPS, (*STEPS[1:], FINEST), strict=True):
        # The cheapest of three, as the machine has other work.
        runs = {
            name: min((run(robot, dt) for _ in range(3)), key=lambda one: one.microseconds)
            for name, run in scenarios.items()
        }
        for name, run in runs.items():
            curves["implicit"][name].append((dt, run.error(references[name]), run.microseconds))
        halved = max(100.0 * runs[name].error(scenarios[name](robot, finer)) / way for name, way in ways.items())
        table.add_row(
            "implicit", f"{1e3 * dt:g}", *(in_words(run.error(references[name])) for name, run in runs.items()),
            f"{halved:.2f}", f"{np.mean([run.iterations for run in runs.values()]):.2f}",
            str(sum(run.failures for run in runs.values())),
            f"{min(runs[name].microseconds for name in OPEN_LOOP):.1f}",
            style="bold" if dt == CHOSEN else "",
        )  # fmt: skip
    for dt in EXPLICIT_STEPS:
        explicit = {name: run(robot, dt, explicit=True) for name, run in OPEN_LOOP.items()}
        for name, run in explicit.items():
            curves["explicit"][name].append((dt, run.error(references[name]), run.microseconds))
        cost = min(run.microseconds for run in explicit.values())
        shown = [in_words(run.error(references[name])) for name, run in explicit.items()]
        table.add_row("explicit", f"{1e3 * dt:g}", *shown, "", "", "", "", f"{cost:.1f}")
    console.print(table)
    return curves


def study_ground(robot: Robot, console: Console) -> dict[str, Curve]:
    """Error of the climb against the step for other ground figures, each against its own finest step."""
    headings = ("ground", "error of the climb / mm", "climb differs / mm", "Newton / step", "failures", "sinks / mm",
                "creeps in 10 s / mm")  # fmt: skip
    table = start_table(f"Other figures of the ground, steps of {1e3 * CHOSEN:g} ms", headings)
    curves: dict[str, Curve] = {}
    described = climb(robot, FINEST)
    for name, changes in GROUNDS.items():
        other = dataclasses.replace(robot, ground=dataclasses.replace(robot.ground, **changes))
        finest = climb(other, FINEST)
        runs = {dt: climb(other, dt) for dt in STEPS}
        curves[name] = [(dt, run.error(finest), run.microseconds) for dt, run in runs.items()]
        lying = OPEN_LOOP["lie"](other, CHOSEN).positions
        creep = 1e3 * float(np.linalg.norm(lying[-1] - lying[-2])) / SAMPLE * 10.0
        sinking = 1e3 * robot.mass * robot.gravity / 4.0 / other.ground.stiffness
        chosen = runs[CHOSEN]
        table.add_row(
            name, in_words(chosen.error(finest)), in_words(finest.error(described)), f"{chosen.iterations:.2f}",
            str(chosen.failures), f"{sinking:.2g}", f"{creep:.2g}",
        )  # fmt: skip
    console.print(table)
    return curves


def start_table(title: str, headings: tuple[str, ...]) -> Table:
    """A table of right-aligned figures."""
    table = Table(title=title)
    for heading in headings:
        table.add_column(heading, justify="right")
    return table


def in_words(error: float) -> str:
    """An error for the table."""
    return f"{error:.2g}" if math.isfinite(error) else "lost"


def draw(steps: dict[str, dict[str, Curve]], ground: dict[str, Curve], path: Path) -> Path:
    """Error against the step and against the time that computing takes; error of the climb on other grounds."""
    figure = new_figure(width=14.0, height=4.8)
    title_figure(
        figure,
        "Where steps of a given size take the robot",
        "largest distance of the base from the reference; dotted: the chosen step; thin line: first order",
    )
    by_step, by_cost, by_ground = figure.subplots(1, 3)
    for kind, style in (("implicit", "o-"), ("explicit", "x--")):
        for name, curve in steps[kind].items():
            if curve:
                dt, error, cost = np.array(curve).T
                colour = COLOURS[SCENARIO_COLOURS[name]]
                by_step.loglog(dt, error, style, color=colour, label=f"{name}, {kind}")
                if name in OPEN_LOOP:
                    by_cost.loglog(1e-6 * cost / dt, error, style, color=colour, label=f"{name}, {kind}")
    # Grounds that make no difference lie on one line: markers of falling size keep all in sight.
    for index, (name, curve) in enumerate(ground.items()):
        dt, error, _ = np.array(curve).T
        colour = COLOURS[("ink", "blue", "vermilion", "green", "orange", "purple")[index]]
        by_ground.loglog(dt, error, "o-", color=colour, label=name, markersize=12.0 - 1.8 * index, fillstyle="none")
    for axes in (by_step, by_ground):
        axes.axvline(CHOSEN, color=COLOURS["slate"], linestyle=":")
        axes.loglog((2e-4, 5e-3), (2e-2, 0.5), color=COLOURS["slate"], linewidth=0.7)
    dress_axes(by_step, title="Integrators", ylabel="error [mm]", xlabel="time step [s]")
    dress_axes(by_cost, title="What it costs", ylabel="error [mm]", xlabel="computing time / simulated time")
    dress_axes(by_ground, title="Climb on other grounds", ylabel="error [mm]", xlabel="time step [s]")
    for axes in (by_step, by_cost, by_ground):
        axes.xaxis.set_minor_formatter(NullFormatter())
        if axes is not by_cost:  # has the colours of the first panel
            axes.legend(fontsize=8)
    return save_figure(figure, path)


def main() -> None:
    """Run, print and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("runs/analysis"), help="folder of the picture")
    parser.add_argument("--robot", type=Path, help="the robot's TOML or URDF (default: M4)")
    parser.add_argument("--reference-step", type=float, default=1e-6, metavar="S", help="default: 1e-6")
    options = parser.parse_args()
    console = Console()
    try:
        robot = load_robot(options.robot)
        with console.status("a minute of small steps"):
            steps = study_steps(robot, options.reference_step, console)
            ground = study_ground(robot, console)
        options.out.mkdir(parents=True, exist_ok=True)
        console.print(f"wrote {draw(steps, ground, options.out / 'convergence_study.png')}")
    except M4Error as error:
        parser.exit(2, f"{parser.prog}: {error}\n")


if __name__ == "__main__":
    main()
