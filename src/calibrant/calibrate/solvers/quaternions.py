"""Quaternion products as matrices, for the methods whose unknown is a unit quaternion (w, x, y, z)."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array


def left(q: Array) -> Array:
    """L(q) with q p = L(q) p. Args: q (..., 4). Returns (..., 4, 4)."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def right(q: Array) -> Array:
    """R(q) with p q = R(q) p. Args: q (..., 4). Returns (..., 4, 4)."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def product(p: Array, q: Array) -> Array:
    """p q of quaternions (..., 4)."""
    return np.einsum("...ij,...j->...i", left(p), q)


def pure(v: Array) -> Array:
    """(0, v) of vectors (..., 3)."""
    return np.concatenate([np.zeros((*v.shape[:-1], 1)), v], axis=-1)


def conjugate(q: Array) -> Array:
    """(w, -x, -y, -z)."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])
