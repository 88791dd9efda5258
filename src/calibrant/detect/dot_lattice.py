"""From spots to lattices: neighbours told by the spots' own shapes, then grown step by step.

A circle seen at a tilt is an ellipse, and the same affine map that made it has squeezed the lattice around it. In the
coordinates that make the ellipse a unit circle again, the nearest neighbours of a square lattice lie at one distance
and at right angles, whatever the tilt. That gives the first two steps; every further one is predicted from its
neighbour's steps and looked up, so perspective and lenses are followed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrant.detect.spots import Spots

Array = NDArray[np.float64]
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
    tree = cKDTree(spots.uv)
    used = np.zeros(len(spots), dtype=bool)
    tried = 0
    for seed in order:
        if used[seed]:
            continue
        tried += 1
        if tried > MOST_LATTICES:
            return
        lattice = _grow(spots, tree, int(seed), steps[seed], BIG_SIZE if with_big else SAME_SIZE)
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


def _grow(spots: Spots, tree: cKDTree, seed: int, steps: Array, largest: float) -> Lattice:
    cells: dict[tuple[int, int], int] = {(0, 0): seed}
    place = {seed: (0, 0)}
    basis = {seed: steps.copy()}
    size = {seed: float(spots.area[seed])}
    queue = deque([seed])
    while queue:
        spot = queue.popleft()
        a, b = place[spot]
        for axis, sign in ((0, 1), (1, 1), (0, -1), (1, -1)):
            cell = (a + sign, b) if axis == 0 else (a, b + sign)
            if cell in cells:
                continue
            step = sign * basis[spot][axis]
            nearest = tree.query(spots.uv[spot] + step)
            away, other = float(nearest[0]), int(nearest[1])
            ratio = float(spots.area[other]) / size[spot]
            if other in place or away > MISS * np.linalg.norm(step) or not 1 / SAME_SIZE < ratio < largest:
                continue
            cells[cell], place[other] = other, cell
            # The step just made is the better guess for the next along it; the other step is carried over.
            basis[other] = basis[spot].copy()
            basis[other][axis] = sign * (spots.uv[other] - spots.uv[spot])
            size[other] = size[spot] if ratio >= SAME_SIZE else float(spots.area[other])
            queue.append(other)
    index = np.array(list(cells.values()), dtype=np.int64)
    reference = np.array([size[i] for i in index.tolist()])
    return Lattice(np.array(list(cells), dtype=np.int64), index, spots.area[index] >= SAME_SIZE * reference)
