"""Adaptive refinement against the full grid."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from m4_dynamics.feasibility.grid import MapGrid
from m4_dynamics.feasibility.postures import posture_case
from m4_dynamics.feasibility.refinement import refine_boundary
from m4_dynamics.feasibility.static import best_branch, static_map
from m4_dynamics.reduced.reduction import Reduction
from m4_dynamics.robot.robot import Robot


def neighbours(answer: np.ndarray, **padding) -> np.ndarray:
    """The cells around each, itself and diagonal ones included, shape (9, n, m)."""
    padded = np.pad(answer, 1, **padding)
    n, m = answer.shape
    return np.array([padded[i : i + n, j : j + m] for i in range(3) for j in range(3)])


def boundary_cells(answer: np.ndarray) -> np.ndarray:
    """Cells with a neighbour that differs."""
    return (neighbours(answer, mode="edge") != answer).any(axis=0)


def require_same_boundary(found: np.ndarray, truth: np.ndarray) -> None:
    """Neither boundary has a cell that is more than one cell away from the other, and nothing else is wrong."""
    here, there = boundary_cells(found), boundary_cells(truth)
    assert not (here & ~neighbours(there, constant_values=False).any(axis=0)).any()
    assert not (there & ~neighbours(here, constant_values=False).any(axis=0)).any()
    assert not ((found != truth) & ~there).any()


def oracle(truth: np.ndarray) -> tuple[Callable, list]:
    asked: list[tuple[int, int]] = []

    def evaluate(places):
        asked.extend(places)
        return [bool(truth[place]) for place in places]

    return evaluate, asked


@pytest.fixture(scope="module")
def static_truth(m4: Robot, m4_reduction: Reduction) -> np.ndarray:
    grid = MapGrid(
        slope=np.radians(np.linspace(0.0, 80.0, 81)), thrust=np.linspace(0.0, 43.2, 81), friction=0.8, speed=0.2
    )
    dataset = best_branch(static_map([posture_case(m4, m4_reduction)], grid))
    return dataset["feasible"].squeeze().transpose("slope", "thrust").to_numpy()


def disc(n: int, m: int, radius: float) -> np.ndarray:
    i, j = np.mgrid[0:n, 0:m]
    return (i - 0.55 * n) ** 2 + (j - 0.4 * m) ** 2 < radius**2


@pytest.mark.parametrize("name", ["static", "static-33", "disc", "slanted", "all", "none"])
def test_same_boundary_with_a_quarter_of_the_evaluations(name: str, static_truth: np.ndarray) -> None:
    i, j = np.mgrid[0:70, 0:93]
    truth = {
        "static": static_truth,
        "static-33": static_truth[8:73:2, 8:73:2],
        "disc": disc(90, 77, 21.3),
        "slanted": i + 0.37 * j > 45.0,
        "all": np.ones((33, 20), dtype=bool),
        "none": np.zeros((33, 20), dtype=bool),
    }[name]
    evaluate, asked = oracle(truth)
    refined = refine_boundary(truth.shape, evaluate)
    assert len(asked) == len(set(asked)) == refined.evaluated.sum()
    assert len(asked) <= 0.25 * truth.size
    require_same_boundary(refined.answer, truth)
    assert not ((refined.answer != truth) & refined.evaluated).any()


@pytest.mark.parametrize("seed", range(40))
def test_random_regions_on_33_by_33_cells(seed: int) -> None:
    """A boundary from side to side that winds more slowly than the first blocks are wide, at any angle."""
    rng = np.random.default_rng(seed)
    i, j = np.mgrid[0:33, 0:33] / 32.0 - 0.5
    angle, (offset, phase) = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(-0.25, 0.25, 2)
    along, across = i * math.cos(angle) + j * math.sin(angle), j * math.cos(angle) - i * math.sin(angle)
    truth = across > offset + 0.12 * np.sin(2.0 * math.pi * (along + phase))
    evaluate, asked = oracle(truth)
    plans: list[tuple[int, int]] = []
    refined = refine_boundary(truth.shape, evaluate, on_plan=lambda expected: plans.append((len(asked), expected)))
    assert len(asked) == len(set(asked)) == refined.evaluated.sum()
    assert len(asked) <= 0.25 * truth.size
    require_same_boundary(refined.answer, truth)
    # What it expects to ask is never less than what it has asked, right at the end and nearly so once it has looked.
    assert all(known <= expected <= truth.size for known, expected in plans)
    assert plans[-1] == (len(asked), len(asked))
    assert all(0.7 * len(asked) <= expected <= 1.4 * len(asked) for _, expected in plans[1:])


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (2, 2), (5, 1), (17, 9)])
def test_small_grids(shape: tuple[int, int]) -> None:
    truth = np.add.outer(np.arange(shape[0]), np.arange(shape[1])) > sum(shape) / 3.0
    evaluate, asked = oracle(truth)
    refined = refine_boundary(shape, evaluate)
    assert len(asked) == len(set(asked))
    require_same_boundary(refined.answer, truth)


def test_a_thin_tongue_that_touches_a_block_is_followed() -> None:
    truth = disc(81, 81, 18.0)
    truth[40:43, 50:76] = True
    evaluate, _ = oracle(truth)
    refined = refine_boundary(truth.shape, evaluate)
    require_same_boundary(refined.answer, truth)
    assert math.isclose(float(refined.answer.sum()), float(truth.sum()), rel_tol=0.05)
