"""Unified omnidirectional model after Mei, with OpenCV's `omnidir` parameters: xi, k1 k2 p1 p2 and skew.

    (x_s, y_s, z_s) = p / |p|,  x = x_s / (z_s + xi),  y = y_s / (z_s + xi),  (x', y') = brown(x, y; k1 k2 p1 p2)
    u = fx x' + skew y' + cx,  v = fy y' + cy

xi = 0 is brown's model, xi = 1 the stereographic projection. Source: Mei and Rives 2007, "Single view point
omnidirectional camera calibration from planar grids".
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.cameras import plane_distortion
from calibrant.cameras.model import CameraModel, Projection, finite_points, matrix_of
from calibrant.cameras.radial import ray


class Unified(CameraModel):
    """Points projected onto the unit sphere, then from a point xi behind its centre onto a distorted plane."""

    name: str = "unified"
    parameter_names: tuple[str, ...] = ("fx", "fy", "cx", "cy", "skew", "xi", "k1", "k2", "p1", "p2")
    parameter_units: tuple[str, ...] = ("px",) * 5 + ("1",) * 5
    start_terms: ClassVar[dict[str, float]] = {"xi": 1.0}
    projection: Projection = "central"
    summary: str = "fisheyes and mirrors, with decentering (OpenCV's omnidir)"

    def project(self, parameters: ArrayLike, p_camera: ArrayLike) -> Array:
        fx, fy, cx, cy, skew, *_ = a = np.asarray(parameters, dtype=np.float64)
        p, iD, _ = self._onto_plane(a, p_camera)
        d = plane_distortion.distort(plane_distortion.padded(a[6:]), p[..., 0] * iD, p[..., 1] * iD)
        return np.stack([fx * d.x + skew * d.y + cx, fy * d.y + cy], axis=-1)

    def project_with_jacobians(self, parameters: ArrayLike, p_camera: ArrayLike) -> tuple[Array, Array, Array]:
        fx, fy, cx, cy, skew, xi, *_ = a = np.asarray(parameters, dtype=np.float64)
        p, iD, norm = self._onto_plane(a, p_camera)
        x, y = p[..., 0] * iD, p[..., 1] * iD
        terms = plane_distortion.padded(a[6:])
        d = plane_distortion.distort(terms, x, y)
        uv = np.stack([fx * d.x + skew * d.y + cx, fy * d.y + cy], axis=-1)
        to_pixels = np.array([[fx, skew], [0.0, fy]])
        J_plane = to_pixels @ matrix_of([[d.xx, d.xy], [d.yx, d.yy]])
        # d (x, y) / dp = iD (e - (x, y) dD/dp), D = Z + xi |p|
        by_D = xi * p / norm[..., None]
        by_D[..., 2] += 1
        J_xy = np.zeros((*x.shape, 2, 3))
        J_xy[..., 0, 0] = J_xy[..., 1, 1] = 1.0
        J_xy = (J_xy - np.stack([x, y], axis=-1)[..., None] * by_D[..., None, :]) * iD[..., None, None]
        J_k = np.zeros((*x.shape, 2, len(a)))
        J_k[..., 0, 0], J_k[..., 1, 1], J_k[..., 0, 2], J_k[..., 1, 3], J_k[..., 0, 4] = d.x, d.y, 1.0, 1.0, d.y
        by_xi = np.stack([x, y], axis=-1) * (-norm * iD)[..., None]
        J_k[..., 5] = (J_plane @ by_xi[..., None])[..., 0]
        J_k[..., 6:] = to_pixels @ plane_distortion.term_columns(terms, 4, x, y)
        return uv, J_plane @ J_xy, J_k

    def _onto_plane(self, parameters: Array, p_camera: ArrayLike) -> tuple[Array, Array, Array]:
        """Points, 1 / (Z + xi |p|) and |p|; NaN where there is no pixel."""
        p = finite_points(p_camera)
        seen = self.sees(parameters, p)
        norm = np.where(seen, np.linalg.norm(p, axis=-1), np.nan)
        return p, 1 / (p[..., 2] + parameters[5] * norm), norm

    def _unproject(self, parameters: Array, uv: Array) -> Array:
        fx, fy, cx, cy, skew, xi, *_ = parameters
        yd = (uv[:, 1] - cy) / fy
        xd = (uv[:, 0] - cx - skew * yd) / fx
        x, y = plane_distortion.undistort(plane_distortion.padded(parameters[6:]), xd, yd)
        r2 = x * x + y * y
        root = 1 + (1 - xi * xi) * r2
        with np.errstate(invalid="ignore"):
            k = (xi + np.sqrt(root)) / (1 + r2)
        return ray(k * x, k * y, k - xi, root >= 0)

    def sees(self, parameters: ArrayLike, p_camera: ArrayLike) -> Mask:
        xi = float(np.asarray(parameters, dtype=np.float64)[5])
        p = finite_points(p_camera)
        norm = np.linalg.norm(p, axis=-1)
        return (p[..., 2] > -(xi if xi <= 1 else 1 / xi) * norm) & (norm > 0)

    def field_limit(self, parameters: Array) -> float:
        return plane_distortion.radius_limit(plane_distortion.padded(parameters[6:]))

    def inside(self, parameters: Array, p: Array) -> Mask:
        depth = p[..., 2] + parameters[5] * np.linalg.norm(p, axis=-1)
        limit = self.field_limit(parameters)
        return np.hypot(p[..., 0], p[..., 1]) < limit * depth

    def rows(self) -> Any:
        from calibrant.cameras.kernels.unified_rows import rows

        return rows

    def rays(self) -> Any:
        from calibrant.cameras.kernels.unified_rays import rays

        return rays
