"""Compiled rows of the splined model, one function a grid; see `kernels` for the contract and `splined`."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit

from calibrant.cameras.kernels import FAST, ROWS_ARGUMENTS


@lru_cache(maxsize=64)
def rows_of(columns: int, count: int, spacing: float) -> Any:
    """The compiled rows of a grid of columns x count control points, `spacing` apart."""
    nodes = columns * count
    reach_x, reach_y = spacing * (columns - 3) / 2, spacing * (count - 3) / 2

    @njit(ROWS_ARGUMENTS, cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def rows(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
        fx, fy, cx, cy = parameters[0], parameters[1], parameters[2], parameters[3]
        k = 4 + 2 * nodes
        J_parameters[:, :n] = 0.0
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
                    J_parameters[node, i] = fx * w
                    J_parameters[k + nodes + node, i] = fy * w
            uv[0, i], uv[1, i] = fx * mx + cx, fy * my + cy
            a00, a01, a11 = S + X * X * T, X * Y * T, S + Y * Y * T
            J_point[0, i], J_point[1, i] = fx * (xx * a00 + xy * a01), fx * (xx * a01 + xy * a11)
            J_point[2, i] = fx * S_z * (xx * X + xy * Y)
            J_point[3, i], J_point[4, i] = fy * (yx * a00 + yy * a01), fy * (yx * a01 + yy * a11)
            J_point[5, i] = fy * S_z * (yx * X + yy * Y)
            J_parameters[0, i], J_parameters[2, i] = mx, 1.0
            J_parameters[k + 1, i], J_parameters[k + 3, i] = my, 1.0
        return unseen

    return rows


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _basis(t, w, d):  # type: ignore[no-untyped-def]
    """The four cubic B-splines over a cell at t, and their slopes."""
    s = 1.0 - t
    w[0], w[3] = s * s * s / 6.0, t * t * t / 6.0
    w[1] = (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0
    w[2] = (-3.0 * t * t * t + 3.0 * t * t + 3.0 * t + 1.0) / 6.0
    d[0], d[1] = -0.5 * s * s, 0.5 * (3.0 * t * t - 4.0 * t)
    d[2], d[3] = 0.5 * (-3.0 * t * t + 2.0 * t + 1.0), 0.5 * t * t
