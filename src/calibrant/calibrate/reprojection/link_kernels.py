"""Compiled products of links: all edges in one pass; `links.product` and `links.link_maps` are the readable form.

A rig's problem asks for them once a camera and step: for its tens of views, NumPy's calls cost more than the
arithmetic.
"""

from __future__ import annotations

import numpy as np
from numba import types

from calibrant.compiled import compiled, compiled_part

_c2, _c3, _c4 = (types.Array(types.float64, n, "C", readonly=True) for n in (2, 3, 4))  # writable arrays convert
_f2, _f3, _f4 = types.float64[:, ::1], types.float64[:, :, ::1], types.float64[:, :, :, ::1]
_flags = types.Array(types.boolean, 1, "C", readonly=True)


@compiled_part(types.void(_c2, _f2))
def _copy(source, out):  # type: ignore[no-untyped-def]
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            out[i, j] = source[i, j]


@compiled_part(types.void(_c2, _f2))
def _inverse(T, out):  # type: ignore[no-untyped-def]
    for i in range(3):
        total = 0.0
        for j in range(3):
            out[i, j] = T[j, i]
            total -= T[j, i] * T[j, 3]
        out[i, 3] = total
        out[3, i] = 0.0
    out[3, 3] = 1.0


@compiled_part(types.void(_c2, _c2, _f2))
def _product(A, B, out):  # type: ignore[no-untyped-def]
    for i in range(3):
        for j in range(4):
            total = A[i, 3] if j == 3 else 0.0
            for k in range(3):
                total += A[i, k] * B[k, j]
            out[i, j] = total
        out[3, i] = 0.0
    out[3, 3] = 1.0


@compiled_part(types.void(_f2, _c2, _f2))
def _through_inverse(M, T, out):  # type: ignore[no-untyped-def]
    """M <- M [[-R^T, 0], [-R^T hat(t), -R^T]]: from the tangent of T to that of its inverse."""
    x, y, z = T[0, 3], T[1, 3], T[2, 3]
    for i in range(6):
        for j in range(3):
            first, second = 0.0, 0.0
            for k in range(3):
                first -= M[i, k] * T[j, k]
                second -= M[i, 3 + k] * T[j, k]
            out[i, j] = first
            out[i, 3 + j] = second
        # row of -M_v R^T times hat(t)
        a, b, c = out[i, 3], out[i, 4], out[i, 5]
        out[i, 0] += b * z - c * y
        out[i, 1] += c * x - a * z
        out[i, 2] += a * y - b * x
    _copy(out, M)


@compiled(types.void(_c4, _flags, _f3, _f4))
def products(links, inverted, T, maps):  # type: ignore[no-untyped-def]
    """T (m, 4, 4) = prod_k L_k and maps (m, n, 6, 6) from each link's tangent to T's; links (n, m, 4, 4)."""
    n = links.shape[0]
    factors, after = np.empty((n, 4, 4)), np.empty((n + 1, 4, 4))
    before, turned, inverse = np.empty((4, 4)), np.empty((4, 4)), np.empty((6, 6))
    arm = np.empty(3)
    for e in range(T.shape[0]):
        for k in range(n):
            if inverted[k]:
                _inverse(links[k, e], factors[k])
            else:
                _copy(links[k, e], factors[k])
        for i in range(4):
            for j in range(4):
                after[n, i, j] = 1.0 if i == j else 0.0
        for k in range(n - 1, -1, -1):
            _product(factors[k], after[k + 1], after[k])
        _copy(after[0], T[e])
        _copy(after[n], before)
        for k in range(n):
            M = maps[e, k]
            for i in range(3):
                arm[i] = 0.0
                for j in range(3):
                    arm[i] += factors[k, i, j] * after[k + 1, j, 3]
            x, y, z = arm[0], arm[1], arm[2]
            for i in range(3):
                a, b, c = before[i, 0], before[i, 1], before[i, 2]
                for j in range(3):
                    M[i, j] = M[3 + i, 3 + j] = before[i, j]
                    M[i, 3 + j] = 0.0
                # -R hat(arm)
                M[3 + i, 0], M[3 + i, 1], M[3 + i, 2] = c * y - b * z, a * z - c * x, b * x - a * y
            if inverted[k]:
                _through_inverse(M, links[k, e], inverse)
            _product(before, factors[k], turned)
            _copy(turned, before)


@compiled(types.void(_c3, _c2, _c4, _f3, _f2))
def through_links(H, g, maps, H_out, g_out):  # type: ignore[no-untyped-def]
    """B^T H B and B^T g of every edge, B = [M_1 ... M_n, 0; 0, I]; see `links.through_links`."""
    n, rest = maps.shape[1], H.shape[1] - 6
    poses = 6 * n
    half = np.empty((6 + rest, poses))
    for e in range(H.shape[0]):
        M, full, out = maps[e], H[e], H_out[e]
        for i in range(6 + rest):
            for k in range(n):
                for j in range(6):
                    total = 0.0
                    for p in range(6):
                        total += full[i, p] * M[k, p, j]
                    half[i, 6 * k + j] = total
        for k in range(n):
            for i in range(6):
                row = 6 * k + i
                for column in range(row, poses):
                    total = 0.0
                    for p in range(6):
                        total += M[k, p, i] * half[p, column]
                    out[row, column] = total
                    out[column, row] = total
                total = 0.0
                for p in range(6):
                    total += M[k, p, i] * g[e, p]
                g_out[e, row] = total
        for i in range(rest):
            g_out[e, poses + i] = g[e, 6 + i]
            for column in range(poses):
                out[poses + i, column] = half[6 + i, column]
                out[column, poses + i] = half[6 + i, column]
            for j in range(rest):
                out[poses + i, poses + j] = full[6 + i, 6 + j]
