"""Perspective cameras with distortion in the image plane: what brown, rational, thin prism and tilted share.

x = X/Z, y = Y/Z, (x'', y'') = distort(x, y),  u = fx x'' + cx,  v = fy y'' + cy
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.cameras import plane_distortion
from calibrant.cameras.model import CameraModel, finite_points


class Perspective(CameraModel):
    """A model whose parameters are fx fy cx cy and the first few of `plane_distortion.TERMS`."""

    def project(self, parameters: ArrayLike, p_camera: ArrayLike) -> Array:
        fx, fy, cx, cy, *_ = a = np.asarray(parameters, dtype=np.float64)
        p = finite_points(p_camera)
        iz = inverse_depth(p)
        d = plane_distortion.distort(plane_distortion.padded(a[4:]), p[..., 0] * iz, p[..., 1] * iz)
        return np.stack([fx * d.x + cx, fy * d.y + cy], axis=-1)

    def project_with_jacobians(self, parameters: ArrayLike, p_camera: ArrayLike) -> tuple[Array, Array, Array]:
        fx, fy, cx, cy, *_ = a = np.asarray(parameters, dtype=np.float64)
        p = finite_points(p_camera)
        iz = inverse_depth(p)
        x, y = p[..., 0] * iz, p[..., 1] * iz
        terms = plane_distortion.padded(a[4:])
        d = plane_distortion.distort(terms, x, y)
        uv = np.stack([fx * d.x + cx, fy * d.y + cy], axis=-1)
        J_point = np.empty((*x.shape, 2, 3))
        J_point[..., 0, 0], J_point[..., 0, 1] = fx * d.xx * iz, fx * d.xy * iz
        J_point[..., 1, 0], J_point[..., 1, 1] = fy * d.yx * iz, fy * d.yy * iz
        J_point[..., 0, 2] = -fx * (d.xx * x + d.xy * y) * iz
        J_point[..., 1, 2] = -fy * (d.yx * x + d.yy * y) * iz
        J_k = np.zeros((*x.shape, 2, len(a)))
        J_k[..., 0, 0], J_k[..., 1, 1], J_k[..., 0, 2], J_k[..., 1, 3] = d.x, d.y, 1.0, 1.0
        columns = plane_distortion.term_columns(terms, len(a) - 4, x, y)
        J_k[..., 0, 4:], J_k[..., 1, 4:] = fx * columns[..., 0, :], fy * columns[..., 1, :]
        return uv, J_point, J_k

    def _unproject(self, parameters: Array, uv: Array) -> Array:
        fx, fy, cx, cy, *_ = parameters
        terms = plane_distortion.padded(parameters[4:])
        x, y = plane_distortion.undistort(terms, (uv[:, 0] - cx) / fx, (uv[:, 1] - cy) / fy)
        return np.stack([x, y, np.where(np.isnan(x), np.nan, 1.0)], axis=-1)

    def field_limit(self, parameters: Array) -> float:
        return plane_distortion.radius_limit(plane_distortion.padded(parameters[4:]))

    def inside(self, parameters: Array, p: Array) -> Mask:
        limit = self.field_limit(parameters)
        return np.hypot(p[..., 0], p[..., 1]) < limit * p[..., 2]


def inverse_depth(p: Array) -> Array:
    """1/z of points (..., 3), NaN where z <= 0: a point behind a perspective camera has no pixel."""
    z = p[..., 2]
    ahead = z > 0
    return np.where(ahead, 1.0, np.nan) / np.where(ahead, z, 1.0)
