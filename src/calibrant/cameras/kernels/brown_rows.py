"""Compiled rows of Brown's model; see `kernels` for the contract and `brown` for the equations."""

from __future__ import annotations

import numpy as np

from calibrant.cameras.kernels.contract import FAST, ROWS_ARGUMENTS
from calibrant.compiled import compiled_for_pointer


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def rows(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy = parameters[0], parameters[1], parameters[2], parameters[3]
    k1, k2, p1, p2, k3 = parameters[4], parameters[5], parameters[6], parameters[7], parameters[8]
    unseen = 0
    for i in range(n):
        z = p[2, i]
        unseen += 0 if z > 0.0 else 1
        iz = 1.0 / z if z > 0.0 else np.nan
        x, y = p[0, i] * iz, p[1, i] * iz
        x2, y2, xy2 = x * x, y * y, 2.0 * x * y
        r2 = x2 + y2
        r4 = r2 * r2
        r6 = r4 * r2
        g = 1.0 + k1 * r2 + k2 * r4 + k3 * r6
        h = 2.0 * k1 + 4.0 * k2 * r2 + 6.0 * k3 * r4
        tx, ty = r2 + 2.0 * x2, r2 + 2.0 * y2
        xd = x * g + p1 * xy2 + p2 * tx
        yd = y * g + p1 * ty + p2 * xy2
        xx = g + h * x2 + 2.0 * p1 * y + 6.0 * p2 * x
        xy = 0.5 * h * xy2 + 2.0 * p1 * x + 2.0 * p2 * y
        yy = g + h * y2 + 6.0 * p1 * y + 2.0 * p2 * x
        uv[0, i], uv[1, i] = fx * xd + cx, fy * yd + cy
        fxz, fyz = fx * iz, fy * iz
        J_point[0, i], J_point[1, i], J_point[2, i] = fxz * xx, fxz * xy, -fxz * (xx * x + xy * y)
        J_point[3, i], J_point[4, i], J_point[5, i] = fyz * xy, fyz * yy, -fyz * (xy * x + yy * y)
        fxx, fyy = fx * x, fy * y
        J_parameters[0, i], J_parameters[1, i], J_parameters[2, i], J_parameters[3, i] = xd, 0.0, 1.0, 0.0
        J_parameters[4, i], J_parameters[5, i], J_parameters[6, i] = fxx * r2, fxx * r4, fx * xy2
        J_parameters[7, i], J_parameters[8, i] = fx * tx, fxx * r6
        J_parameters[9, i], J_parameters[10, i], J_parameters[11, i], J_parameters[12, i] = 0.0, yd, 0.0, 1.0
        J_parameters[13, i], J_parameters[14, i], J_parameters[15, i] = fyy * r2, fyy * r4, fy * ty
        J_parameters[16, i], J_parameters[17, i] = fy * xy2, fyy * r6
    return unseen
