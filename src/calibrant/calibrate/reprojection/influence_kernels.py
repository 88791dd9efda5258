"""Compiled rows of influence: what each reprojection residual moves a few unknowns by, view after view.

A residual of view v moves the unknowns by M_v J^T e, with J its derivative by T_camera_target's chart, the camera's
parameters and the target's modes, and M_v what one of them moves the unknowns by.
"""

from __future__ import annotations

import numpy as np
from numba import types

from calibrant.calibrate.reprojection.kernels import _VIEWS, _c1, _c2, _c3, _f2, _f3, _i1, whiten
from calibrant.cameras.kernels.contract import FAST
from calibrant.compiled import compiled


@compiled(types.void(*_VIEWS, _c2, _c1, _i1, _c3, _f3, _f2), fastmath=FAST)
def influence_rows(  # type: ignore[no-untyped-def]
    rows, parameters, camera, T, theta, modes, points, uv, whitening, weight, offsets, M, out, e
):
    """out (N, 2, p) = w J M_v^T and e (N, 2) = w (predicted - observed). Args: M (m, p, 6 + k + modes)."""
    k, n_modes, p = parameters.shape[1], modes.shape[0], M.shape[1]
    for v in range(T.shape[0]):
        start, n, P, A = offsets[v], offsets[v + 1] - offsets[v], T[v], M[v]
        seen, turned, predicted = np.empty((3, n)), np.empty((3, n)), np.empty((2, n))
        J_point, J_parameters = np.empty((6, n)), np.empty((2 * k, n))
        # A column for all points at a time: sums over neighbours in memory, several of them at once.
        J, moved = np.empty((6 + k + n_modes, n)), np.empty((p, n))
        for i in range(n):
            x, y, z = points[0, start + i], points[1, start + i], points[2, start + i]
            for mode in range(n_modes):
                x += theta[0, mode] * modes[mode, 0, start + i]
                y += theta[0, mode] * modes[mode, 1, start + i]
                z += theta[0, mode] * modes[mode, 2, start + i]
            for row in range(3):
                turned[row, i] = P[row, 0] * x + P[row, 1] * y + P[row, 2] * z
                seen[row, i] = turned[row, i] + P[row, 3]
        rows(n, parameters[camera[v]], seen, predicted, J_point, J_parameters)
        if whitening.shape[1] > 0:
            for i in range(n):
                whiten(whitening, start + i, i, uv, predicted, J_point, J_parameters)
        for h in range(2):
            for i in range(n):
                w = weight[start + i]
                e[start + i, h] = w * (predicted[h, i] - uv[h, start + i])
                a, b, c = w * J_point[3 * h, i], w * J_point[3 * h + 1, i], w * J_point[3 * h + 2, i]
                J[0, i] = c * turned[1, i] - b * turned[2, i]
                J[1, i] = a * turned[2, i] - c * turned[0, i]
                J[2, i] = b * turned[0, i] - a * turned[1, i]
                J[3, i], J[4, i], J[5, i] = a, b, c
                for mode in range(n_modes):
                    x, y, z = modes[mode, 0, start + i], modes[mode, 1, start + i], modes[mode, 2, start + i]
                    s = a * (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z)
                    s += b * (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z)
                    J[6 + k + mode, i] = s + c * (P[2, 0] * x + P[2, 1] * y + P[2, 2] * z)
            for column in range(k):
                of, into = J_parameters[h * k + column], J[6 + column]
                for i in range(n):
                    into[i] = weight[start + i] * of[i]
            moved[:] = 0.0
            for row in range(p):
                into = moved[row]
                for column in range(A.shape[1]):
                    factor, of = A[row, column], J[column]
                    for i in range(n):
                        into[i] += factor * of[i]
            for i in range(n):
                for row in range(p):
                    out[start + i, h, row] = moved[row, i]
