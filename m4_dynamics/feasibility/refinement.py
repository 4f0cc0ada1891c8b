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
    neighbour, differ is cut into four, down to single cells. What a block encloses is taken to be as its corners are:
    an island smaller than the first blocks, with no corner inside, is missed.

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

    def ask(blocks: Sequence[_Block]) -> None:
        corners = {(i, j) for i0, i1, j0, j1 in blocks for i in (i0, i1) for j in (j0, j1)}
        new = sorted(place for place in corners if not evaluated[place])
        if new:
            for place, value in zip(new, evaluate(new), strict=True):
                answer[place], evaluated[place] = value, True

    def tell(blocks: Sequence[_Block], known: int) -> None:
        if on_plan is not None:
            on_plan(min(known + sum(_expected(block) for block in blocks), answer.size))

    rows, columns = (_cuts(count, coarse) for count in shape)
    leaves = [(i0, i1, j0, j1) for i0, i1 in rows for j0, j1 in columns]
    # Before anything is known: a boundary from one side of the grid to the other.
    tell(leaves[: max(len(rows), len(columns))], (len(rows) + 1) * (len(columns) + 1))
    ask(leaves)
    while True:
        mixed = [block for block in leaves if _divisible(block) and _mixed(block, answer, evaluated)]
        tell(mixed, int(evaluated.sum()))
        if not mixed:
            break
        cut = set(mixed)
        parts = [part for block in mixed for part in _quarters(block)]
        leaves = [block for block in leaves if block not in cut] + parts
        ask(parts)
    for i0, i1, j0, j1 in leaves:
        inside = (slice(i0, i1 + 1), slice(j0, j1 + 1))
        answer[inside] = np.where(evaluated[inside], answer[inside], answer[i0, j0])
    return Refined(answer, evaluated)


def _cuts(count: int, coarse: int) -> list[tuple[int, int]]:
    """First and last cell of each block along an axis; neighbours share a cell."""
    edges = [*range(0, count - 1, coarse), count - 1]
    return list(itertools.pairwise(edges)) if len(edges) > 1 else [(0, 0)]


def _expected(block: _Block) -> int:
    """Evaluations that a block takes through which the boundary passes once: about three for each cell it crosses."""
    i0, i1, j0, j1 = block
    return 3 * (max(i1 - i0, j1 - j0) - 1)


def _divisible(block: _Block) -> bool:
    i0, i1, j0, j1 = block
    return i1 - i0 > 1 or j1 - j0 > 1


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
