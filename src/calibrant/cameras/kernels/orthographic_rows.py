"""Compiled rows of the orthographic model; see `kernels` for the contract and `orthographic` for the equations."""

from __future__ import annotations

import numpy as np

from calibrant.cameras.kernels.contract import FAST, ROWS_ARGUMENTS
from calibrant.compiled import compiled_for_pointer


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def rows(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy = parameters[0], parameters[1], parameters[2], parameters[3]
    unseen = 0
    for i in range(n):
        seen = p[2, i] > 0.0
        unseen += 0 if seen else 1
        x, y = p[0, i] if seen else np.nan, p[1, i] if seen else np.nan
        zero = 0.0 if seen else np.nan
        uv[0, i], uv[1, i] = fx * x + cx, fy * y + cy
        J_point[0, i], J_point[1, i], J_point[2, i] = fx + zero, zero, zero
        J_point[3, i], J_point[4, i], J_point[5, i] = zero, fy + zero, zero
        J_parameters[0, i], J_parameters[1, i], J_parameters[2, i], J_parameters[3, i] = x, 0.0, 1.0, 0.0
        J_parameters[4, i], J_parameters[5, i], J_parameters[6, i], J_parameters[7, i] = 0.0, y, 0.0, 1.0
    return unseen
