"""The one of many transforms that is nearest to the others, which a wrong one does not move."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.geometry import se3


def medoid(T: Array) -> Array:
    """The transform of T (n, 4, 4) with the least sum of distances to the others."""
    return np.asarray(T[int(np.argmin(_distances(T).sum(axis=1)))])


def robust_mean(T: Array) -> Array:
    """Mean of the transforms that agree with the majority: those nearer to the medoid than 3 times the median."""
    distance = _distances(T)
    typical = np.median(distance, axis=1)
    nearest = int(np.argmin(typical))
    return se3.mean(T[distance[nearest] <= 3 * typical[nearest] + 1e-12])


def _distances(T: Array) -> Array:
    """Distances (n, n); they add metres and radians: at a metre's distance one weighs as much as the other."""
    # |R_a - R_b| = sqrt(8) sin(angle / 2) in the Frobenius norm.
    turned = (T[:, None, :3, :3] - T[None, :, :3, :3]).reshape(len(T), len(T), 9)
    shift = T[:, None, :3, 3] - T[None, :, :3, 3]
    chord = np.sqrt(np.einsum("abi,abi->ab", turned, turned) / 8)
    return np.asarray(2 * np.arcsin(np.minimum(chord, 1)) + np.sqrt(np.einsum("abi,abi->ab", shift, shift)))
