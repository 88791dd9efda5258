"""Pinhole camera with skew: u = fx x/z + skew y/z + cx, v = fy y/z + cy (Hartley and Zisserman, eq. 6.10)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.cameras.model import CameraModel, finite_points, matrix_of
from calibrant.cameras.perspective import inverse_depth


class PinholeSkew(CameraModel):
    """Ideal perspective camera whose pixel axes need not be at right angles."""

    name: str = "pinhole_skew"
    parameter_names: tuple[str, ...] = ("fx", "fy", "cx", "cy", "skew")
    parameter_units: tuple[str, ...] = ("px",) * 5
    summary: str = "scanned or re-photographed images, general homographies; no distortion"

    def project(self, parameters: ArrayLike, p_camera: ArrayLike) -> Array:
        fx, fy, cx, cy, skew = np.asarray(parameters, dtype=np.float64)
        p = finite_points(p_camera)
        iz = inverse_depth(p)
        x, y = p[..., 0] * iz, p[..., 1] * iz
        return np.stack([fx * x + skew * y + cx, fy * y + cy], axis=-1)

    def project_with_jacobians(self, parameters: ArrayLike, p_camera: ArrayLike) -> tuple[Array, Array, Array]:
        fx, fy, cx, cy, skew = np.asarray(parameters, dtype=np.float64)
        p = finite_points(p_camera)
        iz = inverse_depth(p)
        x, y = p[..., 0] * iz, p[..., 1] * iz
        zero, one = np.zeros_like(x), np.ones_like(x)
        uv = np.stack([fx * x + skew * y + cx, fy * y + cy], axis=-1)
        J_point = matrix_of([[fx * iz, skew * iz, -(fx * x + skew * y) * iz], [zero, fy * iz, -fy * y * iz]])
        J_parameters = matrix_of([[x, zero, one, zero, y], [zero, y, zero, one, zero]])
        return uv, J_point, J_parameters

    def _unproject(self, parameters: Array, uv: Array) -> Array:
        fx, fy, cx, cy, skew = parameters
        y = (uv[:, 1] - cy) / fy
        return np.stack([(uv[:, 0] - cx - skew * y) / fx, y, np.ones_like(y)], axis=-1)

    def rows(self) -> Any:
        from calibrant.cameras.kernels.pinhole_rows import skewed

        return skewed
