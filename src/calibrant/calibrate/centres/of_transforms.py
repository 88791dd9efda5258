"""Centres of transforms, and how far they lie from them, compiled: for those who ask many times of a few tens.

`so3.mean` and `se3.deviation` do the same without a compiler.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.geometry import se3, so3

START_CANDIDATES = 100
"""Samples tried as the start of a median: with a minority of wrong ones, some of a hundred are near the centre."""


def mean_transform(T: Array) -> Array:
    """Karcher mean of the rotations and mean of the translations of T (n, 4, 4), n >= 1; as `se3.mean`."""
    from calibrant.calibrate.centres import kernels

    m = np.ascontiguousarray(T)
    mean = m.mean(axis=0)
    centre = se3.make(so3.nearest(mean[:3, :3]), mean[:3, 3])
    kernels.mean_rotation(m, centre)
    return centre


def mean_rotation(R: Array) -> Array:
    """Karcher mean of R (n, 3, 3), n >= 1; as `so3.mean`."""
    from calibrant.calibrate.centres import kernels

    m = np.ascontiguousarray(R)
    centre = np.ascontiguousarray(so3.nearest(m.mean(axis=0)))
    kernels.mean_rotation(m, centre)
    return centre


def median_transform(T: Array) -> Array:
    """Rotation and translation with the least sum of distances to T (n, 4, 4), each by Weiszfeld's iteration.

    Weiszfeld 1937; on rotations Hartley, Aftab, Trumpf, "L1 rotation averaging using the Weiszfeld algorithm", 2011.
    """
    from calibrant.calibrate.centres import kernels

    m = np.ascontiguousarray(T)
    R, n = m[:, :3, :3], len(m)
    # Start on the sample that is closest to the others (trace R_i^T R_j = 3 for equal rotations), so that a minority of
    # rotations far off cannot pull the start into another basin.
    flat, candidates = R.reshape(-1, 9), R[:: max(1, n // START_CANDIDATES)]
    distance = np.arccos(np.clip((candidates.reshape(-1, 9) @ flat.T - 1) / 2, -1, 1))
    ordered = np.sort(m[:, :3, 3], axis=0)
    middle = 0.5 * (ordered[(n - 1) // 2] + ordered[n // 2])
    centre = se3.make(candidates[int(np.argmin(distance.sum(axis=1)))], middle)
    kernels.median_transform(m, centre, np.empty(n), np.empty(n))
    return centre


def deviations(centre: Array, T: Array) -> tuple[Array, Array]:
    """Distances in mm (n,) and angles in degrees (n,) of T (n, 4, 4) from centre (4, 4); as `se3.deviation`."""
    from calibrant.calibrate.centres import kernels

    mm, deg = np.empty(len(T)), np.empty(len(T))
    kernels.deviations(np.ascontiguousarray(T), np.ascontiguousarray(centre), mm, deg)
    return mm, deg
