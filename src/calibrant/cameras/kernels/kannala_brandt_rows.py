"""Compiled rows of Kannala and Brandt's model; see `kernels` for the contract and `kannala_brandt`."""

from __future__ import annotations

import numpy as np

from calibrant.cameras.kernels.contract import FAST, ROWS_ARGUMENTS
from calibrant.cameras.kernels.radial_rows import place
from calibrant.compiled import compiled_for_pointer


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def rows(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    fx, fy = parameters[0], parameters[1]
    k1, k2, k3, k4 = parameters[4], parameters[5], parameters[6], parameters[7]
    unseen = 0
    for i in range(n):
        x, y, z = p[0, i], p[1, i], p[2, i]
        R2 = x * x + y * y
        R = np.sqrt(R2)
        seen = z > 0.0 or R > 0.0
        unseen += 0 if seen else 1
        theta = np.arctan2(R, z)
        t = theta * theta
        plain = np.nan
        if R > 0.0:
            plain = theta / R
        elif z > 0.0:
            plain = 1.0 / z
        S = plain * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))))
        slope = 1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4)))
        irho2 = 1.0 / (R2 + z * z)
        # Near the axis the slope of S is a difference of nearly equal numbers: its series instead.
        T = (2.0 * k1 - 2.0 / 3.0) / (z * z * z) if 1e-4 * z > R else (slope * z * irho2 - S) / R2
        place(i, 8, parameters, x, y, S, T, -slope * irho2 if seen else np.nan, uv, J_point, J_parameters)
        by = plain * t
        for c in range(4):
            J_parameters[4 + c, i], J_parameters[12 + c, i] = fx * x * by, fy * y * by
            by *= t
    return unseen
