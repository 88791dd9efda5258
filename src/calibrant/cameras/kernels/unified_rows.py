"""Compiled rows of the unified model; see `kernels` for the contract and `unified` for the equations."""

from __future__ import annotations

import numpy as np

from calibrant.cameras.kernels.contract import FAST, ROWS_ARGUMENTS
from calibrant.compiled import compiled_for_pointer


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def rows(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy, skew, xi = parameters[0], parameters[1], parameters[2], parameters[3], parameters[4], parameters[5]
    k1, k2, p1, p2 = parameters[6], parameters[7], parameters[8], parameters[9]
    w = xi if xi <= 1.0 else 1.0 / xi
    unseen = 0
    J = J_parameters
    for i in range(n):
        X, Y, Z = p[0, i], p[1, i], p[2, i]
        norm = np.sqrt(X * X + Y * Y + Z * Z)
        seen = Z + w * norm > 0.0 and norm > 0.0
        unseen += 0 if seen else 1
        iD = 1.0 / (Z + xi * norm) if seen else np.nan
        x, y = X * iD, Y * iD
        x2, y2, xy2 = x * x, y * y, 2.0 * x * y
        r2 = x2 + y2
        r4 = r2 * r2
        g, h = 1.0 + k1 * r2 + k2 * r4, 2.0 * k1 + 4.0 * k2 * r2
        tx, ty = r2 + 2.0 * x2, r2 + 2.0 * y2
        xd, yd = x * g + p1 * xy2 + p2 * tx, y * g + p1 * ty + p2 * xy2
        xx = g + h * x2 + 2.0 * p1 * y + 6.0 * p2 * x
        xy = 0.5 * h * xy2 + 2.0 * p1 * x + 2.0 * p2 * y
        yy = g + h * y2 + 6.0 * p1 * y + 2.0 * p2 * x
        uv[0, i], uv[1, i] = fx * xd + skew * yd + cx, fy * yd + cy
        ux, uy, vx, vy = fx * xx + skew * xy, fx * xy + skew * yy, fy * xy, fy * yy
        b = xi / norm
        u, v = ux * x + uy * y, vx * x + vy * y
        J_point[0, i], J_point[1, i] = iD * (ux - u * b * X), iD * (uy - u * b * Y)
        J_point[2, i] = -iD * u * (1.0 + b * Z)
        J_point[3, i], J_point[4, i] = iD * (vx - v * b * X), iD * (vy - v * b * Y)
        J_point[5, i] = -iD * v * (1.0 + b * Z)
        J[0, i], J[1, i], J[2, i], J[3, i], J[4, i] = xd, 0.0, 1.0, 0.0, yd
        J[10, i], J[11, i], J[12, i], J[13, i], J[14, i] = 0.0, yd, 0.0, 1.0, 0.0
        J[5, i], J[15, i] = -norm * iD * u, -norm * iD * v
        s, t = fx * x + skew * y, fy * y
        J[6, i], J[7, i] = s * r2, s * r4
        J[8, i], J[9, i] = fx * xy2 + skew * ty, fx * tx + skew * xy2
        J[16, i], J[17, i], J[18, i], J[19, i] = t * r2, t * r4, fy * ty, fy * xy2
    return unseen
