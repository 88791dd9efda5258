"""Compiled rows of the double sphere model; see `kernels` for the contract and `double_sphere` for the equations."""

from __future__ import annotations

import numpy as np

from calibrant.cameras.kernels.contract import FAST, ROWS_ARGUMENTS
from calibrant.cameras.kernels.radial_rows import place
from calibrant.compiled import compiled_for_pointer


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def rows(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    fx, fy, xi, alpha = parameters[0], parameters[1], parameters[4], parameters[5]
    w1 = alpha / (1.0 - alpha) if alpha <= 0.5 else (1.0 - alpha) / alpha
    w2 = (w1 + xi) / np.sqrt(2.0 * w1 * xi + xi * xi + 1.0)
    unseen = 0
    for i in range(n):
        x, y, z = p[0, i], p[1, i], p[2, i]
        R2 = x * x + y * y
        d1 = np.sqrt(R2 + z * z)
        seen = z > -w2 * d1 and d1 > 0.0
        unseen += 0 if seen else 1
        zz = xi * d1 + z
        d2 = np.sqrt(R2 + zz * zz)
        S = 1.0 / (alpha * d2 + (1.0 - alpha) * zz) if seen else np.nan
        S2, a, b = S * S, alpha / d2, xi / d1
        along = a * zz + 1.0 - alpha
        T = -S2 * (a * (1.0 + zz * b) + (1.0 - alpha) * b)
        place(i, 6, parameters, x, y, S, T, -S2 * along * (b * z + 1.0), uv, J_point, J_parameters)
        by_xi, by_alpha = -S2 * along * d1, S2 * (zz - d2)
        J_parameters[4, i], J_parameters[5, i] = fx * x * by_xi, fx * x * by_alpha
        J_parameters[10, i], J_parameters[11, i] = fy * y * by_xi, fy * y * by_alpha
    return unseen
