"""Compiled rows of the inverse Brown model; see `kernels` for the contract and `inverse_brown` for the equations."""

from __future__ import annotations

import numpy as np
from numba import njit

from calibrant.cameras.kernels.contract import FAST, ROWS_ARGUMENTS
from calibrant.cameras.kernels.plane_rows import disc, radial_inverse
from calibrant.compiled import compiled_for_pointer


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _slope(k1, k2, p1, p2, k3, x, y):  # type: ignore[no-untyped-def]
    """g and the derivatives of the corrected coordinates."""
    s = x * x + y * y
    g = 1.0 + s * (k1 + s * (k2 + s * k3))
    h = 2.0 * k1 + s * (4.0 * k2 + s * 6.0 * k3)
    xx = g + h * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    xy = h * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    yy = g + h * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    return g, xx, xy, yy


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(k1, k2, p1, p2, k3, limit, X, Y):  # type: ignore[no-untyped-def]
    """x, y corrected to X, Y, and whether they were found: the radial part in its bracket, then damped Newton steps."""
    rd = np.sqrt(X * X + Y * Y)
    if not rd < np.inf:
        return np.nan, np.nan, False
    scale = radial_inverse(k1, k2, k3, limit, rd) / rd if rd > 0.0 else 1.0
    x, y = X * scale, Y * scale
    share, error = 1.0, np.inf
    nx, ny = x, y
    sx, sy, det = 0.0, 0.0, 1.0
    for _ in range(100):
        s = nx * nx + ny * ny
        g, xx, xy, yy = _slope(k1, k2, p1, p2, k3, nx, ny)
        ex = nx * g + 2.0 * p1 * nx * ny + p2 * (s + 2.0 * nx * nx) - X
        ey = ny * g + p1 * (s + 2.0 * ny * ny) + 2.0 * p2 * nx * ny - Y
        new = np.sqrt(ex * ex + ey * ey)
        if new < error:
            x, y, error = nx, ny, new
            det = xx * yy - xy * xy
            sx, sy = (yy * ex - xy * ey) / det, (xx * ey - xy * ex) / det
            share = min(1.0, 4.0 * share)
        else:
            share *= 0.25
        if error <= 1e-16 or share < 1e-6:
            break
        nx, ny = x - share * sx, y - share * sy
    # As in `plane_distortion`: resolved to 1e-12 of the focal length.
    return x, y, error < 1e-12 * (1.0 + rd) and det > 0.0 and np.sqrt(x * x + y * y) < limit


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def rows(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy = parameters[0], parameters[1], parameters[2], parameters[3]
    k1, k2, p1, p2, k3 = parameters[4], parameters[5], parameters[6], parameters[7], parameters[8]
    limit = disc(k1, k2, k3, np.sqrt(p1 * p1 + p2 * p2))
    unseen = 0
    J = J_parameters
    for i in range(n):
        iz = 1.0 / p[2, i] if p[2, i] > 0.0 else np.nan
        X, Y = p[0, i] * iz, p[1, i] * iz
        x, y, good = _solve(k1, k2, p1, p2, k3, limit, X, Y)
        unseen += 0 if good else 1
        x, y = (x, y) if good else (np.nan, np.nan)
        x2, y2, xy2 = x * x, y * y, 2.0 * x * y
        r2 = x2 + y2
        _, xx, xy, yy = _slope(k1, k2, p1, p2, k3, x, y)
        tx, ty = r2 + 2.0 * x2, r2 + 2.0 * y2
        idet = 1.0 / (xx * yy - xy * xy)
        a, b, c, d = fx * yy * idet, -fx * xy * idet, -fy * xy * idet, fy * xx * idet
        uv[0, i], uv[1, i] = fx * x + cx, fy * y + cy
        J_point[0, i], J_point[1, i], J_point[2, i] = a * iz, b * iz, -(a * X + b * Y) * iz
        J_point[3, i], J_point[4, i], J_point[5, i] = c * iz, d * iz, -(c * X + d * Y) * iz
        J[0, i], J[1, i], J[2, i], J[3, i] = x, 0.0, 1.0, 0.0
        J[9, i], J[10, i], J[11, i], J[12, i] = 0.0, y, 0.0, 1.0
        u, v = -(a * x + b * y), -(c * x + d * y)
        J[4, i], J[5, i], J[8, i] = u * r2, u * r2 * r2, u * r2 * r2 * r2
        J[13, i], J[14, i], J[17, i] = v * r2, v * r2 * r2, v * r2 * r2 * r2
        J[6, i], J[7, i] = -(a * xy2 + b * ty), -(a * tx + b * xy2)
        J[15, i], J[16, i] = -(c * xy2 + d * ty), -(c * tx + d * xy2)
    return unseen
