"""Compiled step of many poses; `geometry.se3.retract` is its readable form and its test.

A solve moves all poses once a step: for the tens of poses of an ordinary calibration, NumPy's calls cost more than the
arithmetic.
"""

from __future__ import annotations

import numpy as np
from numba import types

from calibrant.compiled import compiled

_constant = types.Array(types.float64, 3, "C", readonly=True)
_steps = types.Array(types.float64, 2, "C", readonly=True)


@compiled(types.void(_constant, _steps, types.float64[:, :, ::1]))
def retract(T, delta, out):  # type: ignore[no-untyped-def]
    """out = (exp(omega) R, t + v), delta = (omega, v); Rodrigues' formula as in `geometry.so3.exp`."""
    for i in range(T.shape[0]):
        x, y, z = delta[i, 0], delta[i, 1], delta[i, 2]
        s = x * x + y * y + z * z
        if s < 1e-8:
            a, b = 1.0 - s / 6.0, 0.5 - s / 24.0
        else:
            angle = np.sqrt(s)
            half = np.sin(0.5 * angle)
            a, b = np.sin(angle) / angle, 2.0 * half * half / s
        for column in range(3):
            u, v, w = T[i, 0, column], T[i, 1, column], T[i, 2, column]
            # c = omega x r, e = omega x c: exp(omega) r = r + a c + b e.
            cx, cy, cz = y * w - z * v, z * u - x * w, x * v - y * u
            out[i, 0, column] = u + a * cx + b * (y * cz - z * cy)
            out[i, 1, column] = v + a * cy + b * (z * cx - x * cz)
            out[i, 2, column] = w + a * cz + b * (x * cy - y * cx)
        for row in range(3):
            out[i, row, 3] = T[i, row, 3] + delta[i, 3 + row]
            out[i, 3, row] = 0.0
        out[i, 3, 3] = 1.0
