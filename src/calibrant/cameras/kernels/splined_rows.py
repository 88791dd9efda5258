"""Compiled rows of the splined model; see `kernels` for the contracts and `splined` for the equations.

The grid's numbers are constants of a thin function a grid, which compiles in a moment; the work is done by one that all
grids share.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit, types

from calibrant.cameras.kernels.contract import FAST, LOCAL_ROWS_ARGUMENTS, ROWS_ARGUMENTS
from calibrant.compiled import compiled_part

LOCAL = 18
"""Parameters that one coordinate depends on: its focal length, its principal point and 16 control points."""
_GRID = (types.int64, types.int64, types.float64)
_PROJECT = types.int64(*LOCAL_ROWS_ARGUMENTS.args, *_GRID)
_SPREAD = types.int64(*ROWS_ARGUMENTS.args, *_GRID)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _basis(t, w, d):  # type: ignore[no-untyped-def]
    """The four cubic B-splines over a cell at t, and their slopes."""
    s = 1.0 - t
    w[0], w[3] = s * s * s / 6.0, t * t * t / 6.0
    w[1] = (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0
    w[2] = (-3.0 * t * t * t + 3.0 * t * t + 3.0 * t + 1.0) / 6.0
    d[0], d[1] = -0.5 * s * s, 0.5 * (3.0 * t * t - 4.0 * t)
    d[2], d[3] = 0.5 * (-3.0 * t * t + 2.0 * t + 1.0), 0.5 * t * t


@compiled_part(_PROJECT, fastmath=FAST)
def _project(n, parameters, p, uv, J_point, index, J_local, columns, count, spacing):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy = parameters[0], parameters[1], parameters[2], parameters[3]
    nodes = columns * count
    reach_x, reach_y = spacing * (columns - 3) / 2, spacing * (count - 3) / 2
    wx, wy, dx, dy = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    unseen = 0
    for i in range(n):
        X, Y, Z = p[0, i], p[1, i], p[2, i]
        norm = np.sqrt(X * X + Y * Y + Z * Z)
        depth = norm + Z
        seen = depth > 0.0 and 2.0 * abs(X) <= reach_x * depth and 2.0 * abs(Y) <= reach_y * depth
        if not seen:
            unseen += 1
            uv[:, i] = np.nan
            J_point[:, i] = np.nan
            index[i] = 0
            J_local[i] = np.nan
            continue
        S = 2.0 / depth
        T, S_z = -0.5 * S * S / norm, -S / norm
        qx, qy = S * X, S * Y
        gx, gy = qx / spacing + 0.5 * (columns - 1), qy / spacing + 0.5 * (count - 1)
        a, b = min(max(int(np.floor(gx)), 1), columns - 3), min(max(int(np.floor(gy)), 1), count - 3)
        _basis(gx - a, wx, dx)
        _basis(gy - b, wy, dy)
        mx, my, xx, xy, yx, yy = qx, qy, 1.0, 0.0, 0.0, 1.0
        for r in range(4):
            for c in range(4):
                node = 4 + (b - 1 + r) * columns + a - 1 + c
                w, u, v = wy[r] * wx[c], wy[r] * dx[c] / spacing, dy[r] * wx[c] / spacing
                px, py = parameters[node], parameters[nodes + node]
                mx += w * px
                my += w * py
                xx += u * px
                xy += v * px
                yx += u * py
                yy += v * py
                at = 2 + 4 * r + c
                index[i, 0, at], index[i, 1, at] = node, nodes + node
                J_local[i, 0, at], J_local[i, 1, at] = fx * w, fy * w
        uv[0, i], uv[1, i] = fx * mx + cx, fy * my + cy
        a00, a01, a11 = S + X * X * T, X * Y * T, S + Y * Y * T
        J_point[0, i], J_point[1, i] = fx * (xx * a00 + xy * a01), fx * (xx * a01 + xy * a11)
        J_point[2, i] = fx * S_z * (xx * X + xy * Y)
        J_point[3, i], J_point[4, i] = fy * (yx * a00 + yy * a01), fy * (yx * a01 + yy * a11)
        J_point[5, i] = fy * S_z * (yx * X + yy * Y)
        index[i, 0, 0], index[i, 0, 1], index[i, 1, 0], index[i, 1, 1] = 0, 2, 1, 3
        J_local[i, 0, 0], J_local[i, 0, 1], J_local[i, 1, 0], J_local[i, 1, 1] = mx, 1.0, my, 1.0
    return unseen


@compiled_part(_SPREAD)
def _spread(n, parameters, p, uv, J_point, J_parameters, columns, count, spacing):  # type: ignore[no-untyped-def]
    """The rows with a column for every parameter."""
    k = 4 + 2 * columns * count
    index, J_local = np.empty((n, 2, LOCAL), np.int64), np.empty((n, 2, LOCAL))
    unseen = _project(n, parameters, p, uv, J_point, index, J_local, columns, count, spacing)
    J_parameters[:, :n] = 0.0
    for i in range(n):
        for half in range(2):
            for at in range(LOCAL):
                J_parameters[half * k + index[i, half, at], i] = J_local[i, half, at]
    return unseen


@lru_cache(maxsize=64)
def rows_of(columns: int, count: int, spacing: float) -> Any:
    """The compiled rows of a grid of columns x count control points, `spacing` apart."""

    @njit(ROWS_ARGUMENTS, cache=True, nogil=True)
    def rows(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
        return _spread(n, parameters, p, uv, J_point, J_parameters, columns, count, spacing)

    return rows


@lru_cache(maxsize=64)
def local_rows_of(columns: int, count: int, spacing: float) -> Any:
    """The compiled local rows of the same grid."""

    @njit(LOCAL_ROWS_ARGUMENTS, cache=True, nogil=True)
    def rows(n, parameters, p, uv, J_point, index, J_local):  # type: ignore[no-untyped-def]
        return _project(n, parameters, p, uv, J_point, index, J_local, columns, count, spacing)

    return rows
