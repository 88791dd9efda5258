"""Compiled normal equations of reprojection: project, differentiate and accumulate one view at a time.

For each view the columns of the Jacobian are laid out as contiguous rows of one scratch matrix, u residuals first and
v residuals after them: six of T_camera_target's chart, the camera's parameters, the target's modes, and the residual.
The normal equations are the products of those rows, so that one pass yields H, g and the cost, and the inner loops are
plain sums over contiguous memory. Views are independent: each writes its own block, so the result does not depend on
how the views are shared out to threads.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit, types
from numba.core.typing import Signature
from numba.experimental.function_type import _get_wrapper_address
from numba.extending import typeof_impl

from calibrant.cameras import CameraModel
from calibrant.cameras.kernels.contract import FAST, ROWS, ROWS_ARGUMENTS
from calibrant.compiled import compiled, compiled_part


def _constant(kind, ndim):  # type: ignore[no-untyped-def]
    """Type of an input array: frozen values are read-only, writable arrays convert."""
    return types.Array(kind, ndim, "C", readonly=True)


_c1, _c2, _c3 = (_constant(types.float64, n) for n in (1, 2, 3))
_i1 = _constant(types.int64, 1)
_f1, _f2, _f3 = types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]

_int = types.int64
_VIEWS = (ROWS, _c2, _i1, _c3, _c2, _c3, _c2, _c2)
SUMS = (_c1, _i1, _int, types.float64, _int, _int, _f3, _f2, _f1)
NORMAL_EQUATIONS = types.void(*_VIEWS, _c2, *SUMS)
_SCRATCH = types.Tuple((*6 * [_f2], _f1))
_RESIDUALS = types.void(*_VIEWS, _i1, _int, _int, _f2)


class Rows(types.WrapperAddressProtocol):
    """A model's compiled rows with their address looked up once: the lookup costs more than a small view."""

    def __init__(self, model: CameraModel) -> None:
        self._rows = model.rows()  # keeps the code alive
        self._address = _get_wrapper_address(self._rows, ROWS_ARGUMENTS)

    def __wrapper_address__(self) -> int:
        return self._address

    def signature(self) -> Signature:
        return ROWS_ARGUMENTS


@typeof_impl.register(Rows)
def _type_of_rows(rows: Rows, context: object) -> types.FunctionType:
    """One type for all models, made once: Numba would build it anew in every call of a kernel."""
    return ROWS


@cache
def rows_of(model: CameraModel) -> Rows:
    """The compiled rows of a model, one object a model."""
    return Rows(model)


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy", inline="always")
def robust(kind, k2, s):  # type: ignore[no-untyped-def]
    """rho(s) and its slope; the kinds of `optimize.losses`."""
    if kind == 1:
        if s <= k2:
            return s, 1.0
        r = np.sqrt(s)
        k = np.sqrt(k2)
        return 2.0 * k * r - k2, k / r
    if kind == 2:
        return k2 * np.log(1.0 + s / k2), k2 / (k2 + s)
    if kind == 3:
        ratio = k2 / (k2 + s)
        return s * ratio, ratio * ratio
    return s, 1.0


@compiled_part(types.void(_f2, _int, _int, _f2, _f1), fastmath=FAST, forceinline=True)
def _accumulate(J, q, length, H, g):  # type: ignore[no-untyped-def]
    """H = J J^T and g = J r over the first `length` columns; r is row q. Four sums at once share the load of a row."""
    for a in range(q):
        b = a
        while b + 3 < q + 1:
            s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
            for i in range(length):
                x = J[a, i]
                s0 += x * J[b, i]
                s1 += x * J[b + 1, i]
                s2 += x * J[b + 2, i]
                s3 += x * J[b + 3, i]
            H[a, b] = s0
            H[a, b + 1] = s1
            H[a, b + 2] = s2
            if b + 3 < q:
                H[a, b + 3] = s3
            else:
                g[a] = s3
            b += 4
        while b < q + 1:
            s0 = 0.0
            for i in range(length):
                s0 += J[a, i] * J[b, i]
            if b < q:
                H[a, b] = s0
            else:
                g[a] = s0
            b += 1
        for b in range(a):
            H[a, b] = H[b, a]


@compiled_part(types.void(_c2, _int, _int, _c2, _f2, _f2, _f2), fastmath=FAST, forceinline=True)
def whiten(whitening, row, i, uv, predicted, J_point, J_parameters):  # type: ignore[no-untyped-def]
    """Turn the slopes of point `row` of all, the i-th of its view, and what it is off by: predicted moves for that.

    Args: whitening (3, N): xx, xy, yy of the symmetric matrices.
    """
    xx, xy, yy, k = whitening[0, row], whitening[1, row], whitening[2, row], len(J_parameters) // 2
    du, dv = predicted[0, i] - uv[0, row], predicted[1, i] - uv[1, row]
    predicted[0, i], predicted[1, i] = uv[0, row] + (xx * du + xy * dv), uv[1, row] + (xy * du + yy * dv)
    for j in range(3):
        du, dv = J_point[j, i], J_point[3 + j, i]
        J_point[j, i], J_point[3 + j, i] = xx * du + xy * dv, xy * du + yy * dv
    for j in range(k):
        du, dv = J_parameters[j, i], J_parameters[k + j, i]
        J_parameters[j, i], J_parameters[k + j, i] = xx * du + xy * dv, xy * du + yy * dv


@compiled_part(
    types.float64(ROWS, _c1, _c2, _c1, _c2, _c3, _c2, _c2, _c1, _int, _int, _int, types.float64, _SCRATCH, _f2, _f1),
    fastmath=FAST,
    forceinline=True,
)
def _view(  # type: ignore[no-untyped-def]
    rows, parameters, T, theta, points, modes, uv, whitening, weight, first, n, loss, scale_sq, scratch, H, g
):
    """Normal equations of one view; returns its cost."""
    k, m = parameters.shape[0], modes.shape[0]
    q = 6 + k + m
    p, rotated, predicted, J_point, J_parameters, J, root = scratch
    point_x, point_y, point_z = points[0, first : first + n], points[1, first : first + n], points[2, first : first + n]
    rotated_x, rotated_y, rotated_z = rotated[0], rotated[1], rotated[2]
    for i in range(n):
        x, y, z = point_x[i], point_y[i], point_z[i]
        for mode in range(m):
            x += theta[mode] * modes[mode, 0, first + i]
            y += theta[mode] * modes[mode, 1, first + i]
            z += theta[mode] * modes[mode, 2, first + i]
        rotated_x[i] = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z
        rotated_y[i] = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z
        rotated_z[i] = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z
    for row in range(3):
        into, source, shift = p[row], rotated[row], T[row, 3]
        for i in range(n):
            into[i] = source[i] + shift
    rows(n, parameters, p, predicted, J_point, J_parameters)
    if whitening.shape[1] > 0:
        for i in range(n):
            whiten(whitening, first + i, i, uv, predicted, J_point, J_parameters)
    cost = 0.0
    for i in range(n):
        w = weight[first + i]
        du, dv = predicted[0, i] - uv[0, first + i], predicted[1, i] - uv[1, first + i]
        rho, slope = robust(loss, scale_sq, (du * du + dv * dv) * w * w)
        cost += 0.5 * rho
        w *= np.sqrt(slope)
        root[i] = w
        J[q, i], J[q, n + i] = w * du, w * dv
    # Slices of rows: an index that a loop counts from 0 needs no check for its sign, so the loops vectorise.
    for half in range(2):
        a, b, c = J_point[3 * half], J_point[3 * half + 1], J_point[3 * half + 2]
        here = J[:, half * n : (half + 1) * n]
        turn_x, turn_y, turn_z, move_x, move_y, move_z = here[0], here[1], here[2], here[3], here[4], here[5]
        for i in range(n):
            jx, jy, jz = root[i] * a[i], root[i] * b[i], root[i] * c[i]
            turn_x[i] = jz * rotated_y[i] - jy * rotated_z[i]
            turn_y[i] = jx * rotated_z[i] - jz * rotated_x[i]
            turn_z[i] = jy * rotated_x[i] - jx * rotated_y[i]
            move_x[i], move_y[i], move_z[i] = jx, jy, jz
        for column in range(k):
            into, source = here[6 + column], J_parameters[half * k + column]
            for i in range(n):
                into[i] = root[i] * source[i]
        for mode in range(m):
            into, dx, dy, dz = here[6 + k + mode], modes[mode, 0], modes[mode, 1], modes[mode, 2]
            for i in range(n):
                x, y, z = dx[first + i], dy[first + i], dz[first + i]
                vx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z
                vy = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z
                vz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z
                into[i] = root[i] * (a[i] * vx + b[i] * vy + c[i] * vz)
    _accumulate(J, q, 2 * n, H, g)
    return cost


@compiled(NORMAL_EQUATIONS, fastmath=FAST)
def normal_equations(  # type: ignore[no-untyped-def]
    rows, parameters, camera, T, theta, modes, points, uv, whitening, weight, offsets, loss, scale_sq, first, last,
    H, g, cost,
):  # fmt: skip
    """Fill H (m, q, q), g (m, q) and cost (m,) of the views first <= v < last."""
    k, q, largest = parameters.shape[1], H.shape[1], 0
    for v in range(first, last):
        largest = max(largest, offsets[v + 1] - offsets[v])
    # One set of rows for all views: they stay in the nearest cache.
    scratch = (
        np.empty((3, largest)),
        np.empty((3, largest)),
        np.empty((2, largest)),
        np.empty((6, largest)),
        np.empty((2 * k, largest)),
        np.empty((q + 1, 2 * largest)),
        np.empty(largest),
    )
    for v in range(first, last):
        start, n = offsets[v], offsets[v + 1] - offsets[v]
        cost[v] = _view(
            rows, parameters[camera[v]], T[v], theta[0], points, modes, uv, whitening, weight, start, n, loss, scale_sq,
            scratch, H[v], g[v],
        )  # fmt: skip


@compiled(_RESIDUALS, fastmath=FAST)
def residuals(rows, parameters, camera, T, theta, modes, points, uv, offsets, first, last, out):  # type: ignore[no-untyped-def]
    """out (N, 2) = predicted - observed pixels of the views first <= v < last; NaN where the model sees no point."""
    for v in range(first, last):
        start, n = offsets[v], offsets[v + 1] - offsets[v]
        k, M = parameters.shape[1], T[v]
        p, predicted = np.empty((3, n)), np.empty((2, n))
        J_point, J_parameters = np.empty((6, n)), np.empty((2 * k, n))
        for i in range(n):
            x, y, z = points[0, start + i], points[1, start + i], points[2, start + i]
            for mode in range(modes.shape[0]):
                x += theta[0, mode] * modes[mode, 0, start + i]
                y += theta[0, mode] * modes[mode, 1, start + i]
                z += theta[0, mode] * modes[mode, 2, start + i]
            for row in range(3):
                p[row, i] = M[row, 0] * x + M[row, 1] * y + M[row, 2] * z + M[row, 3]
        rows(n, parameters[camera[v]], p, predicted, J_point, J_parameters)
        for i in range(n):
            out[start + i, 0] = predicted[0, i] - uv[0, start + i]
            out[start + i, 1] = predicted[1, i] - uv[1, start + i]
