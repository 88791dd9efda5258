"""Compiled: which triangle of a surface each pixel sees."""

from __future__ import annotations

import numpy as np
from numba import types

from calibrant.compiled import compiled

_c3 = types.Array(types.float64, 3, "C", readonly=True)


@compiled(types.void(_c3, types.float64[:, ::1], types.int64[:, ::1]))
def draw(corners, nearest, index):  # type: ignore[no-untyped-def]
    """Draw triangles into `nearest` (h, w), 1/z, and `index` (h, w), over what is there already and farther.

    corners (m, 3, 3): u, v and 1/z of each triangle's corners; 1/z is linear between them. NaN are passed over.
    """
    h, w = nearest.shape
    for k in range(len(corners)):
        x0, y0, q0 = corners[k, 0, 0], corners[k, 0, 1], corners[k, 0, 2]
        x1, y1, q1 = corners[k, 1, 0], corners[k, 1, 1], corners[k, 1, 2]
        x2, y2, q2 = corners[k, 2, 0], corners[k, 2, 1], corners[k, 2, 2]
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if not (area > 1e-12 or area < -1e-12):
            continue
        left, right = max(min(x0, x1, x2), 0.0), min(max(x0, x1, x2), w - 1.0)
        top, bottom = max(min(y0, y1, y2), 0.0), min(max(y0, y1, y2), h - 1.0)
        for v in range(int(np.ceil(top)), int(np.floor(bottom)) + 1):
            for u in range(int(np.ceil(left)), int(np.floor(right)) + 1):
                a = ((x1 - u) * (y2 - v) - (x2 - u) * (y1 - v)) / area
                b = ((x2 - u) * (y0 - v) - (x0 - u) * (y2 - v)) / area
                c = 1 - a - b
                if a >= 0 and b >= 0 and c >= 0:
                    q = a * q0 + b * q1 + c * q2
                    if q > nearest[v, u]:
                        nearest[v, u] = q
                        index[v, u] = k
