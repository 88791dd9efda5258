"""Did two cameras move against each other, once, between two moments?

Every moment m gives where one stands to the other, d_m about any common place. Beside the views' own noise C_m it is
off by what both lenses are, alike at all moments: L_m e, e of unit covariance. With Sigma = diag(C_m) + L L^T and, for
each parting of the moments in their order, the model d_m = mu + step [m >= k],

    z_k = step^T V^-1 step,     V the covariance of the step by generalised least squares,

6 degrees of freedom, against what is left, 6 n - 12. The chance is that of the most significant parting times how many
were tried.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.optimize.chances import f_tail

CHANCE = 1e-4
"""One of ten thousand sessions whose cameras stood still is accused."""
MOST_ALIKE = 0.98
"""A correlation nearer to one is not told from it by so few moments."""
LEAST_GROUP = 2
"""Moments of a group: one alone is a pair that does not belong, not a move."""


@dataclass(frozen=True, eq=False)
class Move:
    """first: the first moment after it; step (6,): rotation, rad, and translation, m, along the first camera's axes;
    chance: of as much where nothing moved; z: what the step explains of `total`, the sum of squares of all."""

    first: int
    step: Array
    chance: float
    z: float
    total: float

    def noisier(self, freedom: float) -> float:
        """Noise without the step over that with it; freedom: residuals beyond the poses, of chi-square one each."""
        return float(np.sqrt((freedom + self.total) / max(freedom + self.total - self.z, freedom)))


def move_between(d: Array, C: Array, L: Array) -> Move | None:
    """The move that the moments show; None where none is beyond chance.

    Args: d (n, 6), se3.local from a common place; C (n, 6, 6) of each by itself; L (n, 6, p) of what all share.
    """
    n = len(d)
    if n < 2 * LEAST_GROUP + 1:
        return None
    own, WL, less = _weights(C, L)
    # Of the moments from k on, blocks of Sigma^-1 summed over rows and columns: n^2 of them are never laid out.
    after, late = _onwards(own), _onwards(WL)
    rows = after - late @ less @ late[0].T  # (n, 6, 6), rows >= k against all
    corner = after - late @ less @ np.swapaxes(late, 1, 2)
    Wd = (own @ d[:, :, None])[:, :, 0] - WL @ (less @ np.einsum("nip,ni->p", WL, d))
    right = _onwards(Wd)
    total = float(np.einsum("ni,ni->", d, Wd))
    at = np.arange(LEAST_GROUP, n - LEAST_GROUP + 1)
    H = np.empty((len(at), 12, 12))
    H[:, :6, :6], H[:, 6:, :6], H[:, 6:, 6:] = rows[0], rows[at], corner[at]
    H[:, :6, 6:] = np.swapaxes(rows[at], 1, 2)
    g = np.concatenate([np.broadcast_to(right[0], (len(at), 6)), right[at]], axis=1)
    inverse = np.linalg.pinv(H, rcond=1e-13, hermitian=True)
    found = np.einsum("kij,kj->ki", inverse, g)
    step = found[:, 6:]
    z = np.einsum("ki,ki->k", step, np.linalg.solve(inverse[:, 6:, 6:], step[..., None])[..., 0])
    # Covariances hold what they hold: less scatter than that is luck.
    left = np.maximum((total - np.einsum("ki,ki->k", g, found)) / (6 * n - 12), 1.0)
    best = int(np.argmax(z / left))
    k = int(at[best])
    ratio = float(z[best] / left[best]) / _in_a_row(d, C, found[best], k)
    chance = float(f_tail(6, 6 * n - 12, ratio / 6)) * len(at)
    return Move(k, step[best], chance, float(z[best]), total) if chance < CHANCE else None


def _in_a_row(d: Array, C: Array, found: Array, k: int) -> float:
    """How many times fewer moments there are than it seems, where neighbours err alike, as shutters that are not at
    once make a moving board do: (1 + r) / (1 - r), r the correlation of one moment's errors with the next's."""
    e = d - found[:6]
    e[k:] -= found[6:]
    white = np.linalg.solve(np.linalg.cholesky(C), e[..., None])[..., 0]
    r = float(np.sum(white[1:] * white[:-1]) / max(float(np.sum(white**2)), 1e-300))
    return (1 + max(r, 0.0)) / (1 - min(max(r, 0.0), MOST_ALIKE))


def _onwards(values: Array) -> Array:
    """Sums (n, …) of values (n, …) from each on."""
    return np.cumsum(values[::-1], axis=0)[::-1]


def _weights(C: Array, L: Array) -> tuple[Array, Array, Array]:
    """Sigma^-1 = diag(own) - (own L) less (own L)^T, Woodbury's: own (n, 6, 6), own L (n, 6, p) and less (p, p)."""
    own: Array = np.asarray(np.linalg.inv(C), dtype=np.float64)
    WL = own @ L
    return own, WL, np.linalg.inv(np.eye(L.shape[2]) + np.einsum("nip,niq->pq", L, WL))
