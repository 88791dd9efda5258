"""Corners that do not lie where any of their neighbours puts them: another corner of the picture, taken for a board's.

A smooth map of the grid is nearly linear over two steps. So a corner p lies near the middle of the two beside it, near
3 p1 - 3 p2 + p3 of the next three in a line, and near p1 + p2 - p12, which closes a cell; a lens that bends a board, or
one seen at a glance, changes the steps but not by a third of them at once. One witness is enough, for another may
itself be astray.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array

ASTRAY = 0.4
"""Of the smallest step that a witness is made of: nearly half way to the next corner."""
LINES = ((0, 1), (0, -1), (1, 0), (-1, 0))
CELLS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
REACH = 3


def stray_corners(xy: Array) -> NDArray[np.bool_]:
    """Corners (rows, columns) that have witnesses, none of which puts them where they are.

    Args: xy (rows, columns, 2) pixels, not a number where a corner is not known.
    """
    if _even(xy) and _even(xy.swapaxes(0, 1)):
        return np.zeros(xy.shape[:2], dtype=bool)
    rows, columns = xy.shape[:2]
    wide = np.full((rows + 2 * REACH, columns + 2 * REACH, 2), np.nan)
    wide[REACH : REACH + rows, REACH : REACH + columns] = xy

    def at(row: int, column: int) -> Array:
        return wide[REACH + row : REACH + row + rows, REACH + column : REACH + column + columns]

    witnesses, steps = [], []
    for r, c in LINES[::2]:
        one, other = at(r, c), at(-r, -c)
        witnesses.append(0.5 * (one + other))
        steps.append((0.5 * (one - other),) * 2)
    for r, c in LINES:
        first, second, third = at(r, c), at(2 * r, 2 * c), at(3 * r, 3 * c)
        witnesses.append(3.0 * (first - second) + third)
        steps.append((first - second, second - third))
    for r, c in CELLS:
        along, down, across = at(0, c), at(r, 0), at(r, c)
        witnesses.append(along + down - across)
        steps.append((along - across, down - across))
    step2 = (np.array(steps) ** 2).sum(axis=-1).min(axis=1)
    away2 = ((xy - np.array(witnesses)) ** 2).sum(axis=-1)
    told = np.isfinite(away2)
    return np.asarray(told.any(axis=0) & ~(told & (away2 <= ASTRAY**2 * step2)).any(axis=0))


def _even(xy: Array) -> bool:
    """Whether all corners are known, and no step down a column differs from the next by as much as a stray's does."""
    step = np.diff(xy, axis=0)
    change = np.diff(step, axis=0)
    # Not a number where a corner is not known.
    return bool((change**2).sum(axis=-1).max(initial=0.0) < ASTRAY**2 * (step**2).sum(axis=-1).min(initial=np.inf))
