"""Rollouts where they pay: on the boundary of what is feasible, and coarsely elsewhere."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Refined", "refine_boundary"]

_Bool = NDArray[np.bool_]
_Place = tuple[int, int]
#: First and last row, first and last column.
_Block = tuple[int, int, int, int]


class Refined(NamedTuple):
    """A yes-or-no map found with few evaluations.

    Attributes:
        answer: Yes or no in every cell, evaluated or concluded from its surroundings, shape (n, m).
        evaluated: Cells that were evaluated, shape (n, m).
    """

    answer: _Bool
    evaluated: _Bool


def refine_boundary(
    shape: tuple[int, int],
    evaluate: Callable[[Sequence[_Place]], Sequence[bool]],
    *,
    coarse: int = 8,
    on_plan: Callable[[int], None] | None = None,
) -> Refined:
    """Find where the answer changes on a grid, cell by cell, without asking in every cell.

    The grid is cut into blocks, whose corners are evaluated. A block whose corners, or whose cells evaluated for a
    neighbour, differ is cut into four, down to single cells; only a cell halfway between two next to it that agree is
    taken to be as they are. What a block encloses is taken to be as its corners are: an island smaller than the first
    blocks, with no corner inside, is missed.

    Args:
        shape: Cells on the two axes.
        evaluate: Takes places that were not asked for before, all at once, and gives their answers.
        coarse: Cells along a side of the first blocks.
        on_plan: Called before each round with the number of evaluations expected in all.

    Returns:
        The map.
    """
    answer = np.zeros(shape, dtype=bool)
    evaluated = np.zeros(shape, dtype=bool)

    def ask(places: set[_Place]) -> None:
        new = sorted(place for place in places if not evaluated[place])
        if new:
            for place, value in zip(new, evaluate(new), strict=True):
                answer[place], evaluated[place] = value, True

    def tell(blocks: Sequence[_Block], known: int) -> None:
        if on_plan is not None:
            on_plan(min(known + round(sum(_expected(block) for block in blocks)), answer.size))

    rows, columns = (_cuts(count, coarse) for count in shape)
    leaves = [(i0, i1, j0, j1) for i0, i1 in rows for j0, j1 in columns]
    # Before anything is known: a boundary from one side of the grid to the other.
    tell(leaves[: max(len(rows), len(columns))], (len(rows) + 1) * (len(columns) + 1))
    ask(_corners(leaves))
    small: list[_Block] = []
    while True:
        mixed = [block for block in leaves if _divisible(block) and _mixed(block, answer, evaluated)]
        tell(mixed, int(evaluated.sum()))
        if not mixed:
            break
        cut = set(mixed)
        last = [block for block in mixed if _side(block) == 2]
        parts = [part for block in mixed if _side(block) > 2 for part in _quarters(block)]
        leaves = [block for block in leaves if block not in cut] + parts
        small += last
        ask(_corners(parts) | {place for block in last for place in _undecided(block, answer)})
    for i0, i1, j0, j1 in leaves:
        inside = (slice(i0, i1 + 1), slice(j0, j1 + 1))
        answer[inside] = np.where(evaluated[inside], answer[inside], answer[i0, j0])
    for block in small:
        for middle, (end, _) in _middles(block):
            if not evaluated[middle]:
                answer[middle] = answer[end]
    return Refined(answer, evaluated)


def _cuts(count: int, coarse: int) -> list[tuple[int, int]]:
    """First and last cell of each block along an axis; neighbours share a cell."""
    edges = [*range(0, count - 1, coarse), count - 1]
    return list(itertools.pairwise(edges)) if len(edges) > 1 else [(0, 0)]


def _expected(block: _Block) -> float:
    """Evaluations that a block takes through which the boundary passes once, from experience."""
    return 3.0 * _side(block) - 3.5


def _side(block: _Block) -> int:
    """Cells along the longer side, less one: what is left to be decided is inside."""
    i0, i1, j0, j1 = block
    return max(i1 - i0, j1 - j0)


def _corners(blocks: Sequence[_Block]) -> set[_Place]:
    return {(i, j) for i0, i1, j0, j1 in blocks for i in (i0, i1) for j in (j0, j1)}


def _middles(block: _Block) -> list[tuple[_Place, tuple[_Place, _Place]]]:
    """Cells halfway along the edges of a block of side 2, each with the two corners that it lies between."""
    i0, i1, j0, j1 = block
    found: list[tuple[_Place, tuple[_Place, _Place]]] = []
    if i1 - i0 == 2:
        found += [((i0 + 1, j), ((i0, j), (i1, j))) for j in (j0, j1)]
    if j1 - j0 == 2:
        found += [((i, j0 + 1), ((i, j0), (i, j1))) for i in (i0, i1)]
    return found


def _undecided(block: _Block, answer: _Bool) -> list[_Place]:
    """Cells of a block of side 2 that its corners do not decide: between two that differ, and in its middle."""
    i0, i1, j0, j1 = block
    places = [middle for middle, (one, other) in _middles(block) if answer[one] != answer[other]]
    return [*places, (i0 + 1, j0 + 1)] if i1 - i0 == j1 - j0 == 2 else places


def _divisible(block: _Block) -> bool:
    return _side(block) > 1


def _mixed(block: _Block, answer: _Bool, evaluated: _Bool) -> bool:
    i0, i1, j0, j1 = block
    inside = (slice(i0, i1 + 1), slice(j0, j1 + 1))
    known = answer[inside][evaluated[inside]]
    return bool(known.any() and not known.all())


def _quarters(block: _Block) -> list[_Block]:
    i0, i1, j0, j1 = block
    rows, columns = (
        [(low, (low + high) // 2), ((low + high) // 2, high)] if high - low > 1 else [(low, high)]
        for low, high in ((i0, i1), (j0, j1))
    )
    return [(*row, *column) for row in rows for column in columns]
