"""Orthographic camera of a telecentric lens: u = fx X + cx, v = fy Y + cy, fx and fy in pixels per metre.

All rays are parallel to the axis, so that a pixel's ray starts at its own place, (X, Y, 0), and depth cannot be seen.
Source: Hartley and Zisserman, section 6.3 (affine cameras).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.cameras.model import CameraModel, Projection, finite_points


class Orthographic(CameraModel):
    """Parallel projection along z; magnification fx, fy."""

    name: str = "orthographic"
    parameter_names: tuple[str, ...] = ("fx", "fy", "cx", "cy")
    parameter_units: tuple[str, ...] = ("px/m", "px/m", "px", "px")
    projection: Projection = "parallel"
    gauge: tuple[str, ...] = ("cx", "cy")
    summary: str = "telecentric lenses"

    def project(self, parameters: ArrayLike, p_camera: ArrayLike) -> Array:
        fx, fy, cx, cy = np.asarray(parameters, dtype=np.float64)
        x, y = _seen_along_axis(p_camera)
        return np.stack([fx * x + cx, fy * y + cy], axis=-1)

    def project_with_jacobians(self, parameters: ArrayLike, p_camera: ArrayLike) -> tuple[Array, Array, Array]:
        fx, fy, *_ = np.asarray(parameters, dtype=np.float64)
        x, y = _seen_along_axis(p_camera)
        nothing = np.where(np.isnan(x), np.nan, 0.0)
        J_point = np.zeros((*x.shape, 2, 3)) + nothing[..., None, None]
        J_point[..., 0, 0] += fx
        J_point[..., 1, 1] += fy
        J_k = np.zeros((*x.shape, 2, 4))
        J_k[..., 0, 0], J_k[..., 1, 1], J_k[..., 0, 2], J_k[..., 1, 3] = x, y, 1.0, 1.0
        return self.project(parameters, p_camera), J_point, J_k

    def _unproject(self, parameters: Array, uv: Array) -> Array:
        return np.where(np.isfinite(uv).all(axis=1, keepdims=True), [0.0, 0.0, 1.0], np.nan)

    def ray_origins(self, parameters: ArrayLike, uv: ArrayLike) -> Array:
        fx, fy, cx, cy = np.asarray(parameters, dtype=np.float64)
        pixels = np.asarray(uv, dtype=np.float64)
        x, y = (pixels[..., 0] - cx) / fx, (pixels[..., 1] - cy) / fy
        return np.stack([x, y, np.zeros_like(x)], axis=-1)

    def _line_of_sight(self, p: Array) -> Array:
        return np.broadcast_to([0.0, 0.0, 1.0], p.shape)

    def rows(self) -> Any:
        from calibrant.cameras.kernels.orthographic_rows import rows

        return rows


def _seen_along_axis(p_camera: ArrayLike) -> tuple[Array, Array]:
    p = finite_points(p_camera)
    seen = p[..., 2] > 0
    return np.where(seen, p[..., 0], np.nan), np.where(seen, p[..., 1], np.nan)
