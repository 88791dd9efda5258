"""Compiled sums of influence rows over clusters."""

from __future__ import annotations

from numba import types

from calibrant.compiled import compiled

_f2, _f3 = types.float64[:, ::1], types.float64[:, :, ::1]
_c2, _c3 = (types.Array(types.float64, n, "C", readonly=True) for n in (2, 3))
_i1 = types.Array(types.int64, 1, "C", readonly=True)


@compiled(types.void(_c3, _c2, _i1, _f2, _f3))
def add_rows(rows, e, labels, z, G):  # type: ignore[no-untyped-def]
    """z[g] += J^T e and G[g] += J^T J over the blocks J (d, p) of rows (N, d, p) with label g; e (N, d)."""
    N, d, p = rows.shape
    for i in range(N):
        g = labels[i]
        for h in range(d):
            for a in range(p):
                x = rows[i, h, a]
                z[g, a] += x * e[i, h]
                for b in range(a + 1):
                    G[g, a, b] += x * rows[i, h, b]
    for g in range(G.shape[0]):
        for a in range(p):
            for b in range(a):
                G[g, b, a] = G[g, a, b]
