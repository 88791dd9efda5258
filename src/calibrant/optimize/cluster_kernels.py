"""Compiled sums of influence rows over clusters, and their correction for what the fit took."""

from __future__ import annotations

import numpy as np
from numba import types

from calibrant.compiled import compiled

_f2, _f3 = types.float64[:, ::1], types.float64[:, :, ::1]
_c2, _c3 = (types.Array(types.float64, n, "C", readonly=True) for n in (2, 3))
_i1 = types.Array(types.int64, 1, "C", readonly=True)
_b1 = types.boolean[::1]

_CONVERGES = 0.25
"""Squared Frobenius norm of G up to which its series is shorter than eigenvalues: 1/2^k, of which 50 terms suffice."""


@compiled(types.void(_c3, _c2, _i1, _f2, _f3))
def add_rows(rows, e, labels, z, G):  # type: ignore[no-untyped-def]
    """z[g] += J^T e and G[g] += J^T J over the blocks J (d, p) of rows (N, d, p) with label g; e (N, d)."""
    N, d, p = rows.shape
    for i in range(N):
        g = labels[i]
        # Both triangles: a row as long as the next is taken several entries at a time.
        for h in range(d):
            J, r = rows[i, h], e[i, h]
            for a in range(p):
                x, row = J[a], G[g, a]
                z[g, a] += x * r
                for b in range(p):
                    row[b] += x * J[b]


@compiled(types.void(_c2, _c3, _f2, _f2, _b1))
def corrected(z, G, work, out, left):  # type: ignore[no-untyped-def]
    """out[g] = (I - G[g])^-1/2 z[g], (n, p), by the binomial series; left[g] where G[g] is too large for it.

    work (2, p): room for two terms. |G^k z| <= |G|^k |z|, and out is no shorter than z: what comes after a share of
    1e-17 is rounding.
    """
    n, p = z.shape
    for g in range(n):
        square = 0.0
        for a in range(p):
            for b in range(p):
                square += G[g, a, b] * G[g, a, b]
        left[g] = not square <= _CONVERGES
        if left[g]:
            continue
        norm = square**0.5
        share, k = 1.0, 0
        for a in range(p):
            work[0, a] = z[g, a]
            out[g, a] = z[g, a]
        bound = 1.0
        while bound > 1e-17:
            k += 1
            share *= (2 * k - 1) / (2 * k)
            bound *= norm
            for a in range(p):
                x = 0.0
                for b in range(p):
                    x += G[g, a, b] * work[0, b]
                work[1, a] = x
            for a in range(p):
                work[0, a] = work[1, a]
                out[g, a] += share * work[1, a]


@compiled(types.void(_c3, _c2, _i1, _f3))
def add_patterns(rows, at, labels, B):  # type: ignore[no-untyped-def]
    """B[g, c d + h] += w_c J[h] over the blocks J (d, p) with label g, w = 1, x, y: their places at (N, 2) from the
    cluster's mean, in units of its spread."""
    N, d, p = rows.shape
    n = B.shape[0]
    middle, spread, count = np.zeros((n, 2)), np.zeros(n), np.zeros(n)
    for i in range(N):
        g = labels[i]
        count[g] += 1
        for c in range(2):
            middle[g, c] += at[i, c]
    for g in range(n):
        for c in range(2):
            middle[g, c] /= max(count[g], 1.0)
    for i in range(N):
        g = labels[i]
        for c in range(2):
            spread[g] += (at[i, c] - middle[g, c]) ** 2
    for g in range(n):
        # Of one axis; a single block has no spread and no linear map.
        spread[g] = np.sqrt(0.5 * spread[g] / max(count[g], 1.0))
    for i in range(N):
        g = labels[i]
        unit = 1 / spread[g] if spread[g] > 0 else 0.0
        x, y = unit * (at[i, 0] - middle[g, 0]), unit * (at[i, 1] - middle[g, 1])
        for h in range(d):
            for a in range(p):
                J = rows[i, h, a]
                B[g, h, a] += J
                B[g, d + h, a] += x * J
                B[g, 2 * d + h, a] += y * J
