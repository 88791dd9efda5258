"""Brown's model with five terms, in OpenCV's forward form and order: k1 k2 p1 p2 k3.

    x = X/Z, y = Y/Z, r2 = x^2 + y^2, g = 1 + k1 r2 + k2 r2^2 + k3 r2^3
    x' = x g + 2 p1 x y + p2 (r2 + 2 x^2),  y' = y g + p1 (r2 + 2 y^2) + 2 p2 x y
    u = fx x' + cx,  v = fy y' + cy

The forward map distorts ideal coordinates. Document 003's equations 2.7 and 2.8 map the other way and swap p1 and p2;
its files are in OpenCV's order, which is read here.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from calibrant.cameras.model import Array, CameraModel
from calibrant.cameras.pinhole import inverse_depth

_UNPROJECT_ITERATIONS = 100


class Brown(CameraModel):
    """Radial (k1 k2 k3) and tangential (p1 p2) distortion, OpenCV's order."""

    name: ClassVar[str] = "brown"
    parameter_names: ClassVar[tuple[str, ...]] = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    parameter_units: ClassVar[tuple[str, ...]] = ("px",) * 4 + ("1",) * 5

    def project(self, parameters: ArrayLike, p_camera: ArrayLike) -> Array:
        fx, fy, cx, cy, *_ = a = np.asarray(parameters, dtype=np.float64)
        p = np.asarray(p_camera, dtype=np.float64)
        iz = inverse_depth(p)
        xd, yd, *_ = _distort(a, p[..., 0] * iz, p[..., 1] * iz)
        return np.stack([fx * xd + cx, fy * yd + cy], axis=-1)

    def project_with_jacobians(self, parameters: ArrayLike, p_camera: ArrayLike) -> tuple[Array, Array, Array]:
        fx, fy, cx, cy, *_ = a = np.asarray(parameters, dtype=np.float64)
        p = np.asarray(p_camera, dtype=np.float64)
        iz = inverse_depth(p)
        x, y = p[..., 0] * iz, p[..., 1] * iz
        xd, yd, xx, xy, yy = _distort(a, x, y)
        r2 = x * x + y * y
        uv = np.stack([fx * xd + cx, fy * yd + cy], axis=-1)
        J_point = np.empty((*x.shape, 2, 3))
        J_point[..., 0, 0], J_point[..., 0, 1] = fx * xx * iz, fx * xy * iz
        J_point[..., 1, 0], J_point[..., 1, 1] = fy * xy * iz, fy * yy * iz
        J_point[..., 0, 2] = -fx * (xx * x + xy * y) * iz
        J_point[..., 1, 2] = -fy * (xy * x + yy * y) * iz
        J_k = np.zeros((*x.shape, 2, 9))
        J_k[..., 0, 0], J_k[..., 1, 1], J_k[..., 0, 2], J_k[..., 1, 3] = xd, yd, 1.0, 1.0
        for column, radial in ((4, r2), (5, r2 * r2), (8, r2 * r2 * r2)):
            J_k[..., 0, column], J_k[..., 1, column] = fx * x * radial, fy * y * radial
        J_k[..., 0, 6], J_k[..., 1, 6] = fx * 2 * x * y, fy * (r2 + 2 * y * y)
        J_k[..., 0, 7], J_k[..., 1, 7] = fx * (r2 + 2 * x * x), fy * 2 * x * y
        return uv, J_point, J_k

    def unproject(self, parameters: ArrayLike, uv: ArrayLike) -> Array:
        """Newton's iteration on the distortion; NaN where it does not reach the pixel (outside the valid field)."""
        fx, fy, cx, cy, *_ = a = np.asarray(parameters, dtype=np.float64)
        pixels = np.asarray(uv, dtype=np.float64)
        xd, yd = (pixels[..., 0] - cx) / fx, (pixels[..., 1] - cy) / fy
        x, y = xd.copy(), yd.copy()
        with np.errstate(all="ignore"):
            for _ in range(_UNPROJECT_ITERATIONS):
                gx, gy, xx, xy, yy = _distort(a, x, y)
                ex, ey = gx - xd, gy - yd
                det = xx * yy - xy * xy
                dx, dy = (yy * ex - xy * ey) / det, (xx * ey - xy * ex) / det
                x, y = x - dx, y - dy
                if not np.any(np.abs(dx) + np.abs(dy) > 1e-14 * (1 + np.abs(x) + np.abs(y))):
                    break
            gx, gy, xx, xy, yy = _distort(a, x, y)
            # Beyond the fold of the polynomial (det <= 0) a root exists but light does not come from there.
            good = (np.hypot(gx - xd, gy - yd) < 1e-10 * (1 + np.hypot(xd, yd))) & (xx * yy - xy * xy > 0) & (xx > 0)
        ray = np.stack([np.where(good, x, np.nan), np.where(good, y, np.nan), np.ones_like(x)], axis=-1)
        ray[..., 2] = np.where(good, 1.0, np.nan)
        return ray / np.linalg.norm(ray, axis=-1, keepdims=True)

    def rows(self) -> Any:
        from calibrant.cameras.brown_rows import rows

        return rows


def _distort(a: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Distorted x', y' and their derivatives dx'/dx, dx'/dy = dy'/dx, dy'/dy at ideal x, y."""
    k1, k2, p1, p2, k3 = a[4:9]
    r2 = x * x + y * y
    g = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    h = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))  # (dg/dr2) * 2, so dg/dx = h x
    xd = x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * g + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    xx = g + h * x * x + 2 * p1 * y + 6 * p2 * x
    xy = h * x * y + 2 * p1 * x + 2 * p2 * y
    yy = g + h * y * y + 6 * p1 * y + 2 * p2 * x
    return xd, yd, xx, xy, yy
