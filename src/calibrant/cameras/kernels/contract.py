"""The compiled form of a camera model: one function a model, called by the fused kernels through a pointer.

`ROWS` is its signature: n, parameters (k,), p (3, >= n) camera-frame points as rows x, y, z -> fills uv (2, >= n),
J_point (6, >= n) as du/dx du/dy du/dz dv/dx dv/dy dv/dz, and J_parameters (2k, >= n) as all du/dk rows then all dv/dk
rows; returns the number of points the model cannot see (their columns are NaN). Rows are contiguous so that the inner
loops vectorise.

`LOCAL_ROWS` is that of a model of which a point sees few of many parameters: in place of J_parameters it fills index
(n, 2, l), which parameters u and v depend on, in rising order, and J_local (n, 2, l), their derivatives.

`RAYS_ARGUMENTS` is the signature of a compiled inverse: parameters (k,), the model's `field_limit`, pixels (n, 2) ->
fills unit rays (n, 3); returns how many it left NaN because it could not settle them with certainty.
"""

from __future__ import annotations

from numba import types

_matrix = types.float64[:, ::1]
_constant_vector = types.Array(types.float64, 1, "C", readonly=True)  # values are frozen; writable arrays convert
_constant_matrix = types.Array(types.float64, 2, "C", readonly=True)
ROWS_ARGUMENTS = types.int64(types.int64, _constant_vector, _matrix, _matrix, _matrix, _matrix)
ROWS = types.FunctionType(ROWS_ARGUMENTS)
LOCAL_ROWS_ARGUMENTS = types.int64(
    types.int64, _constant_vector, _matrix, _matrix, _matrix, types.int64[:, :, ::1], types.float64[:, :, ::1]
)
LOCAL_ROWS = types.FunctionType(LOCAL_ROWS_ARGUMENTS)
RAYS_ARGUMENTS = types.int64(_constant_vector, types.float64, _constant_matrix, _matrix)
FAST = {"reassoc", "contract", "arcp", "nsz"}
"""LLVM's relaxations that keep NaN and infinity, so that bad points stay visible, yet let sums vectorise."""
