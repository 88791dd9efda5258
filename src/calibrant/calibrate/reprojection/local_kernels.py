"""Compiled normal equations of reprojection for models of which a point sees few of many parameters.

A splined camera has hundreds of control points and a pixel depends on 16 of them, so that a row of the Jacobian is
nearly empty. Its products are added point by point to the places they belong to: 24^2 / 2 a row in place of 274^2 / 2.
The layout of H and g is that of `reprojection_kernels.normal_equations`, whose test the dense form stays.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

from calibrant.calibrate.reprojection.kernels import _VIEWS, SUMS, robust
from calibrant.cameras.kernels.contract import FAST, LOCAL_ROWS
from calibrant.compiled import compiled

_SIGNATURE = types.void(LOCAL_ROWS, types.int64, *_VIEWS[1:], *SUMS)


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def _view(rows, local, parameters, T, theta, points, modes, uv, weight, first, n, loss, scale_sq, H, g):  # type: ignore[no-untyped-def]
    """Normal equations of one view; returns its cost."""
    k, m = parameters.shape[0], modes.shape[0]
    entries = 6 + local + m
    rotated, p = np.empty((3, n)), np.empty((3, n))
    predicted, J_point = np.empty((2, n)), np.empty((6, n))
    index, J_local = np.empty((n, 2, local), np.int64), np.empty((n, 2, local))
    column, value = np.empty(entries, np.int64), np.empty(entries)
    for i in range(n):
        for row in range(3):
            rotated[row, i] = 0.0
            for axis in range(3):
                x = points[axis, first + i]
                for mode in range(m):
                    x += theta[mode] * modes[mode, axis, first + i]
                rotated[row, i] += T[row, axis] * x
            p[row, i] = rotated[row, i] + T[row, 3]
    rows(n, parameters, p, predicted, J_point, index, J_local)
    H[:] = 0.0
    g[:] = 0.0
    for at in range(6):
        column[at] = at
    for mode in range(m):
        column[6 + local + mode] = 6 + k + mode
    cost = 0.0
    for i in range(n):
        w = weight[first + i]
        error = (predicted[0, i] - uv[0, first + i], predicted[1, i] - uv[1, first + i])
        rho, slope = robust(loss, scale_sq, (error[0] * error[0] + error[1] * error[1]) * w * w)
        cost += 0.5 * rho
        w *= np.sqrt(slope)
        rx, ry, rz = rotated[0, i], rotated[1, i], rotated[2, i]
        for half in range(2):
            jx, jy, jz = w * J_point[3 * half, i], w * J_point[3 * half + 1, i], w * J_point[3 * half + 2, i]
            value[0], value[1], value[2] = jz * ry - jy * rz, jx * rz - jz * rx, jy * rx - jx * ry
            value[3], value[4], value[5] = jx, jy, jz
            for at in range(local):
                column[6 + at] = 6 + index[i, half, at]
                value[6 + at] = w * J_local[i, half, at]
            for mode in range(m):
                moved = 0.0
                for axis in range(3):
                    d = modes[mode, axis, first + i]
                    moved += d * (jx * T[0, axis] + jy * T[1, axis] + jz * T[2, axis])
                value[6 + local + mode] = moved
            _add(entries, column, value, w * error[half], H, g)
    for a in range(H.shape[0]):
        for b in range(a):
            H[a, b] = H[b, a]
    return cost


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy", inline="always")
def _add(entries, column, value, r, H, g):  # type: ignore[no-untyped-def]
    """Add a row's products with itself and with its residual; columns rise, so that only the upper triangle fills."""
    for a in range(entries):
        x, row = value[a], H[column[a]]
        g[column[a]] += x * r
        for b in range(a, entries):
            row[column[b]] += x * value[b]


@compiled(_SIGNATURE, fastmath=FAST)
def normal_equations(  # type: ignore[no-untyped-def]
    rows, local, parameters, camera, T, theta, modes, points, uv, weight, offsets, loss, scale_sq, first, last, H, g,
    cost,
):  # fmt: skip
    """Fill H (m, q, q), g (m, q) and cost (m,) of the views first <= v < last; local: the length of a local row."""
    for v in range(first, last):
        start, n = offsets[v], offsets[v + 1] - offsets[v]
        cost[v] = _view(
            rows, local, parameters[camera[v]], T[v], theta[0], points, modes, uv, weight, start, n, loss, scale_sq,
            H[v], g[v],
        )  # fmt: skip
