"""Compiled inverse of the unified model; see `kernels` for the contract and `unified` for the equations.

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
    """Unit rays of pixels: distortion undone by `plane_rows.invert_block`, then lifted onto the sphere."""
    cx, cy, skew, xi = parameters[2], parameters[3], parameters[4], parameters[5]
    k1, k2, p1, p2 = parameters[6], parameters[7], parameters[8], parameters[9]
    n = uv.shape[0]
    ifx, ify = 1.0 / parameters[0], 1.0 / parameters[1]
    largest = 1e-12
    for i in range(n):
        b = (uv[i, 1] - cy) * ify
        a = (uv[i, 0] - cx - skew * b) * ifx
        s = a * a + b * b
        largest = s if s > largest else largest
    table = guess_table(k1, k2, 0.0, limit, largest)
    lost = 0
    for block in prange((n + BLOCK - 1) // BLOCK):
        first = block * BLOCK
        m = min(BLOCK, n - first)
        w = np.empty((5, BLOCK))
        for i in range(m):
            w[1, i] = (uv[first + i, 1] - cy) * ify
            w[0, i] = (uv[first + i, 0] - cx - skew * w[1, i]) * ifx
        invert_block(k1, k2, p1, p2, 0.0, table, TABLE / largest, limit, m, w[0], w[1], w[2], w[3], w[4])
        for i in range(m):
            x, y = w[2, i], w[3, i]
            r2 = x * x + y * y
            root = 1.0 + (1.0 - xi * xi) * r2
            ok = w[4, i] > 0.0 and root >= 0.0
            lost += 0 if ok else 1
            k = (xi + np.sqrt(root)) / (1.0 + r2) if ok else np.nan
            out[first + i, 0], out[first + i, 1], out[first + i, 2] = k * x, k * y, k - xi
    return lost
