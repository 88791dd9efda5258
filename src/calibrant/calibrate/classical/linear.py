"""Homogeneous linear systems M h = 0 with what their noise leaves of the solution; the classical methods share it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array

RANK = 1e-9
"""Second smallest over largest singular value of a column-scaled system below which it has a second solution.

Rounding leaves 1e-14; points that a target and a camera can show leave 1e-5 and more.
"""
UNSURE = 0.3
"""Relative error of the solution in its worst direction above which it says nothing: two solutions fit alike."""
SIGMAS = 3.0
"""Standard deviations by which a quantity must differ from a degenerate value; chance does so once in 370."""


@dataclass(frozen=True, eq=False)
class NullVector:
    """The unit vector h of column-scaled unknowns with the least |M h|.

    values (k,) of the unknowns themselves; covariance (k, k) by first order, from the system's own misfit; rank_ratio
    and worst: second smallest over largest singular value, and the relative error in the worst direction.
    """

    values: Array
    covariance: Array
    rank_ratio: float
    worst: float

    @property
    def determined(self) -> bool:
        """Whether there is one solution and not two."""
        return self.rank_ratio > RANK and self.worst < UNSURE

    def sigma(self, index: int) -> float:
        """1 sigma of an unknown; 0 where the system has no equation to spare to tell it from."""
        return float(np.sqrt(max(self.covariance[index, index], 0.0)))


def null_vector(M: Array) -> NullVector:
    """Least |M h| over unit h, columns scaled to unit length first. Args: M (n, k), n >= k - 1."""
    n, k = M.shape
    length = np.linalg.norm(M, axis=0)
    # A column of nothing but rounding says nothing about its unknown: scaled up, it would seem to.
    length = np.where(length > RANK * length.max(), length, max(length.max(), 1e-300))
    _, s, Vt = np.linalg.svd(M / length, full_matrices=True)
    s = np.concatenate([s, np.zeros(k - len(s))])
    spare = n - (k - 1)
    noise = s[-1] / np.sqrt(spare) if spare > 0 else 0.0
    others = np.maximum(s[:-1], 1e-300)
    spread = (Vt[:-1] / others[:, None]) / length
    return NullVector(Vt[-1] / length, noise**2 * spread.T @ spread, float(s[-2] / s[0]), float(noise / others[-1]))


def least_squares(A: Array, b: Array) -> Array:
    """x with the least |A x - b|, columns scaled to unit length so that metres and pixels weigh alike."""
    length = np.linalg.norm(A, axis=0)
    length = np.where(length > 0, length, 1.0)
    return np.linalg.lstsq(A / length, b, rcond=None)[0] / length
