"""Pinhole camera: u = fx x/z + cx, v = fy y/z + cy (lecture 001, P = I C; Hartley and Zisserman, eq. 6.9, no skew)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.cameras.model import CameraModel, finite_points, matrix_of
from calibrant.cameras.perspective import inverse_depth


class Pinhole(CameraModel):
    """Ideal perspective camera without distortion."""

    name: str = "pinhole"
    parameter_names: tuple[str, ...] = ("fx", "fy", "cx", "cy")
    parameter_units: tuple[str, ...] = ("px", "px", "px", "px")
    summary: str = "ideal or undistorted images"

    def project(self, parameters: ArrayLike, p_camera: ArrayLike) -> Array:
        fx, fy, cx, cy = np.asarray(parameters, dtype=np.float64)
        p = finite_points(p_camera)
        iz = inverse_depth(p)
        return np.stack([fx * p[..., 0] * iz + cx, fy * p[..., 1] * iz + cy], axis=-1)

    def project_with_jacobians(self, parameters: ArrayLike, p_camera: ArrayLike) -> tuple[Array, Array, Array]:
        fx, fy, cx, cy = np.asarray(parameters, dtype=np.float64)
        p = finite_points(p_camera)
        iz = inverse_depth(p)
        x, y = p[..., 0] * iz, p[..., 1] * iz
        zero, one = np.zeros_like(x), np.ones_like(x)
        uv = np.stack([fx * x + cx, fy * y + cy], axis=-1)
        J_point = matrix_of([[fx * iz, zero, -fx * x * iz], [zero, fy * iz, -fy * y * iz]])
        J_parameters = matrix_of([[x, zero, one, zero], [zero, y, zero, one]])
        return uv, J_point, J_parameters

    def _unproject(self, parameters: Array, uv: Array) -> Array:
        fx, fy, cx, cy = parameters
        x, y = (uv[:, 0] - cx) / fx, (uv[:, 1] - cy) / fy
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def rows(self) -> Any:
        from calibrant.cameras.kernels.pinhole_rows import rows

        return rows
