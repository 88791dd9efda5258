"""Least squares under inequalities, small and exact.

    min |A x - b|^2  subject to  G x >= h

brought to the least distance problem and solved by non-negative least squares (Lawson and Hanson 1974, "Solving Least
Squares Problems", chapter 23).
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from calibrant.arrays import Array


def least_squares_within(A: Array, b: Array, G: Array, h: Array) -> Array:
    """x (n,) for A (m, n) of full column rank, b (m,), G (k, n) and h (k,); x = 0, to stand, satisfies G x >= h.

    >>> import numpy as np
    >>> below = np.array([[-1.0, 0.0]]), np.array([-2.0])
    >>> least_squares_within(np.eye(2), np.array([3.0, 1.0]), *below).round(9).tolist()
    [2.0, 1.0]
    """
    Q, R = np.linalg.qr(A)
    free = np.linalg.solve(R, Q.T @ b)
    if not len(h) or np.all(G @ free >= h - 1e-12):
        return np.asarray(free)
    # z = R x - Q^T b: the nearest point to 0 of G R^-1 z >= h - G x_free, rows of one length for the numbers' sake.
    rows, low = np.linalg.solve(R.T, G.T).T, h - G @ free
    size = np.maximum(np.linalg.norm(rows, axis=1), 1e-12)
    rows, low = rows / size[:, None], low / size
    scale = max(float(np.abs(low).max()), 1e-300)
    E = np.vstack([rows.T, low / scale])
    f = np.zeros(len(E))
    f[-1] = 1.0
    u, rest = nnls(E, f)
    r = E @ u - f
    if rest < 1e-9:  # the inequalities contradict each other: what is always allowed is to stand
        return np.zeros(A.shape[1])
    z = -r[:-1] / r[-1] * scale
    return np.asarray(np.linalg.solve(R, z + Q.T @ b))
