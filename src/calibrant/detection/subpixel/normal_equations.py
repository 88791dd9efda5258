"""Normal equations of a few unknowns, summed and solved in place: library calls take longer than that for so few."""

from __future__ import annotations

import math

import numpy as np

from calibrant.compiled import compiled_part


@compiled_part(
    "void(float64[:, ::1], float64[::1], float64[:, ::1], float64[::1])",
    fastmath={"contract", "reassoc"},
    forceinline=True,
)
def products(J, r, JtJ, Jtr):  # type: ignore[no-untyped-def]
    """Fills JtJ (p, p) and Jtr (p,) from J (p, n) and r (n,): sums run along neighbours in memory."""
    for i in range(len(J)):
        total = 0.0
        for k in range(len(r)):
            total += J[i, k] * r[k]
        Jtr[i] = total
        for j in range(i + 1):
            total = 0.0
            for k in range(len(r)):
                total += J[i, k] * J[j, k]
            JtJ[i, j] = total
            JtJ[j, i] = total


@compiled_part("void(float64[:, ::1], float64, float64[:, ::1])")
def factor(A, damping, L):  # type: ignore[no-untyped-def]
    """Fills L with the lower Cholesky factor of A + damping diag(A)."""
    for i in range(len(A)):
        for j in range(i + 1):
            total = A[i, j]
            if i == j:
                # The small term keeps a picture without contrast from a root of zero; it fails its tests later.
                total += damping * A[i, i] + 1e-9
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = math.sqrt(max(total, 1e-12)) if i == j else total / L[j, j]


@compiled_part("void(float64[:, ::1], float64[::1], float64[::1])")
def solve(L, b, x):  # type: ignore[no-untyped-def]
    """Fills x with the solution of L L^T x = b."""
    n = len(b)
    for i in range(n):
        total = b[i]
        for k in range(i):
            total -= L[i, k] * x[k]
        x[i] = total / L[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= L[k, i] * x[k]
        x[i] = total / L[i, i]


@compiled_part("void(float64[:, ::1], float64[:, ::1])")
def invert(L, inverse):  # type: ignore[no-untyped-def]
    """Fills inverse with that of L L^T."""
    unit = np.empty(len(L))
    for i in range(len(L)):
        unit[i] = 0.0
    for i in range(len(L)):
        unit[i] = 1.0
        solve(L, unit, inverse[i])
        unit[i] = 0.0
