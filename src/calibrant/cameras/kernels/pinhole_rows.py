"""Compiled rows of the pinhole models; see `kernels` for the contract, `pinhole` and `pinhole_skew` for equations."""

from __future__ import annotations

import numpy as np

from calibrant.cameras.kernels.contract import FAST, ROWS_ARGUMENTS
from calibrant.compiled import compiled_for_pointer


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def rows(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy = parameters[0], parameters[1], parameters[2], parameters[3]
    unseen = 0
    for i in range(n):
        z = p[2, i]
        unseen += 0 if z > 0.0 else 1
        iz = 1.0 / z if z > 0.0 else np.nan
        x, y = p[0, i] * iz, p[1, i] * iz
        uv[0, i], uv[1, i] = fx * x + cx, fy * y + cy
        J_point[0, i], J_point[1, i], J_point[2, i] = fx * iz, 0.0, -fx * x * iz
        J_point[3, i], J_point[4, i], J_point[5, i] = 0.0, fy * iz, -fy * y * iz
        J_parameters[0, i], J_parameters[1, i], J_parameters[2, i], J_parameters[3, i] = x, 0.0, 1.0, 0.0
        J_parameters[4, i], J_parameters[5, i], J_parameters[6, i], J_parameters[7, i] = 0.0, y, 0.0, 1.0
    return unseen


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def skewed(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy, skew = parameters[0], parameters[1], parameters[2], parameters[3], parameters[4]
    unseen = 0
    for i in range(n):
        z = p[2, i]
        unseen += 0 if z > 0.0 else 1
        iz = 1.0 / z if z > 0.0 else np.nan
        x, y = p[0, i] * iz, p[1, i] * iz
        uv[0, i], uv[1, i] = fx * x + skew * y + cx, fy * y + cy
        J_point[0, i], J_point[1, i], J_point[2, i] = fx * iz, skew * iz, -(fx * x + skew * y) * iz
        J_point[3, i], J_point[4, i], J_point[5, i] = 0.0, fy * iz, -fy * y * iz
        J_parameters[0, i], J_parameters[1, i], J_parameters[2, i], J_parameters[3, i] = x, 0.0, 1.0, 0.0
        J_parameters[4, i], J_parameters[5, i], J_parameters[6, i] = y, 0.0, y
        J_parameters[7, i], J_parameters[8, i], J_parameters[9, i] = 0.0, 1.0, 0.0
    return unseen
