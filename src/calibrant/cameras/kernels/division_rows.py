"""Compiled rows of the division model; see `kernels` for the contract and `division` for the equations."""

from __future__ import annotations

import numpy as np
from numba import njit

from calibrant.cameras.kernels.contract import FAST, ROWS_ARGUMENTS
from calibrant.cameras.kernels.plane_rows import radius_limit
from calibrant.cameras.kernels.radial_rows import place
from calibrant.compiled import compiled_for_pointer


@njit(cache=True, nogil=True, error_model="numpy")
def _limit(l1, l2, l3):  # type: ignore[no-untyped-def]
    """s where w - 2 s w' = 0 first; the cubic that `plane_rows.radius_limit` solves, for the root of s."""
    r = radius_limit(-l1 / 3.0, -3.0 * l2 / 5.0, -5.0 * l3 / 7.0)
    return r * r


@njit(cache=True, nogil=True, error_model="numpy")
def _scale(l1, l2, l3, limit, R2, z):  # type: ignore[no-untyped-def]
    """S with S Z = w(S^2 R2) before the limit: Newton's method within its bracket, on S |p|."""
    norm = np.sqrt(R2 + z * z)
    c, q = z / norm, R2 / (norm * norm)
    low, high = 0.0, min(np.sqrt(limit / max(q, 1e-300)), 1e9)
    if not np.isfinite(limit):
        high = 1.0
        for _ in range(40):
            s = high * high * q
            if high * c - 1.0 - s * (l1 + s * (l2 + s * l3)) >= 0.0:
                break
            high *= 2.0
    x = min(2.0 / (c + np.sqrt(max(c * c - 4.0 * l1 * q, 1e-12))), high)
    for _ in range(200):
        s = x * x * q
        error = x * c - 1.0 - s * (l1 + s * (l2 + s * l3))
        if error < 0.0:
            low = x
        else:
            high = x
        trial = x - error / (c - 2.0 * x * q * (l1 + s * (2.0 * l2 + s * 3.0 * l3)))
        if not (trial >= low and trial <= high):
            trial = 0.5 * (low + high)
        if abs(trial - x) <= 1e-15 * x:
            return trial / norm
        x = trial
    return x / norm


@compiled_for_pointer(ROWS_ARGUMENTS, fastmath=FAST)
def rows(n, parameters, p, uv, J_point, J_parameters):  # type: ignore[no-untyped-def]
    fx, fy, l1, l2, l3 = parameters[0], parameters[1], parameters[4], parameters[5], parameters[6]
    limit = _limit(l1, l2, l3)
    backwards = l1 < 0.0 or l2 < 0.0 or l3 < 0.0
    rim = limit * (l1 + limit * (l2 + limit * l3)) + 1.0 if np.isfinite(limit) else 0.0
    root = np.sqrt(limit)
    unseen = 0
    for i in range(n):
        x, y, z = p[0, i], p[1, i], p[2, i]
        R2 = x * x + y * y
        if np.isfinite(limit):
            seen = z * root > np.sqrt(R2) * rim
        else:
            seen = z > 0.0 or (R2 > 0.0 and backwards)
        unseen += 0 if seen else 1
        S = _scale(l1, l2, l3, limit, R2, z) if seen else np.nan
        s = S * S * R2
        slope = l1 + s * (2.0 * l2 + s * 3.0 * l3)
        iF = 1.0 / (z - 2.0 * S * R2 * slope)
        place(i, 7, parameters, x, y, S, 2.0 * S * S * slope * iF, -S * iF, uv, J_point, J_parameters)
        u, v, t = fx * x * iF, fy * y * iF, s
        for c in range(3):
            J_parameters[4 + c, i], J_parameters[11 + c, i] = u * t, v * t
            t *= s
    return unseen
