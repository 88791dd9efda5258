"""Patterns by which neighbours err alike: the poses' order, and where they are. Each is a root F (n, f) of its kernel.

k(i, j) = exp(-d^2 / 2), d the distance in units of a length: of places in the order, or of positions and angles. F F^T
is the kernel to `LEFT` of its diagonal, by pivoted Cholesky; smooth kernels have few columns.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibrant.arrays import Array

LEFT = 0.01
"""What a pattern may lack of a pose's variance."""
MOST_COLUMNS = 60
"""A longer order is taken in as many stretches, whose poses err as one."""


def by_order(n: int, length: float) -> Array:
    """F of n poses whose errors go over `length` places; of more than `MOST_COLUMNS`, stretches take the place of
    poses."""
    stretch = -(-n // MOST_COLUMNS)
    place = np.arange(n) // stretch
    D = np.subtract.outer(np.arange(place[-1] + 1), np.arange(place[-1] + 1)) / length
    return kernel_root(np.exp(-0.5 * D**2))[place]


def by_place(T: Array, *, metres: float, radians: float) -> Array:
    """F of poses (n, 4, 4) whose errors go over these lengths and angles a: d^2 = t^2 / m^2 + 4 sin^2(a / 2) / r^2."""
    t = T[:, :3, 3] / metres
    # |R_a - R_b|_F^2 = 8 sin^2(angle / 2): rows of numbers whose distances are both.
    numbers = np.concatenate([t, T[:, :3, :3].reshape(-1, 9) / (np.sqrt(2) * radians)], axis=1)
    return _root_of_rows(numbers)


def kernel_root(K: Array) -> Array:
    """F (n, f) of a kernel that is given as a matrix."""
    return _root(np.diag(K).copy(), lambda j: K[:, j])


def _root_of_rows(numbers: Array) -> Array:
    return _root(np.ones(len(numbers)), lambda j: np.exp(-0.5 * np.sum((numbers - numbers[j]) ** 2, axis=1)))


def _root(diagonal: Array, column: Callable[[int], Array]) -> Array:
    """Pivoted Cholesky of a kernel by its columns."""
    left, parts = diagonal, np.zeros((min(MOST_COLUMNS, len(diagonal)), len(diagonal)))
    for k in range(len(parts)):
        j = int(np.argmax(left))
        if left[j] <= LEFT:
            return parts[:k].T
        parts[k] = (column(j) - parts[:k].T @ parts[:k, j]) / np.sqrt(left[j])
        left = left - parts[k] ** 2
    return parts.T
