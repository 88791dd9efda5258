"""How well the offset between two clocks is known, with errors that neighbouring samples share.

Residuals of the loop are neither independent nor alike in all directions: neighbouring camera samples share what the
robot's samples around them were off by, and what turns the target moves it too. With J_i, r_i in units of the noise,
N = sum J_i^T J_i, p unknowns, the covariance is N^-1 M N^-1 with the scores' covariance M in two ways. By the known
noise: each camera sample's own, and d_i, what that of the robot's samples moves the residuals by through the spline,

    M = n / (n - p) sum_i g_i g_i^T + cov(sum_i J_i^T d_i),     g_i = J_i^T r_i.

By the residuals, whatever they share, over L lags (Newey and West 1987),

    M = n / (n - p) sum_l (1 - |l| / (L + 1)) sum_i g_i g_(i+l)^T.

The second misses a part of what it measures, as few stretches of L samples are in a recording; the first knows nothing
of errors that a controller's own smoothing leaves. The one that leaves the offset less certain is stated.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.clocks.start import PoseSpline


def sandwich(J: Array, r: Array, by_robot: Array, *, spline: PoseSpline, t: Array, lags: int) -> Array:
    """Covariance (p, p) of the unknowns, the last of which is the offset.

    Args: J (n, m, p), r (n, m) and by_robot (n, m, 6), the derivative by the robot's pose: in units of the noise;
    t (n,): moments on the robot's clock; lags: camera samples over which the robot's errors are shared.
    """
    n, p = len(J), J.shape[2]
    scale = 1 / np.sqrt(np.einsum("nij,nij->j", J, J))  # radians, metres and seconds: scaled, no digits are lost
    J = J * scale
    g = np.einsum("nij,ni->nj", J, r)
    spare = n / max(n - p, 1)
    known = spare * g.T @ g + spline.spread(t, np.einsum("nij,nik->njk", J, by_robot))
    # Newey and West's own number of lags, for noise that is correlated for other reasons.
    shared = spare * _long_run(g, min(max(lags, int(4 * (n / 100) ** (2 / 9))), n // 4))
    N = np.linalg.inv(np.einsum("nij,nik->jk", J, J))
    covariances = [np.asarray(N @ M @ N * np.outer(scale, scale)) for M in (known, shared)]
    return max(covariances, key=lambda C: float(C[-1, -1]))


def _long_run(g: Array, lags: int) -> Array:
    """Newey and West's sum of the scores g (n, p) over neighbours."""
    M = g.T @ g
    for lag in range(1, lags + 1):
        across = g[:-lag].T @ g[lag:]
        M = M + (1 - lag / (lags + 1)) * (across + across.T)
    return np.asarray(M)
