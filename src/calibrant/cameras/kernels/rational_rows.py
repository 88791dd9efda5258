"""Compiled rows of the rational, thin prism and tilted models; equations in `plane_distortion`, contract in `kernels`.

The three differ in how many of the fourteen terms they have; the count is a constant in each, so that the terms it
lacks cost next to nothing.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from calibrant.cameras.kernels.contract import FAST, ROWS_ARGUMENTS
from calibrant.compiled import compiled_for_pointer


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy", inline="always")
def _fill(count, n, a, p, uv, J_point, J):  # type: ignore[no-untyped-def]
    k = 4 + count
    fx, fy, cx, cy = a[0], a[1], a[2], a[3]
    k1, k2, p1, p2, k3, k4, k5, k6 = a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11]
    s1, s2, s3, s4 = 0.0, 0.0, 0.0, 0.0
    s, c, S, C = 0.0, 1.0, 0.0, 1.0
    if count > 8:
        s1, s2, s3, s4 = a[12], a[13], a[14], a[15]
    if count > 12:
        s, c, S, C = np.sin(a[16]), np.cos(a[16]), np.sin(a[17]), np.cos(a[17])
    unseen = 0
    for i in range(n):
        z = p[2, i]
        unseen += 0 if z > 0.0 else 1
        iz = 1.0 / z if z > 0.0 else np.nan
        x, y = p[0, i] * iz, p[1, i] * iz
        xy2, r2 = 2.0 * x * y, x * x + y * y
        r4 = r2 * r2
        r6 = r4 * r2
        iD = 1.0 / (1.0 + k4 * r2 + k5 * r4 + k6 * r6)
        g = (1.0 + k1 * r2 + k2 * r4 + k3 * r6) * iD
        h = 2.0 * (k1 + 2.0 * k2 * r2 + 3.0 * k3 * r4 - g * (k4 + 2.0 * k5 * r2 + 3.0 * k6 * r4)) * iD
        tx, ty = r2 + 2.0 * x * x, r2 + 2.0 * y * y
        q1, q3 = 2.0 * s1 + 4.0 * s2 * r2, 2.0 * s3 + 4.0 * s4 * r2
        xd = x * g + p1 * xy2 + p2 * tx + s1 * r2 + s2 * r4
        yd = y * g + p1 * ty + p2 * xy2 + s3 * r2 + s4 * r4
        cross = h * x * y + 2.0 * p1 * x + 2.0 * p2 * y
        xx, xy = g + h * x * x + 2.0 * p1 * y + 6.0 * p2 * x + q1 * x, cross + q1 * y
        yx, yy = cross + q3 * x, g + h * y * y + 6.0 * p1 * y + 2.0 * p2 * x + q3 * y
        # u = fx e(xd, yd): the tilt's coordinates and the focal lengths times its derivatives, identity without one
        e0, e1, e2, e3 = fx, 0.0, 0.0, fy
        u, v = xd, yd
        if count > 12:
            iw = 1.0 / (S * xd - C * s * yd + C * c)
            u, v = c * xd * iw, (C * yd - s * S * xd) * iw
            e0, e1 = fx * (c - u * S) * iw, fx * u * C * s * iw
            e2, e3 = fy * (-s * S - v * S) * iw, fy * (C + v * C * s) * iw
            by_w = C * xd + S * s * yd - S * c
            J[16, i] = fx * (-s * xd + u * (C * c * yd + C * s)) * iw
            J[k + 16, i] = fy * (-c * S * xd + v * (C * c * yd + C * s)) * iw
            J[17, i] = -fx * u * by_w * iw
            J[k + 17, i] = fy * (-s * C * xd - S * yd - v * by_w) * iw
        uv[0, i], uv[1, i] = fx * u + cx, fy * v + cy
        ux, uy, vx, vy = e0 * xx + e1 * yx, e0 * xy + e1 * yy, e2 * xx + e3 * yx, e2 * xy + e3 * yy
        J_point[0, i], J_point[1, i], J_point[2, i] = ux * iz, uy * iz, -(ux * x + uy * y) * iz
        J_point[3, i], J_point[4, i], J_point[5, i] = vx * iz, vy * iz, -(vx * x + vy * y) * iz
        J[0, i], J[1, i], J[2, i], J[3, i] = u, 0.0, 1.0, 0.0
        J[k, i], J[k + 1, i], J[k + 2, i], J[k + 3, i] = 0.0, v, 0.0, 1.0
        gu, gv = (e0 * x + e1 * y) * iD, (e2 * x + e3 * y) * iD
        J[4, i], J[5, i], J[8, i] = gu * r2, gu * r4, gu * r6
        J[k + 4, i], J[k + 5, i], J[k + 8, i] = gv * r2, gv * r4, gv * r6
        J[6, i], J[7, i] = e0 * xy2 + e1 * ty, e0 * tx + e1 * xy2
        J[k + 6, i], J[k + 7, i] = e2 * xy2 + e3 * ty, e2 * tx + e3 * xy2
        J[9, i], J[10, i], J[11, i] = -g * gu * r2, -g * gu * r4, -g * gu * r6
        J[k + 9, i], J[k + 10, i], J[k + 11, i] = -g * gv * r2, -g * gv * r4, -g * gv * r6
        if count > 8:
            J[12, i], J[13, i], J[14, i], J[15, i] = e0 * r2, e0 * r4, e1 * r2, e1 * r4
            J[k + 12, i], J[k + 13, i], J[k + 14, i], J[k + 15, i] = e2 * r2, e2 * r4, e3 * r2, e3 * r4
    return unseen


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def rational(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    return _fill(8, n, parameters, p, uv, J_point, J_parameters)


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def thin_prism(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    return _fill(12, n, parameters, p, uv, J_point, J_parameters)


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def tilted(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    return _fill(14, n, parameters, p, uv, J_point, J_parameters)
