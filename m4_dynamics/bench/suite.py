"""The benchmark: closed loop, control step and simulation step beside their peers, interleaved in one run; static map.

Every contender runs a short burst in turn, round after round, so that a change in the machine's load meets all of them;
what is compared is the median over the rounds, and the ratio to this package's own in the same run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.bench.casadi_mpc import CASADI_CONTENDERS, build_casadi_controller
from m4_dynamics.bench.drake_stepping import build_drake_stepper
from m4_dynamics.bench.mujoco_stepping import build_mujoco_stepper
from m4_dynamics.bench.peers import PeerMissingError
from m4_dynamics.control.mpc.settings import MpcSettings
from m4_dynamics.feasibility.grid import MapGrid
from m4_dynamics.feasibility.postures import posture_case
from m4_dynamics.feasibility.static import static_map
from m4_dynamics.full.model import FullModel
from m4_dynamics.full.standing import standing_configuration
from m4_dynamics.full.stepping import ImplicitStepper
from m4_dynamics.reduced.reduction import reduce_robot
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.climb import ClimbSettings, prepare_climb, run_climb

__all__ = [
    "Contender",
    "MapTimes",
    "Measurement",
    "bench_closed_loop",
    "bench_control_step",
    "bench_simulation_step",
    "bench_static_map",
    "measure",
]

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


class MapTimes(NamedTuple):
    """Times of a static map [s].

    Attributes:
        first: Of the first one of this process, with all that it imports.
        later: Of those after it, shape (rounds,).
    """

    first: float
    later: Array


def bench_static_map(
    robot: Robot, *, rounds: int, side: int = 1000, on_progress: Callable[[float], None] | None = None
) -> MapTimes:
    """Time of a static map over slope and thrust: both branches, all margins, the active limit, power.

    Args:
        robot: A robot that balances.
        rounds: Number of maps after the first.
        side: Slopes, and as many thrusts.
        on_progress: Called with the number of maps done.

    Returns:
        The times, of one thread.
    """
    reduction = reduce_robot(robot)
    thrust_max = reduction.thrust_max
    case = posture_case(robot, reduction)
    grid = MapGrid(
        slope=np.radians(np.linspace(0.0, 85.0, side)),
        # A robot without thrusters has equilibria at no thrust alone; the others cost as much time.
        thrust=np.linspace(0.0, thrust_max if thrust_max > 0.0 else 1.0, side),
        friction=robot.ground.friction_static,
    )
    times = np.zeros(rounds + 1)
    for done in range(rounds + 1):
        started = perf_counter()
        static_map([case], grid)
        times[done] = perf_counter() - started
        if on_progress is not None:
            on_progress(done + 1)
    return MapTimes(float(times[0]), times[1:])


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
