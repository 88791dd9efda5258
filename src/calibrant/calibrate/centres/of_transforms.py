"""Centres of transforms, and how far these lie from them, compiled: for those who ask many times of a few tens.

`se3.mean` and `se3.deviation` do the same without a compiler.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.geometry import se3, so3

START_CANDIDATES = 250
"""Samples tried as the start of a median: all where there are no more, else so many that are drawn. With less than half
of them wrong, none of those is right once in 1e75, whatever order the wrong ones come in: one of every few is no such
draw, where sessions repeat themselves."""


@dataclass(frozen=True, eq=False)
class Centre:
    """T (4, 4); mm, deg (n,): how far the transforms that it is the centre of are from it."""

    T: Array
    mm: Array
    deg: Array


def mean(T: Array) -> Centre:
    """Karcher mean of the rotations and mean of the translations of T (n, 4, 4), n >= 1; as `se3.mean`."""
    middle = T.mean(axis=0)
    return _centre(T, se3.make(so3.nearest(middle[:3, :3]), middle[:3, 3]), median=False)


def median(T: Array) -> Centre:
    """Rotation and translation with the least sum of distances to T (n, 4, 4), n >= 1, by Weiszfeld's iteration.

    Weiszfeld 1937; on rotations Hartley, Aftab, Trumpf, "L1 rotation averaging using the Weiszfeld algorithm", 2011.
    """
    n = len(T)
    R, t = T[:, :3, :3], np.sort(T[:, :3, 3], axis=0)
    # Start on the sample that is closest to the others (trace R_i^T R_j = 3 for equal rotations), so that a minority of
    # rotations far off cannot pull the start into another basin.
    flat, candidates = R.reshape(-1, 9), R[_drawn(n)]
    distance = np.arccos(np.clip((candidates.reshape(-1, 9) @ flat.T - 1) / 2, -1, 1))
    closest = candidates[int(np.argmin(distance.sum(axis=1)))]
    return _centre(T, se3.make(closest, 0.5 * (t[(n - 1) // 2] + t[n // 2])), median=True)


def _drawn(n: int) -> Indices:
    """Rows of at most `START_CANDIDATES` of n, always the same ones."""
    if n <= START_CANDIDATES:
        return np.arange(n)
    return np.asarray(np.random.default_rng(0).choice(n, START_CANDIDATES, replace=False))


def _centre(T: Array, start: Array, *, median: bool) -> Centre:
    from calibrant.calibrate.centres import kernels

    Z, length = np.array(start), np.empty((2, len(T)))
    kernels.centre(np.ascontiguousarray(T), Z, median, length, np.empty((2, 4)))
    return Centre(Z, 1e3 * length[1], np.rad2deg(length[0]))
