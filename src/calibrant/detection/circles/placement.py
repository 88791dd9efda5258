"""Which dot of the target each spot of a lattice is: every way to lay the target on the lattice, weighed by evidence.

A way is a quarter turn and a shift. Against it speak spots that the target does not have, and dots of the target that
should be in the picture and are not there; a dot beyond the picture's edge says nothing, so a grid that is cut off is
placed as far as its visible sides allow. The big dot must be at the origin and nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate2d

from calibrant.arrays import Array
from calibrant.detection.circles.lattice import Lattice
from calibrant.geometry.projective import homography
from calibrant.targets.circles import Circles

Ints = NDArray[np.int64]

LEAST_SEEN = 0.8
"""Of the dots that should be in the picture; the others may be hidden by glare or a finger."""
LEAST_PART = 0.3
"""Of the whole grid that must be seen: with less, a piece of a regular pattern is taken for it too easily."""
LEAST_DOTS = 12
"""A piece of a grid, cut off by the picture's edge, has as many, 4x3: fewer are seen in any row of lamps or letters."""
MOST_SURPLUS = 0.4
"""Spots on the lattice beside the grid, over its shorter side: a whole line of them is another grid."""
BORDER = 0.6
"""Dots nearer to the picture's edge than this, in steps, may be cut off."""


@dataclass(frozen=True, eq=False)
class Placement:
    """Which of the target's points each spot of a lattice is: index (n,), -1 for none; cost: evidence against it."""

    index: Ints
    cost: float
    footprint: frozenset[tuple[int, int]]
    x_axis: Array


def lattice_steps(target: Circles) -> Ints:
    """Cells (n, 2) of the target's points on its square lattice; an asymmetric grid's is turned by 45 degrees."""
    if not target.asymmetric:
        return target.steps
    x, y = target.steps.T
    return np.stack([(x + y) // 2, (y - x) // 2], axis=1)


def place(target: Circles, lattice: Lattice, uv: Array, image_size: tuple[int, int]) -> Placement | str:
    """The only placement the picture allows, or why there is none.

    Args: uv (n, 2) px of the lattice's spots; image_size (width, height).
    """
    if len(lattice) < least_dots(target):
        return f"only {len(lattice)} of {len(target.points)} dots seen"
    H = homography(lattice.cells.astype(np.float64), uv)
    ways = [w for k in range(4) for w in _ways(target, lattice, k, H, image_size)]
    if not ways:
        return "no way fits"
    best = min(w.cost for w in ways)
    if best > (1 - LEAST_SEEN) * len(target.points):
        return "no way fits"
    # Ways apart by less than this cannot be told apart.
    rivals = [w for w in ways if w.cost < best + _decisive(target)]
    if len({w.footprint for w in rivals}) > 1 or (target.turns_unnoticed_deg is None and len(rivals) > 1):
        return "several ways fit"
    return max(rivals, key=lambda w: float(w.x_axis[0] + 0.99 * w.x_axis[1]))


def least_dots(target: Circles) -> float:
    """How many of the grid's dots must be seen."""
    whole = len(target.points)
    return max(LEAST_PART * whole, min(LEAST_DOTS, LEAST_SEEN * whole))


def _ways(target: Circles, lattice: Lattice, quarter: int, H: Array, image_size: tuple[int, int]) -> list[Placement]:
    steps = lattice_steps(target)
    turn = np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), quarter)
    cells = lattice.cells @ turn.T
    low, origin = cells.min(axis=0), steps.min(axis=0)
    seen, wanted = _mask(cells - low), _mask(steps - origin)
    overlap = np.rint(correlate2d(wanted, seen)).astype(int)
    most = MOST_SURPLUS * min(target.columns, target.rows)
    number = np.full(wanted.shape, -1, np.int64)
    number[tuple((steps - origin).T)] = np.arange(len(steps))
    ways = []
    for at in np.argwhere(overlap >= max(LEAST_PART * len(steps), len(cells) - most)):
        shift = at - (np.array(seen.shape) - 1)
        here = cells - low + shift
        inside = np.all((here >= 0) & (here < wanted.shape), axis=1)
        index = np.full(len(cells), -1, np.int64)
        index[inside] = number[tuple(here[inside].T)]
        # Row vectors: a cell is c = (s + low - shift - origin) turned back.
        where = (steps - origin - shift + low) @ turn
        cost = _evidence(target, lattice, index, where, H, image_size)
        if np.isfinite(cost):
            ways.append(Placement(index, cost, frozenset(map(tuple, where.tolist())), _x_axis(target, where, H)))
    return ways


def _mask(cells: Ints) -> Array:
    mask = np.zeros(cells.max(axis=0) + 1)
    mask[tuple(cells.T)] = 1.0
    return mask


def _evidence(
    target: Circles, lattice: Lattice, index: Ints, where: Ints, H: Array, image_size: tuple[int, int]
) -> float:
    """Surplus spots, dots that should be seen, big dots in the wrong place; infinite where the origin's is small."""
    if target.bigdot and np.any((index == 0) & ~lattice.big):
        return np.inf
    missing = np.setdiff1d(np.arange(len(where)), index)
    uv = _project(H, where[missing])
    reach = np.linalg.norm(_project(H, where[missing] + np.array([1, 0])) - uv, axis=1)
    reach = BORDER * np.maximum(reach, np.linalg.norm(_project(H, where[missing] + np.array([0, 1])) - uv, axis=1))
    expected = np.all((uv > reach[:, None]) & (uv < np.array(image_size) - 1 - reach[:, None]), axis=1)
    misplaced = np.count_nonzero(lattice.big & (index != 0)) if target.bigdot else 0
    # A big dot elsewhere is evidence enough alone: nothing but the origin looks like one.
    return float(np.count_nonzero(index < 0) + np.count_nonzero(expected) + misplaced * _decisive(target))


def _decisive(target: Circles) -> float:
    """Evidence that decides between two ways: half of a side's dots."""
    return 0.5 * min(target.columns, target.rows)


def _x_axis(target: Circles, where: Ints, H: Array) -> Array:
    """Direction of the target's x axis in the picture: from the first circle to the last of its row."""
    first, last = _project(H, where[[0, target.columns - 1]])
    return (last - first) / max(float(np.linalg.norm(last - first)), 1e-9)


def _project(H: Array, cells: Ints) -> Array:
    q = np.column_stack([cells, np.ones(len(cells))]) @ H.T
    # Behind the horizon there is no picture: such points are put far outside of it.
    ahead = q[:, 2] > 1e-9
    return np.where(ahead[:, None], q[:, :2] / np.where(ahead, q[:, 2], 1.0)[:, None], -1e6)
