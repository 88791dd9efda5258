"""Compiled homographies of many views, for the closed-form start."""

from __future__ import annotations

import numpy as np
from numba import njit, types

_f1, _f2, _f3 = types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
_i1 = types.int64[::1]


@njit(cache=True, nogil=True, error_model="numpy")
def _similarity(xy, first, n):  # type: ignore[no-untyped-def]
    """Centroid and scale that bring points to mean 0 and mean distance sqrt(2) (Hartley's normalisation)."""
    mx, my = 0.0, 0.0
    for i in range(first, first + n):
        mx += xy[i, 0]
        my += xy[i, 1]
    mx, my = mx / n, my / n
    spread = 0.0
    for i in range(first, first + n):
        spread += np.sqrt((xy[i, 0] - mx) ** 2 + (xy[i, 1] - my) ** 2)
    return mx, my, (np.sqrt(2.0) * n / spread if spread > 0.0 else 0.0)


@njit(types.void(_f2, _f2, _i1, _f3, _f1), cache=True, nogil=True, error_model="numpy")
def homographies(plane, image, offsets, H, condition):  # type: ignore[no-untyped-def]
    """H (m, 3, 3) with image ~ H plane for every view, normal equations in normalised coordinates with h33 = 1.

    In normalised coordinates h33 is the scale at the centroid of the points, which is visible, so it is never 0.
    condition[v]: smallest pivot over its diagonal, near 0 when the points are too few or on a line; H is then undefined.
    """
    A = np.empty((9, 9))
    row = np.empty((2, 9))
    for v in range(offsets.shape[0] - 1):
        first, n = offsets[v], offsets[v + 1] - offsets[v]
        px, py, ps = _similarity(plane, first, n)
        qx, qy, qs = _similarity(image, first, n)
        A[:] = 0.0
        for i in range(first, first + n):
            x, y = (plane[i, 0] - px) * ps, (plane[i, 1] - py) * ps
            u, w = (image[i, 0] - qx) * qs, (image[i, 1] - qy) * qs
            row[0, 0], row[0, 1], row[0, 2], row[0, 3], row[0, 4] = x, y, 1.0, 0.0, 0.0
            row[0, 5], row[0, 6], row[0, 7], row[0, 8] = 0.0, -u * x, -u * y, u
            row[1, 0], row[1, 1], row[1, 2], row[1, 3], row[1, 4] = 0.0, 0.0, 0.0, x, y
            row[1, 5], row[1, 6], row[1, 7], row[1, 8] = 1.0, -w * x, -w * y, w
            for a in range(9):
                for b in range(a + 1):
                    A[a, b] += row[0, a] * row[0, b] + row[1, a] * row[1, b]
        # Cholesky of the leading 8x8; its ninth row then holds L^-1 rhs.
        worst = 1.0
        for a in range(8):
            own = A[a, a]
            for k in range(a):
                A[a, a] -= A[a, k] * A[a, k]
            ratio = A[a, a] / own if own > 0.0 else 0.0
            worst = min(worst, ratio)
            root = np.sqrt(A[a, a]) if A[a, a] > 0.0 else 1.0
            A[a, a] = root
            for b in range(a + 1, 9):
                for k in range(a):
                    A[b, a] -= A[b, k] * A[a, k]
                A[b, a] /= root
        condition[v] = worst
        h = np.empty(9)
        for a in range(7, -1, -1):
            total = A[8, a]
            for k in range(a + 1, 8):
                total -= A[k, a] * h[k]
            h[a] = total / A[a, a]
        h[8] = 1.0
        # Undo the normalisation: T_image^-1 H T_plane.
        for r in range(3):
            a, b, c = h[3 * r] * ps, h[3 * r + 1] * ps, h[3 * r + 2]
            H[v, r, 0], H[v, r, 1], H[v, r, 2] = a, b, c - a * px - b * py
        for c in range(3):
            H[v, 0, c] = H[v, 0, c] / qs + qx * H[v, 2, c]
            H[v, 1, c] = H[v, 1, c] / qs + qy * H[v, 2, c]
