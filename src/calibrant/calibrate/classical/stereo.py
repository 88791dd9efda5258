"""Points in space from two or more cameras that the direct linear transform calibrated (lecture 001, slides 36 and 37).

Unlike `geometry.triangulation`, which minimises distances from rays, this is the slide's own least squares on the
coefficients: no camera need be decomposed, and a lens with distortion need be undistorted first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.calibrate.classical.refusals import PARALLEL_RAYS, Degenerate
from calibrant.errors import InputError

PARALLEL = 1e-6
"""Smallest over largest singular value of a point's equations, about the angle between its rays in radians: 1e-6 is a
thousandth of a pixel at a focal length of 1000."""


def stereo_points(P: ArrayLike, uv: ArrayLike) -> Array:
    """Points from their pixels in cameras A, B, ... with known coefficients (slide 37, two rows a camera).

        [a11 - a31 X, a12 - a32 X, a13 - a33 X] (x_w y_w z_w)^T = a34 X - a14,    the same with a2j and Y

    The slide has a34 = 1. Each camera's rows are divided by the focal length they carry, so that a long lens does not
    outvote a short one.
    Args: P (views, 3, 4), as `dlt` returns them; uv (views, n, 2) px, NaN where a view does not see the point.
    Returns (n, 3), metres, target frame.
    Raises: InputError for shapes, or a point that fewer than two views see; Degenerate where a point's rays are
    parallel.
    """
    a, m = np.asarray(P, dtype=np.float64), np.asarray(uv, dtype=np.float64)
    if a.ndim != 3 or a.shape[1:] != (3, 4) or m.ndim != 3 or m.shape[0] != len(a) or m.shape[2] != 2:
        raise InputError(
            f"stereo points take P (views, 3, 4) and pixels (views, n, 2) of the same views, got {a.shape}, {m.shape}"
        )
    seen = np.all(np.isfinite(m), axis=2)
    lonely = np.flatnonzero(seen.sum(axis=0) < 2)
    if len(lonely):
        raise InputError(f"point {lonely[0]} is seen by {seen[:, lonely[0]].sum()} cameras; its place needs two")
    pixels = np.where(seen[..., None], m, 0.0)
    rows = a[:, None, :2, :] - pixels[..., None] * a[:, None, 2:, :]
    rows = rows / np.linalg.norm(a[:, :2, :3], axis=(1, 2))[:, None, None, None] * seen[..., None, None]
    system = np.swapaxes(rows, 0, 1).reshape(m.shape[1], -1, 4)
    s = np.linalg.svd(system[..., :3], compute_uv=False)
    parallel = np.flatnonzero(s[:, 2] < PARALLEL * s[:, 0])
    if len(parallel):
        raise Degenerate(
            PARALLEL_RAYS,
            f"the cameras see point {parallel[0]} along one line, so its depth is unknown; move them apart",
        )
    return np.stack([np.linalg.lstsq(row[:, :3], -row[:, 3], rcond=None)[0] for row in system])
