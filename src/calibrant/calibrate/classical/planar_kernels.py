"""Compiled homographies of many views, for the closed-form start."""

from __future__ import annotations

import numpy as np
from numba import types

from calibrant.cameras.kernels.contract import FAST
from calibrant.compiled import compiled, compiled_part

_f1, _f2, _f3 = types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
_constant_plane = types.Array(types.float64, 2, "C", readonly=True)  # writable arrays convert
_constant_offsets = types.Array(types.int64, 1, "C", readonly=True)


@compiled_part(types.UniTuple(types.float64, 3)(_constant_plane, types.int64, types.int64))
def _similarity(xy, first, n):  # type: ignore[no-untyped-def]
    """Centroid and scale that bring points to mean 0 and mean distance sqrt(2) (Hartley's normalisation)."""
    mx, my = 0.0, 0.0
    for i in range(first, first + n):
        mx += xy[i, 0]
        my += xy[i, 1]
    mx, my = mx / n, my / n
    spread = 0.0
    for i in range(first, first + n):
        spread += np.sqrt((xy[i, 0] - mx) * (xy[i, 0] - mx) + (xy[i, 1] - my) * (xy[i, 1] - my))
    return mx, my, (np.sqrt(2.0) * n / spread if spread > 0.0 else 0.0)


@compiled_part(
    types.void(_constant_plane, _constant_plane, types.int64, types.int64, *6 * [types.float64], _f2),
    fastmath=FAST,
    forceinline=True,
)
def _moments(plane, image, first, n, px, py, ps, qx, qy, qs, M):  # type: ignore[no-untyped-def]
    """M (4, 6): sums over the points of (xx, xy, x, yy, y, 1) times (1, u, w, u^2 + w^2), normalised coordinates.

    The normal equations of a homography hold nothing else: 24 sums in place of 90.
    """
    m = np.empty(24)
    for a in range(24):
        m[a] = 0.0
    for i in range(first, first + n):
        x, y = (plane[i, 0] - px) * ps, (plane[i, 1] - py) * ps
        u, w = (image[i, 0] - qx) * qs, (image[i, 1] - qy) * qs
        xx, xy, yy, s = x * x, x * y, y * y, u * u + w * w
        m[0] += xx
        m[1] += xy
        m[2] += x
        m[3] += yy
        m[4] += y
        m[5] += 1.0
        m[6] += u * xx
        m[7] += u * xy
        m[8] += u * x
        m[9] += u * yy
        m[10] += u * y
        m[11] += u
        m[12] += w * xx
        m[13] += w * xy
        m[14] += w * x
        m[15] += w * yy
        m[16] += w * y
        m[17] += w
        m[18] += s * xx
        m[19] += s * xy
        m[20] += s * x
        m[21] += s * yy
        m[22] += s * y
        m[23] += s
    for a in range(24):
        M[a // 6, a % 6] = m[a]


@compiled_part(types.void(_f2, _f2))
def _normal_matrix(M, A):  # type: ignore[no-untyped-def]
    """Lower triangle of the normal equations A (9, 9), right side in its last row, from the moments.

    Rows (x, y, 1, 0, 0, 0, -u x, -u y | u) and (0, 0, 0, x, y, 1, -w x, -w y | w): with p = (x, y, 1), the blocks are
    sum p p^T twice, and -sum u p p^T, -sum w p p^T, sum (u^2 + w^2) p p^T under them.
    """
    for r in range(9):
        for c in range(9):
            A[r, c] = 0.0
    for r in range(3):
        for c in range(3):
            low, high = min(r, c), max(r, c)
            k = low * 3 + high - (low * (low + 1)) // 2
            A[r, c] = A[3 + r, 3 + c] = M[0, k]
            A[6 + r, c] = -M[1, k]
            A[6 + r, 3 + c] = -M[2, k]
            A[6 + r, 6 + c] = M[3, k]
    for c in range(8):
        A[8, c] = -A[8, c]


@compiled(types.void(_constant_plane, _constant_plane, _constant_offsets, _f3, _f1))
def homographies(plane, image, offsets, H, condition):  # type: ignore[no-untyped-def]
    """H (m, 3, 3) with image ~ H plane for every view, normal equations in normalised coordinates with h33 = 1.

    In normalised coordinates h33 is the scale at the centroid of the points, which is visible, so it is never 0.
    condition[v]: smallest pivot over its diagonal, near 0 when the points are too few or on a line: H is undefined.
    """
    A = np.empty((9, 9))
    M = np.empty((4, 6))
    for v in range(offsets.shape[0] - 1):
        first, n = offsets[v], offsets[v + 1] - offsets[v]
        px, py, ps = _similarity(plane, first, n)
        qx, qy, qs = _similarity(image, first, n)
        _moments(plane, image, first, n, px, py, ps, qx, qy, qs, M)
        _normal_matrix(M, A)
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
