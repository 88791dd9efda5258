"""What measurements of a robot share: with their neighbours in time, and with those of like joints.

Drift, temperature and an arm that yields are no noise drawn anew at every pose: measurements near each other err alike,
and a sigma that falls with the root of their number is too small (`optimize.clusters` has the equations).
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.optimize.clusters import cluster_scores, clustered_covariance, influence, square_root
from calibrant.optimize.factors import EXACT
from calibrant.optimize.solution import Solution

LEAST_EACH = 4
"""Measurements in a cluster: with fewer it has little to share, and takes most of its residuals into the fit."""
MOST_CLUSTERS = 12
"""More clusters are smaller ones, which miss what is shared over longer stretches."""
LEAST_CLUSTERS = 4


def with_shared_errors(solution: Solution, joints: Array) -> tuple[Array, float]:
    """The model's covariance (p, p) with what neighbouring measurements share, and how many times sigma it makes.

    Args: joints (n, q), in the order measured.
    """
    covariance = solution.covariance("model")
    count = min(MOST_CLUSTERS, len(joints) // LEAST_EACH)
    if count < LEAST_CLUSTERS:
        return covariance, 1.0
    root, inverse = square_root(covariance)
    parts = [influence(solution, f.name, "model", onto=inverse) for f in solution.problem.factors if f.noise != EXACT]
    rows, residuals = (np.ascontiguousarray(np.concatenate(part, axis=1)) for part in zip(*parts))
    stretches = np.arange(len(joints)) * count // len(joints)
    clusterings = [
        cluster_scores(rows, residuals, labels.astype(np.int64), root=root)
        for labels in (stretches, joint_regions(joints, count))
    ]
    times = float(np.sqrt(1 + sum(np.trace(c.shared) for c in clusterings) / len(inverse)))
    return clustered_covariance(covariance, clusterings), times


def joint_regions(joints: Array, count: int) -> Indices:
    """Region (n,) of each row: the largest is split at its median along the joint that moves most in it."""
    labels = np.zeros(len(joints), dtype=np.int64)
    for new in range(1, count):
        mine = np.flatnonzero(labels == np.argmax(np.bincount(labels)))
        along = joints[mine, int(np.argmax(np.ptp(joints[mine], axis=0)))]
        labels[mine[np.argsort(along, kind="stable")[len(mine) // 2 :]]] = new
    return labels
