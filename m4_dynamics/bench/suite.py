"""The benchmark: closed loop, control step and simulation step, each beside its peers, interleaved in one run.

Every contender runs a short burst in turn, round after round, so that a change in the machine's load meets all of them;
what is compared is the median over the rounds, and the ratio to this package's own in the same run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.bench.casadi_mpc import CASADI_CONTENDERS, build_casadi_controller
from m4_dynamics.bench.drake_stepping import build_drake_stepper
from m4_dynamics.bench.mujoco_stepping import build_mujoco_stepper
from m4_dynamics.bench.peers import PeerMissingError
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.standing import standing_configuration
from m4_dynamics.full.stepping import ImplicitStepper
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import ClimbSettings, prepare_climb, run_climb

__all__ = ["Contender", "Measurement", "bench_closed_loop", "bench_control_step", "bench_simulation_step", "measure"]

Array = NDArray[np.float64]
Burst = Callable[[int], None]


@dataclass(frozen=True, slots=True)
class Contender:
    """Something to be timed.

    Attributes:
        name: What it is.
        burst: Does a number of steps; None if it cannot run here.
        missing: Why not.
    """

    name: str
    burst: Burst | None
    missing: str = ""


@dataclass(frozen=True, slots=True)
class Measurement:
    """What a contender took.

    Attributes:
        name: What it is.
        microseconds: Median over the rounds of the time per step; None if it could not run.
        spread: Half the range between the quartiles, relative to the median.
        ratio: Its time over that of the first contender.
        note: Why it could not run.
    """

    name: str
    microseconds: float | None
    spread: float | None
    ratio: float | None
    note: str = ""


def measure(
    contenders: Iterable[Contender], *, steps: int, rounds: int, on_progress: Callable[[float], None] | None = None
) -> list[Measurement]:
    """Time contenders in turn.

    Args:
        contenders: The first is the one that the others are compared with.
        steps: Steps in a burst.
        rounds: Bursts of each.
        on_progress: Called with the number of rounds done.

    Returns:
        One measurement for each contender, in order.
    """
    entries = list(contenders)
    times: dict[str, list[float]] = {entry.name: [] for entry in entries}
    for entry in entries:
        if entry.burst is not None:
            entry.burst(steps)  # compilation, caches, warm start
    for done in range(rounds):
        for entry in entries:
            if entry.burst is None:
                continue
            started = perf_counter()
            entry.burst(steps)
            times[entry.name].append((perf_counter() - started) / steps)
        if on_progress is not None:
            on_progress(done + 1)
    own = np.median(times[entries[0].name]) if times[entries[0].name] else math.nan
    results = []
    for entry in entries:
        if not times[entry.name]:
            results.append(Measurement(entry.name, None, None, None, entry.missing))
            continue
        lower, median, upper = np.percentile(times[entry.name], [25.0, 50.0, 75.0])
        results.append(
            Measurement(entry.name, 1e6 * float(median), float((upper - lower) / (2.0 * median)), float(median / own))
        )
    return results


def bench_closed_loop(
    robot: Robot, *, slope: float, rounds: int, on_progress: Callable[[float], None] | None = None
) -> Array:
    """Real-time factors of whole climbs at the default settings, recording included.

    Args:
        robot: A robot that balances.
        slope: Inclination [rad].
        rounds: Number of climbs.
        on_progress: Called with the number of climbs done.

    Returns:
        One factor for each climb, shape (rounds,).
    """
    factors = np.zeros(rounds)
    for done in range(rounds):
        summary = run_climb(robot, ClimbSettings(slope=slope)).summary
        factors[done] = math.nan if summary.real_time_factor is None else summary.real_time_factor
        if on_progress is not None:
            on_progress(done + 1)
    return factors


def bench_control_step(
    robot: Robot, *, slope: float, steps: int, rounds: int, on_progress: Callable[[float], None] | None = None
) -> list[Measurement]:
    """Time per control step of the MPC and of CasADi's SQP on the same problem and the same states.

    The states are those of a climb of the full model, replayed to every solver.

    Args:
        robot: A robot that balances.
        slope: Inclination [rad].
        steps: Control steps in a burst.
        rounds: Bursts of each.
        on_progress: Called with the number of rounds done.

    Returns:
        The measurements; this package's own first.
    """
    climb = prepare_climb(robot, ClimbSettings(slope=slope))
    for _ in range(len(climb.reference.time) - 1):
        climb.loop.advance()
    states = climb.recorder.state_estimated[: climb.recorder.count].copy()
    parameters, reference = climb.reduction.parameters, climb.reference
    settings = MpcSettings(
        friction_static=climb.plant.model.ground.friction_static, thrust_limits=(0.0, climb.reduction.thrust_max)
    )

    def replay(control: Callable[[int, Array], Array]) -> Burst:
        position = 0

        def burst(count: int) -> None:
            nonlocal position
            for _ in range(count):
                control(position, states[position])
                position = (position + 1) % len(states)

        return burst

    contenders = [Contender("MPC, one SQP iteration (this package)", replay(climb.controller.control))]
    for name, options in CASADI_CONTENDERS.items():
        try:
            peer = build_casadi_controller(parameters, reference, settings, **options)
        except PeerMissingError as error:
            contenders.append(Contender(name, None, str(error)))
        else:
            contenders.append(Contender(name, replay(peer)))
    return measure(contenders, steps=steps, rounds=rounds, on_progress=on_progress)


def bench_simulation_step(
    robot: Robot, *, steps: int, rounds: int, on_progress: Callable[[float], None] | None = None
) -> list[Measurement]:
    """Time per simulation step of 1 ms of the robot standing on its wheels, beside MuJoCo and Drake.

    Args:
        robot: A robot with wheels.
        steps: Simulation steps in a burst.
        rounds: Bursts of each.
        on_progress: Called with the number of rounds done.

    Returns:
        The measurements; this package's own first.
    """
    stepper = ImplicitStepper(FullModel.build(robot), 1e-3)
    stepper.reset(standing_configuration(robot))
    peers: dict[str, Callable[[], Burst]] = {
        "MuJoCo, loop in Python": lambda: build_mujoco_stepper(robot, loop="python"),
        "MuJoCo, loop in C": lambda: build_mujoco_stepper(robot, loop="c"),
        "Drake, TAMSI": lambda: build_drake_stepper(robot, solver="tamsi"),
        "Drake, SAP": lambda: build_drake_stepper(robot, solver="sap"),
    }
    contenders = [Contender("contact-implicit step (this package)", stepper.step)]
    for name, build in peers.items():
        try:
            contenders.append(Contender(name, build()))
        except PeerMissingError as error:
            contenders.append(Contender(name, None, str(error)))
    return measure(contenders, steps=steps, rounds=rounds, on_progress=on_progress)
