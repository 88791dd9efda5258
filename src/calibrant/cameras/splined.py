"""Splined stereographic model: a stereographic image corrected by a B-spline surface of control points.

    q = 2 (X, Y) / (|p| + Z)                       stereographic, |q| = 2 tan(theta / 2)
    m = q + sum_ij B(q_x / h - i) B(q_y / h - j) c_ij        cubic B-splines, c_ij control points (x, y)
    u = fx m_x + cx,  v = fy m_y + cy

`splined:COLUMNSxROWS:FOV` is a grid of that many control points, evenly spaced in q, whose surface spans FOV across
the columns (the rows follow with the same spacing). Outside of it the model sees nothing. It can follow any smooth
lens, but every part of the image needs points. Source: the idea of mrcal's LENSMODEL_SPLINED_STEREOGRAPHIC (its manual,
"Splined stereographic lens model").
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.cameras.model import CameraModel, Projection, finite_points
from calibrant.cameras.plane_distortion import Plane, solve_plane
from calibrant.cameras.radial import ray
from calibrant.errors import InputError

FAMILY = "splined"
EXAMPLE = "splined:16x12:120deg"
_PER_CELL = 4
"""Samples a cell in each direction to start the inverse from: within a quarter of a cell a cubic is nearly linear."""


class Splined(CameraModel):
    """One grid of control points; build it with `splined`."""

    projection: Projection = "central"
    gauge: tuple[str, ...] = ("fx", "fy", "cx", "cy")
    summary: str = "any smooth lens, given many points everywhere: lowest error, most parameters"

    def __init__(self, columns: int, rows: int, fov_deg: float) -> None:
        self.columns, self.rows_count, self.fov_deg = columns, rows, fov_deg
        self.spacing = float(4 * np.tan(np.deg2rad(fov_deg) / 4) / (columns - 3))
        self.name = f"{FAMILY}:{columns}x{rows}:{fov_deg:g}deg"
        nodes = [f"{j}_{i}" for j in range(rows) for i in range(columns)]
        self.parameter_names = ("fx", "fy", "cx", "cy", *(f"x{n}" for n in nodes), *(f"y{n}" for n in nodes))
        self.parameter_units = ("px",) * 4 + ("1",) * (2 * len(nodes))

    @property
    def nodes(self) -> int:
        """Number of control points."""
        return self.columns * self.rows_count

    def project(self, parameters: ArrayLike, p_camera: ArrayLike) -> Array:
        fx, fy, cx, cy, *_ = a = np.asarray(parameters, dtype=np.float64)
        p = finite_points(p_camera)
        q = self._stereographic(a, p)
        m = self._surface(a, q[..., 0], q[..., 1])
        return np.stack([fx * m.x + cx, fy * m.y + cy], axis=-1)

    def project_with_jacobians(self, parameters: ArrayLike, p_camera: ArrayLike) -> tuple[Array, Array, Array]:
        fx, fy, cx, cy, *_ = a = np.asarray(parameters, dtype=np.float64)
        p = finite_points(p_camera)
        q = self._stereographic(a, p)
        m = self._surface(a, q[..., 0], q[..., 1])
        norm = np.linalg.norm(p, axis=-1)
        depth = norm + p[..., 2]
        S = 2 / np.where(depth > 0, depth, np.nan)
        J_q = np.zeros((*S.shape, 2, 3))
        T = -S * S / (2 * norm)
        J_q[..., 0, 0], J_q[..., 0, 1] = S + p[..., 0] ** 2 * T, p[..., 0] * p[..., 1] * T
        J_q[..., 1, 0], J_q[..., 1, 1] = J_q[..., 0, 1], S + p[..., 1] ** 2 * T
        J_q[..., :, 2] = p[..., :2] * (-S / norm)[..., None]
        J_m = np.empty((*S.shape, 2, 2))
        J_m[..., 0, 0], J_m[..., 0, 1], J_m[..., 1, 0], J_m[..., 1, 1] = fx * m.xx, fx * m.xy, fy * m.yx, fy * m.yy
        J_k = np.zeros((*S.shape, 2, len(a)))
        J_k[..., 0, 0], J_k[..., 1, 1], J_k[..., 0, 2], J_k[..., 1, 3] = m.x, m.y, 1.0, 1.0
        index, weight, _, _ = self._cells(q[..., 0], q[..., 1])
        np.put_along_axis(J_k[..., 0, :], 4 + index, fx * weight, axis=-1)
        np.put_along_axis(J_k[..., 1, :], 4 + self.nodes + index, fy * weight, axis=-1)
        return np.stack([fx * m.x + cx, fy * m.y + cy], axis=-1), J_m @ J_q, J_k

    def _stereographic(self, parameters: Array, p: Array) -> Array:
        seen = self.sees(parameters, p)
        with np.errstate(all="ignore"):
            q = 2 * p[..., :2] / (np.linalg.norm(p, axis=-1) + p[..., 2])[..., None]
        return np.where(seen[..., None], q, np.nan)

    def _cells(self, x: Array, y: Array) -> tuple[Any, Array, Array, Array]:
        """Indices (..., 16) of the control points around q, their weights and the weights' slopes along x and y."""
        gx, gy = x / self.spacing + (self.columns - 1) / 2, y / self.spacing + (self.rows_count - 1) / 2
        i = np.clip(np.nan_to_num(np.floor(gx), nan=1.0), 1, self.columns - 3).astype(np.int64)
        j = np.clip(np.nan_to_num(np.floor(gy), nan=1.0), 1, self.rows_count - 3).astype(np.int64)
        wx, dx = _basis(gx - i)
        wy, dy = _basis(gy - j)
        steps = np.arange(-1, 3)
        index = ((j[..., None] + steps) * self.columns)[..., :, None] + (i[..., None] + steps)[..., None, :]
        shape = (*x.shape, 16)
        weight = (wy[..., :, None] * wx[..., None, :]).reshape(shape)
        along_x = (wy[..., :, None] * dx[..., None, :]).reshape(shape) / self.spacing
        along_y = (dy[..., :, None] * wx[..., None, :]).reshape(shape) / self.spacing
        return index.reshape(shape), weight, along_x, along_y

    def _surface(self, a: Array, x: Array, y: Array) -> Plane:
        """m and its derivatives at q; NaN outside of the grid."""
        index, weight, along_x, along_y = self._cells(x, y)
        cx, cy = a[4 : 4 + self.nodes][index], a[4 + self.nodes :][index]
        ok = np.where(self._on_grid(x, y), 1.0, np.nan)
        return Plane(
            ok * (x + np.sum(weight * cx, axis=-1)),
            ok * (y + np.sum(weight * cy, axis=-1)),
            1 + np.sum(along_x * cx, axis=-1),
            np.sum(along_y * cx, axis=-1),
            np.sum(along_x * cy, axis=-1),
            1 + np.sum(along_y * cy, axis=-1),
        )

    def _reach(self) -> tuple[float, float]:
        """Largest |q_x| and |q_y| on the grid."""
        return self.spacing * (self.columns - 3) / 2, self.spacing * (self.rows_count - 3) / 2

    def centre_weights(self) -> tuple[Array, Array, Array]:
        """Weights (nodes,) of the control points at q = 0, and the weights' slopes along x and y."""
        index, *weights = self._cells(np.zeros(()), np.zeros(()))
        out = np.zeros((3, self.nodes))
        out[:, index] = weights
        return out[0], out[1], out[2]

    def _on_grid(self, x: Array, y: Array) -> Mask:
        reach_x, reach_y = self._reach()
        return (np.abs(x) <= reach_x) & (np.abs(y) <= reach_y)

    def sees(self, parameters: ArrayLike, p_camera: ArrayLike) -> Mask:
        p = finite_points(p_camera)
        depth = np.linalg.norm(p, axis=-1) + p[..., 2]
        reach_x, reach_y = self._reach()
        return (depth > 0) & (2 * np.abs(p[..., 0]) <= reach_x * depth) & (2 * np.abs(p[..., 1]) <= reach_y * depth)

    def _unproject(self, parameters: Array, uv: Array) -> Array:
        from scipy.spatial import KDTree

        fx, fy, cx, cy, *_ = parameters
        target = np.where(np.isfinite(uv), (uv - [cx, cy]) / [fx, fy], 0.0)
        reach_x, reach_y = self._reach()
        x, y = np.meshgrid(
            np.linspace(-reach_x, reach_x, _PER_CELL * (self.columns - 3) + 1),
            np.linspace(-reach_y, reach_y, _PER_CELL * (self.rows_count - 3) + 1),
        )
        at = self._surface(parameters, x.ravel(), y.ravel())
        _, nearest = KDTree(np.stack([at.x, at.y], axis=-1)).query(target)
        with np.errstate(all="ignore"):
            qx, qy, good = solve_plane(
                lambda a, b: self._surface(parameters, a, b),
                target[:, 0],
                target[:, 1],
                x.ravel()[nearest],
                y.ravel()[nearest],
            )
        s = (qx * qx + qy * qy) / 4
        return ray(qx, qy, 1 - s, good & np.isfinite(uv).all(axis=-1))

    def rows(self) -> Any:
        from calibrant.cameras.kernels.splined_rows import rows_of

        return rows_of(self.columns, self.rows_count, self.spacing)

    def local_rows(self) -> tuple[Any, int] | None:
        from calibrant.cameras.kernels.splined_rows import LOCAL, local_rows_of

        return local_rows_of(self.columns, self.rows_count, self.spacing), LOCAL


def _basis(t: Array) -> tuple[Array, Array]:
    """The four cubic B-splines over a cell at t in [0, 1], and their slopes."""
    w = [(1 - t) ** 3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6, (-3 * t**3 + 3 * t**2 + 3 * t + 1) / 6, t**3 / 6]
    d = [-((1 - t) ** 2) / 2, (3 * t**2 - 4 * t) / 2, (-3 * t**2 + 2 * t + 1) / 2, t**2 / 2]
    return np.stack(w, axis=-1), np.stack(d, axis=-1)


@lru_cache(maxsize=64)
def splined(spec: str) -> Splined:
    """The model of `splined:COLUMNSxROWS:FOVdeg`. Raises: InputError with an example."""
    found = re.fullmatch(rf"{FAMILY}:(\d+)x(\d+):(\d+(?:\.\d+)?)(?:deg)?", spec)
    if not found:
        raise InputError(f"a splined model is {FAMILY}:COLUMNSxROWS:FIELDdeg, for example {EXAMPLE}; got {spec!r}")
    columns, rows, fov = int(found[1]), int(found[2]), float(found[3])
    if not (4 <= columns <= 100 and 4 <= rows <= 100 and 1 <= fov < 340):
        raise InputError(f"a splined model takes 4 to 100 control points a side and 1 to 340 degrees; got {spec!r}")
    return Splined(columns, rows, fov)
