"""Compiled kernels of the Schur complement: many small Cholesky factorisations and substitutions."""

from __future__ import annotations

import numpy as np
from numba import types

from calibrant.compiled import compiled

_f1, _f2, _f3 = types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
_c2, _c3 = (types.Array(types.float64, n, "C", readonly=True) for n in (2, 3))  # writable arrays convert
_i1 = types.Array(types.int64, 1, "C", readonly=True)
_FAST = {"reassoc", "contract", "arcp", "nsz"}


@compiled(types.void(_c3, _c2, _i1, _i1, types.int64[:, :, ::1], _f1, _f1, _f1, _f2, _f1))
def add_edges(H, g, starts, dims, places, V, W, v, S, s):  # type: ignore[no-untyped-def]
    """Add every edge's H (m, f, f) and g (m, f) to where its slots' columns go; see `structure.Structure`.

    V, W, v: the components' blocks, flat, one after the other; W's rows are the components'. V and S get both
    triangles.
    """
    shared = S.shape[0]
    for e in range(H.shape[0]):
        for a in range(dims.shape[0]):
            height, row, first, p = places[e, a, 0], places[e, a, 4], starts[a], dims[a]
            if height > 0:
                base = places[e, a, 3] + row
                for i in range(p):
                    v[base + i] += g[e, first + i]
            else:
                for i in range(p):
                    s[row + i] += g[e, first + i]
            for b in range(dims.shape[0]):
                column, other, q = places[e, b, 4], starts[b], dims[b]
                if places[e, b, 0] > 0:
                    if height > 0:
                        base = places[e, a, 1] + row * height + column
                        for i in range(p):
                            for j in range(q):
                                V[base + i * height + j] += H[e, first + i, other + j]
                elif height > 0:
                    base = places[e, a, 2] + row * shared + column
                    for i in range(p):
                        for j in range(q):
                            W[base + i * shared + j] += H[e, first + i, other + j]
                else:
                    for i in range(p):
                        for j in range(q):
                            S[row + i, column + j] += H[e, first + i, other + j]


@compiled(types.boolean(_c3, _c3, _c2, types.float64, types.float64, _f3, _f3, _f2, types.int64[::1]), fastmath=_FAST)
def eliminate(V, W, v, damping, tolerance, L, Y, z, weak):  # type: ignore[no-untyped-def]
    """L L^T = V + damping diag V; Y = L^-1 W; z = L^-1 v. weak[c]: first column whose pivot is rounding, or -1.

    Returns whether there is one.
    """
    n, b, s = W.shape
    singular = False
    for c in range(n):
        weak[c] = -1
        for j in range(b):
            diagonal = V[c, j, j]
            own = diagonal + damping * (diagonal if diagonal > 0.0 else 1.0)
            pivot = own
            for k in range(j):
                pivot -= L[c, j, k] * L[c, j, k]
            if not pivot > tolerance * own:
                singular = True
                if weak[c] < 0:
                    weak[c] = j
                pivot = own if own > 0.0 else 1.0
            root = np.sqrt(pivot)
            L[c, j, j] = root
            inverse = 1.0 / root
            for i in range(j + 1, b):
                total = V[c, i, j]
                for k in range(j):
                    total -= L[c, i, k] * L[c, j, k]
                L[c, i, j] = total * inverse
                L[c, j, i] = 0.0
            total = v[c, j]
            for k in range(j):
                total -= L[c, j, k] * z[c, k]
            z[c, j] = total * inverse
            for q in range(s):
                Y[c, j, q] = W[c, j, q]
            for k in range(j):
                factor = L[c, j, k]
                for q in range(s):
                    Y[c, j, q] -= factor * Y[c, k, q]
            for q in range(s):
                Y[c, j, q] *= inverse
    return singular


@compiled(types.float64(_f2, _f1, _f2, _f1, types.float64, types.float64, _f1), fastmath=_FAST)
def solve_shared(S, s, before, gradient, damping, tolerance, x):  # type: ignore[no-untyped-def]
    """x = -(S + damping diag S_0)^-1 s by Cholesky, S_0 = `before` the elimination; S is overwritten by its factor.

    Returns the shared unknowns' part of the predicted decrease, 1/2 (damping x^T diag(S_0) x - s_0^T x), s_0 =
    `gradient`; NaN when a pivot is rounding against S_0.
    """
    n = S.shape[0]
    for j in range(n):
        own = before[j, j] if before[j, j] > 0.0 else 1.0  # what nothing depends on keeps a zero step
        pivot = S[j, j] + damping * own
        for k in range(j):
            pivot -= S[j, k] * S[j, k]
        if not pivot > tolerance * own:
            return np.nan
        root = np.sqrt(pivot)
        S[j, j] = root
        inverse = 1.0 / root
        for i in range(j + 1, n):
            total = S[i, j]
            for k in range(j):
                total -= S[i, k] * S[j, k]
            S[i, j] = total * inverse
        total = -s[j]
        for k in range(j):
            total -= S[j, k] * x[k]
        x[j] = total * inverse
    for j in range(n - 1, -1, -1):
        x[j] /= S[j, j]
        for k in range(j):
            x[k] -= S[j, k] * x[j]
    predicted = 0.0
    for j in range(n):
        own = before[j, j] if before[j, j] > 0.0 else 1.0
        predicted += damping * own * x[j] * x[j] - gradient[j] * x[j]
    return 0.5 * predicted


@compiled(types.float64(_f2, _f2), fastmath=_FAST)
def invert_definite(S, inverse):  # type: ignore[no-untyped-def]
    """inverse = S^-1 by Cholesky. Returns the smallest pivot; `inverse` is not filled when that is not above 0."""
    n = S.shape[0]
    L, M = np.empty((n, n)), np.empty((n, n))
    smallest = np.inf
    for j in range(n):
        pivot = S[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        smallest = min(smallest, pivot)
        if not pivot > 0.0:
            return pivot
        L[j, j] = np.sqrt(pivot)
        for i in range(j + 1, n):
            total = S[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total / L[j, j]
    # Row j of M holds column j of L^-1, so that every inner product below runs over contiguous memory.
    for j in range(n):
        M[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= L[i, k] * M[j, k]
            M[j, i] = total / L[i, i]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += M[i, k] * M[j, k]
            inverse[i, j] = total
            inverse[j, i] = total
    return smallest


@compiled(types.float64(_f3, _f3, _f2, _f1, _f3, _f2, types.float64, _f2), fastmath=_FAST)
def substitute(L, Y, z, shared, V, v, damping, d):  # type: ignore[no-untyped-def]
    """d = -L^-T (z + Y shared): the components' steps once the shared step is known.

    Returns their share of the predicted decrease, 1/2 (damping d^T diag(V) d - v^T d).
    """
    n, b, s = Y.shape
    predicted = 0.0
    for c in range(n):
        for j in range(b):
            total = z[c, j]
            for q in range(s):
                total += Y[c, j, q] * shared[q]
            d[c, j] = -total
        for j in range(b - 1, -1, -1):
            total = d[c, j]
            for k in range(j + 1, b):
                total -= L[c, k, j] * d[c, k]
            d[c, j] = total / L[c, j, j]
        for j in range(b):
            own = V[c, j, j] if V[c, j, j] > 0.0 else 1.0
            predicted += damping * own * d[c, j] * d[c, j] - v[c, j] * d[c, j]
    return 0.5 * predicted


@compiled(types.void(_f3, _f3, _f2, _f3, _f3), fastmath=_FAST)
def component_covariances(L, Y, shared, own, cross):  # type: ignore[no-untyped-def]
    """own = V^-1 + U shared U^T and cross = -U shared, U = L^-T Y: the blocks of the inverse that a component sees.

    shared (s, s): covariance of the shared unknowns. own (n, b, b), cross (n, b, s) are filled.
    """
    n, b, s = Y.shape
    U = np.empty((b, s))
    inverse = np.empty((b, b))
    for c in range(n):
        for j in range(b - 1, -1, -1):
            for q in range(s):
                total = Y[c, j, q]
                for k in range(j + 1, b):
                    total -= L[c, k, j] * U[k, q]
                U[j, q] = total / L[c, j, j]
        # Columns of V^-1 by two substitutions with the unit vectors.
        for column in range(b):
            for i in range(b):
                total = 1.0 if i == column else 0.0
                for k in range(i):
                    total -= L[c, i, k] * inverse[k, column]
                inverse[i, column] = total / L[c, i, i]
            for i in range(b - 1, -1, -1):
                total = inverse[i, column]
                for k in range(i + 1, b):
                    total -= L[c, k, i] * inverse[k, column]
                inverse[i, column] = total / L[c, i, i]
        for i in range(b):
            for q in range(s):
                total = 0.0
                for r in range(s):
                    total += U[i, r] * shared[r, q]
                cross[c, i, q] = -total
        for i in range(b):
            for j in range(b):
                total = inverse[i, j]
                for q in range(s):
                    total -= cross[c, i, q] * U[j, q]
                own[c, i, j] = total
