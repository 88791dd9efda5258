"""What neighbouring points of one view share, and what it does to the pose's sigma.

One view has no other views to be compared with: its clusters are patches of the target (`optimize.clusters` has the
equations). What moves the whole target alike, or linearly, the pose takes up, and no view by itself can tell it.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.optimize.clusters import cluster_scores, square_root

PATCHES = 3
"""Patches along each axis of the target: nine have the degrees of freedom for six unknowns, and points each."""
LEAST_POINTS = 2 * PATCHES**2
"""With fewer than two points a patch there is nothing that they could share."""


def with_shared_errors(
    of_noise: Array, J: Array, residuals: Array, points: Array, *, of_camera: Array | None = None
) -> Array:
    """The covariance (6, 6) of a pose with what the points of a patch share, beside what the camera makes them share.

    Args: of_noise (6, 6), of independent points; J (n, 2, 6) and residuals (n, 2), over the points' sigma; points
    (n, 3), target frame; of_camera (6, 6), the pose's own share of the camera's uncertainty, which is added elsewhere.
    """
    if len(points) < LEAST_POINTS:
        return of_noise
    root, inverse = square_root(of_noise)
    rows = np.ascontiguousarray(J @ (inverse @ of_noise).T)
    along = _along(points)
    clusters = cluster_scores(rows, np.ascontiguousarray(residuals), _patches(along), root=root, at=along)
    known = 0.0 if of_camera is None else inverse @ of_camera @ inverse.T
    values, axes = np.linalg.eigh(clusters.shared - known)
    beside = root @ axes
    return np.asarray(of_noise + (beside * np.maximum(values, 0.0)) @ beside.T)


def _along(points: Array) -> Array:
    """Places (n, 2) of points along the target's two longest axes."""
    centred = points - points.mean(axis=0)
    return np.ascontiguousarray(centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T)


def _patches(along: Array) -> Indices:
    """The patch (n,) of each place (n, 2), counted from 0 without gaps."""
    low, high = along.min(axis=0), along.max(axis=0)
    share = (along - low) / np.maximum(high - low, np.finfo(np.float64).tiny)
    place = np.minimum((share * PATCHES).astype(np.int64), PATCHES - 1)
    return np.unique(place @ np.array([PATCHES, 1]), return_inverse=True)[1].astype(np.int64)
