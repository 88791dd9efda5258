"""Compiled inverse of Brown's model; see `kernels` for the contract and `brown` for the equations.

Apart from the rows: a calibration does not ask for it, and code for several threads takes its time to load.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from calibrant.cameras.kernels.contract import FAST, RAYS_ARGUMENTS
from calibrant.cameras.kernels.plane_rows import BLOCK, TABLE, guess_table, invert_block
from calibrant.compiled import compiled


@compiled(RAYS_ARGUMENTS, fastmath=FAST, parallel=True)
def rays(parameters, limit, uv, out):  # type: ignore[no-untyped-def]
    """Unit rays of pixels; see `plane_rows.invert_block` for the iteration."""
    fx, fy, cx, cy = parameters[0], parameters[1], parameters[2], parameters[3]
    k1, k2, p1, p2, k3 = parameters[4], parameters[5], parameters[6], parameters[7], parameters[8]
    n = uv.shape[0]
    ifx, ify = 1.0 / fx, 1.0 / fy
    largest = 1e-12
    for i in range(n):
        a, b = (uv[i, 0] - cx) * ifx, (uv[i, 1] - cy) * ify
        s = a * a + b * b
        largest = s if s > largest else largest
    table = guess_table(k1, k2, k3, limit, largest)
    lost = 0
    for block in prange((n + BLOCK - 1) // BLOCK):
        first = block * BLOCK
        m = min(BLOCK, n - first)
        w = np.empty((5, BLOCK))
        for i in range(m):
            w[0, i], w[1, i] = (uv[first + i, 0] - cx) * ifx, (uv[first + i, 1] - cy) * ify
        invert_block(k1, k2, p1, p2, k3, table, TABLE / largest, limit, m, w[0], w[1], w[2], w[3], w[4])
        for i in range(m):
            x, y = w[2, i], w[3, i]
            scale = 1.0 / np.sqrt(1.0 + x * x + y * y) if w[4, i] > 0.0 else np.nan
            lost += 0 if w[4, i] > 0.0 else 1
            out[first + i, 0], out[first + i, 1], out[first + i, 2] = x * scale, y * scale, scale
    return lost
