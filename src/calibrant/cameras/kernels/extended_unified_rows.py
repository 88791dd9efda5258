"""Compiled rows of the extended unified model; see `kernels` for the contract, `extended_unified` for equations."""

from __future__ import annotations

import numpy as np

from calibrant.cameras.kernels.contract import FAST, ROWS_ARGUMENTS
from calibrant.cameras.kernels.radial_rows import place
from calibrant.compiled import compiled_for_pointer


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def rows(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    fx, fy, alpha, beta = parameters[0], parameters[1], parameters[4], parameters[5]
    w = alpha / (1.0 - alpha) if alpha <= 0.5 else (1.0 - alpha) / alpha
    unseen = 0
    for i in range(n):
        x, y, z = p[0, i], p[1, i], p[2, i]
        R2 = x * x + y * y
        rho = np.sqrt(beta * R2 + z * z)
        seen = z > -w * rho and rho > 0.0
        unseen += 0 if seen else 1
        S = 1.0 / (alpha * rho + (1.0 - alpha) * z) if seen else np.nan
        S2, ratio = S * S, alpha / rho
        place(i, 6, parameters, x, y, S, -S2 * beta * ratio, -S2 * (ratio * z + 1.0 - alpha), uv, J_point, J_parameters)
        by_alpha, by_beta = S2 * (z - rho), -0.5 * S2 * ratio * R2
        J_parameters[4, i], J_parameters[5, i] = fx * x * by_alpha, fx * x * by_beta
        J_parameters[10, i], J_parameters[11, i] = fy * y * by_alpha, fy * y * by_beta
    return unseen
