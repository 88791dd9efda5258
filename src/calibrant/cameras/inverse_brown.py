"""Brown's terms in the direction of undistortion: k1 k2 p1 p2 k3, from pixels to rays.

    x' = (u - cx)/fx, y' = (v - cy)/fy, r2 = x'^2 + y'^2, g = 1 + k1 r2 + k2 r2^2 + k3 r2^3
    X/Z = x' g + 2 p1 x' y' + p2 (r2 + 2 x'^2),  Y/Z = y' g + p1 (r2 + 2 y'^2) + 2 p2 x' y'

Rays come in closed form, projecting solves for x', y'. RealSense calls it "inverse Brown-Conrady"; classical
photogrammetry corrects image coordinates in this direction, and so do document 003's equations 2.7 and 2.8 (with p1 and
p2 exchanged: the order here is OpenCV's).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.cameras import plane_distortion
from calibrant.cameras.model import CameraModel, finite_points
from calibrant.cameras.perspective import inverse_depth


class InverseBrown(CameraModel):
    """Radial and tangential correction of image coordinates, OpenCV's order of the terms."""

    name: str = "inverse_brown"
    parameter_names: tuple[str, ...] = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    parameter_units: tuple[str, ...] = ("px",) * 4 + ("1",) * 5
    summary: str = "RealSense depth cameras and photogrammetry's files: the correction, not the distortion"

    def project(self, parameters: ArrayLike, p_camera: ArrayLike) -> Array:
        fx, fy, cx, cy, *_ = a = np.asarray(parameters, dtype=np.float64)
        x, y, _, _, _ = self._solve(a, p_camera)
        return np.stack([fx * x + cx, fy * y + cy], axis=-1)

    def project_with_jacobians(self, parameters: ArrayLike, p_camera: ArrayLike) -> tuple[Array, Array, Array]:
        fx, fy, cx, cy, *_ = a = np.asarray(parameters, dtype=np.float64)
        x, y, X, Y, iz = self._solve(a, p_camera)
        terms = plane_distortion.padded(a[4:])
        d = plane_distortion.distort(terms, x, y)
        det = d.xx * d.yy - d.xy * d.yx
        # The implicit function theorem: d(x', y') = U^-1 d(X/Z, Y/Z), U the slope of the correction.
        inverse = np.empty((*x.shape, 2, 2))
        inverse[..., 0, 0], inverse[..., 0, 1] = fx * d.yy / det, -fx * d.xy / det
        inverse[..., 1, 0], inverse[..., 1, 1] = -fy * d.yx / det, fy * d.xx / det
        J_point = np.empty((*x.shape, 2, 3))
        J_point[..., :2] = inverse * iz[..., None, None]
        J_point[..., 2] = -(J_point[..., 0] * X[..., None] + J_point[..., 1] * Y[..., None])
        J_k = np.zeros((*x.shape, 2, len(a)))
        J_k[..., 0, 0], J_k[..., 1, 1], J_k[..., 0, 2], J_k[..., 1, 3] = x, y, 1.0, 1.0
        J_k[..., 4:] = -inverse @ plane_distortion.term_columns(terms, 5, x, y)
        return np.stack([fx * x + cx, fy * y + cy], axis=-1), J_point, J_k

    def _solve(self, a: Array, p_camera: ArrayLike) -> tuple[Array, Array, Array, Array, Array]:
        """Image coordinates x', y' of points, with X/Z, Y/Z and 1/Z; NaN where there are none."""
        p = finite_points(p_camera)
        iz = inverse_depth(p)
        X, Y = p[..., 0] * iz, p[..., 1] * iz
        x, y = plane_distortion.undistort(plane_distortion.padded(a[4:]), np.atleast_1d(X), np.atleast_1d(Y))
        return x.reshape(X.shape), y.reshape(X.shape), X, Y, iz

    def _unproject(self, parameters: Array, uv: Array) -> Array:
        fx, fy, cx, cy, *_ = parameters
        x, y = (uv[:, 0] - cx) / fx, (uv[:, 1] - cy) / fy
        terms = plane_distortion.padded(parameters[4:])
        d = plane_distortion.distort(terms, x, y)
        good = (d.xx * d.yy - d.xy * d.yx > 0) & (np.hypot(x, y) < self.field_limit(parameters))
        return np.where(good[:, None], np.stack([d.x, d.y, np.ones_like(x)], axis=-1), np.nan)

    def sees(self, parameters: ArrayLike, p_camera: ArrayLike) -> Mask:
        return np.isfinite(self._solve(np.asarray(parameters, dtype=np.float64), p_camera)[0])

    def field_limit(self, parameters: Array) -> float:
        return plane_distortion.radius_limit(plane_distortion.padded(parameters[4:]))

    def rows(self) -> Any:
        from calibrant.cameras.kernels.inverse_brown_rows import rows

        return rows
