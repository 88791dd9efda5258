"""Compiled rows that all `radial` models share; equations there, contract in `kernels`.

`place` is inlined into the compiled forms of other files, whose caches know only their own file's age: after a change
here, touch the *_rows files that import it.
"""

from __future__ import annotations

from numba import njit

from calibrant.cameras.kernels.contract import FAST


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy", inline="always")
def place(i, k, a, x, y, S, T, S_z, uv, J_point, J):  # type: ignore[no-untyped-def]
    """Pixel i of k parameters and its derivatives but those by the terms."""
    fx, fy = a[0], a[1]
    mx, my = S * x, S * y
    uv[0, i], uv[1, i] = fx * mx + a[2], fy * my + a[3]
    J_point[0, i], J_point[1, i], J_point[2, i] = fx * (S + x * x * T), fx * (x * y * T), fx * x * S_z
    J_point[3, i], J_point[4, i], J_point[5, i] = fy * (x * y * T), fy * (S + y * y * T), fy * y * S_z
    J[0, i], J[1, i], J[2, i], J[3, i] = mx, 0.0, 1.0, 0.0
    J[k, i], J[k + 1, i], J[k + 2, i], J[k + 3, i] = 0.0, my, 0.0, 1.0
