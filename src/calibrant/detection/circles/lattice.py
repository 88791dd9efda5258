"""From spots to lattices: neighbours told by the spots' own shapes, then grown step by step.

A circle seen at a tilt is an ellipse, and the same affine map that made it has squeezed the lattice around it. In the
coordinates that make the ellipse a unit circle again, the nearest neighbours of a square lattice lie at one distance
and at right angles, whatever the tilt. That gives the first two steps; every further one is predicted from its
neighbour's steps and looked up, so perspective and lenses are followed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrant.arrays import Array
from calibrant.compiled import compiled
from calibrant.detection.circles.spots import Spots

Ints = NDArray[np.int64]

NEAREST = 14
"""Spots looked at around each: at a tilt of 70 degrees the four neighbours are among the nearest dozen in the image."""
SAME_SIZE = 2.0
"""Ratio of areas of two neighbouring dots of one size: perspective changes it by a third at most, whole pixels of the
smallest spots by another third."""
BIG_SIZE = 8.0
"""A dot of double size has four times the area, as exactly as the above."""
SAME_DISTANCE = 1.25
"""Neighbours are at one distance, diagonal ones at 1.41 of it; the shape of small spots is known to a tenth."""
RIGHT_ANGLE = 0.35
"""Largest cosine between the two steps in the circle's coordinates, for the same reason."""
LEAST_GAP, MOST_GAP = 2.1, 12.0
"""Distance of neighbours over a dot's radius: 2 would touch; dots thinner than a sixth of the spacing are specks."""
MISS = 0.3
"""A dot may lie this far from its prediction, in steps: halfway to nothing else."""
MOST_CHANGE = 1.25
"""From one step to the next of a line: a view changes them by a tenth or two, whole pixels of small spots by more."""
MOST_CELLS = 100
"""From the first spot to each side; printed grids have some tens of dots a side."""
MOST_LATTICES = 12
LEAST_DOTS = 6


@dataclass(frozen=True, eq=False)
class Lattice:
    """Spots on a square lattice: cells (n, 2) whole numbers (a, b), spots (n,) indices; a turns into b like x into y.

    big (n,): whether a spot is of about double size among its neighbours.
    """

    cells: Ints
    spots: Ints
    big: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.spots)


def grow_lattices(spots: Spots, *, with_big: bool) -> Iterator[Lattice]:
    """Lattices of at least LEAST_DOTS spots, from the most regular neighbourhoods first.

    Args: with_big: whether a dot may be of double size.
    """
    if len(spots) < LEAST_DOTS:
        return
    order, steps = _seeds(spots)
    used = np.zeros(len(spots), dtype=bool)
    tried = 0
    for seed in order:
        if used[seed]:
            continue
        tried += 1
        if tried > MOST_LATTICES:
            return
        lattice = _grow(spots, int(seed), steps[seed], BIG_SIZE if with_big else SAME_SIZE)
        used[lattice.spots] = True
        if len(lattice) >= LEAST_DOTS:
            yield lattice


def _seeds(spots: Spots) -> tuple[Ints, Array]:
    """Spots with two neighbours at right angles, the most regular first, and the two steps (n, 2, 2) of every spot."""
    k = min(NEAREST, len(spots))
    near = np.asarray(cKDTree(spots.uv).query(spots.uv, k=k)[1])[:, 1:]
    offset = spots.uv[near] - spots.uv[:, None]
    to_circle = np.linalg.inv(np.linalg.cholesky(spots.shape))
    white = np.einsum("nij,nkj->nki", to_circle, offset)
    length = np.linalg.norm(white, axis=2)
    ratio = spots.area[near] / spots.area[:, None]
    alike = (ratio < SAME_SIZE) & (ratio > 1 / SAME_SIZE) & (length > LEAST_GAP)
    length = np.where(alike, length, np.inf)
    first = np.argmin(length, axis=1)
    rows = np.arange(len(spots))
    shortest = length[rows, first]
    close = length < SAME_DISTANCE * shortest[:, None]
    direction = white / np.where(np.isfinite(length), length, 1.0)[..., None]
    cosine = np.abs(np.einsum("nki,ni->nk", direction, direction[rows, first]))
    second = np.argmin(np.where(close, cosine, np.inf), axis=1)
    crossing = close[rows, second] & (cosine[rows, second] < RIGHT_ANGLE) & (shortest < MOST_GAP)
    e1, e2 = offset[rows, first], offset[rows, second]
    # The second step turned clockwise of the first, as y of x: lattices are never mirrored.
    flipped = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0] < 0
    e2 = np.where(flipped[:, None], -e2, e2)
    four = close.sum(axis=1) == 4
    regular = np.where(four, 0, 1) + np.where(crossing, cosine[rows, second], np.inf)
    order = np.argsort(regular, kind="stable")
    return order[np.isfinite(regular[order])], np.stack([e1, e2], axis=1)


def _grow(spots: Spots, seed: int, steps: Array, largest: float) -> Lattice:
    uv, area = np.ascontiguousarray(spots.uv), np.ascontiguousarray(spots.area)
    cells, index, big = _reach(uv, area, seed, np.ascontiguousarray(steps), largest)
    return Lattice(cells, index, big)


@compiled(
    "Tuple((int64[:, ::1], int64[::1], boolean[::1]))(float64[:, ::1], float64[::1], int64, float64[:, ::1], float64)"
)
def _reach(uv, area, seed, steps, largest):  # type: ignore[no-untyped-def]
    """Cells (m, 2), spots (m,) and which are big (m,), breadth first from a seed with its two steps (2, 2)."""
    n = len(uv)
    taken = np.zeros((2 * MOST_CELLS + 1, 2 * MOST_CELLS + 1), np.bool_)
    placed, big = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    basis, size = np.empty((n, 2, 2)), np.empty(n)
    queue, cells = np.empty(n, np.int64), np.zeros((n, 2), np.int64)
    queue[0], basis[seed], size[seed] = seed, steps, area[seed]
    placed[seed], taken[MOST_CELLS, MOST_CELLS] = True, True
    first, count = 0, 1
    while first < count:
        spot = queue[first]
        for way in range(4):
            axis, sign = way % 2, 1 - 2 * (way // 2)
            a = cells[first, 0] + (sign if axis == 0 else 0)
            b = cells[first, 1] + (sign if axis == 1 else 0)
            if abs(a) > MOST_CELLS or abs(b) > MOST_CELLS or taken[a + MOST_CELLS, b + MOST_CELLS]:
                continue
            x, y = uv[spot, 0] + sign * basis[spot, axis, 0], uv[spot, 1] + sign * basis[spot, axis, 1]
            other, away = 0, np.inf
            for k in range(n):
                apart = (uv[k, 0] - x) ** 2 + (uv[k, 1] - y) ** 2
                if apart < away:
                    other, away = k, apart
            step2 = basis[spot, axis, 0] ** 2 + basis[spot, axis, 1] ** 2
            ratio = area[other] / size[spot]
            if placed[other] or away > MISS**2 * step2 or not 1 / SAME_SIZE < ratio < largest:
                continue
            taken[a + MOST_CELLS, b + MOST_CELLS], placed[other] = True, True
            # The step just made, and how it differs from the one before, tell the next along it: three points of a line
            # with the next keep their cross ratio, d0 = d1 (d1 + d2) / (3 d2 - d1). The other step is carried over.
            basis[other] = basis[spot]
            basis[other, axis] = sign * (uv[other] - uv[spot])
            d1 = math.hypot(basis[other, axis, 0], basis[other, axis, 1])
            d2 = math.sqrt(step2)
            basis[other, axis] *= min(max((d1 + d2) / max(3.0 * d2 - d1, 1e-9), 1.0 / MOST_CHANGE), MOST_CHANGE)
            big[count] = ratio >= SAME_SIZE
            size[other] = size[spot] if ratio >= SAME_SIZE else area[other]
            queue[count], cells[count, 0], cells[count, 1] = other, a, b
            count += 1
        first += 1
    return cells[:count].copy(), queue[:count].copy(), big[:count].copy()
