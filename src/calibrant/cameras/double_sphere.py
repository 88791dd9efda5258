"""Double sphere camera model: xi, and alpha in [0, 1].

    d1 = sqrt(R2 + Z^2),  Z' = xi d1 + Z,  d2 = sqrt(R2 + Z'^2),  S = 1 / (alpha d2 + (1 - alpha) Z')
    u = fx S X + cx,  v = fy S Y + cy

Both directions are closed forms. Source: Usenko, Demmel and Cremers 2018, "The double sphere camera model", eq. 40 to
50.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.cameras.extended_unified import behind
from calibrant.cameras.model import finite_points
from calibrant.cameras.radial import Radial, Shape, ray


class DoubleSphere(Radial):
    """Points projected onto two unit spheres in turn, then from a point on the axis onto the image."""

    name: str = "double_sphere"
    parameter_names: tuple[str, ...] = ("fx", "fy", "cx", "cy", "xi", "alpha")
    parameter_units: tuple[str, ...] = ("px",) * 4 + ("1",) * 2
    start_terms: ClassVar[dict[str, float]] = {"alpha": 0.5}
    summary: str = "fisheyes beyond 180 degrees: two terms, closed form both ways"

    def shape(self, terms: Array, R2: Array, z: Array) -> Shape:
        xi, alpha = terms
        d1 = np.sqrt(R2 + z * z)
        zz = xi * d1 + z
        d2 = np.sqrt(R2 + zz * zz)
        S = 1 / (alpha * d2 + (1 - alpha) * zz)
        S2 = S * S
        return Shape(
            S,
            -S2 * (alpha * (1 + zz * xi / d1) / d2 + (1 - alpha) * xi / d1),
            -S2 * (alpha * zz / d2 + 1 - alpha) * (xi * z / d1 + 1),
            (-S2 * (alpha * zz / d2 + 1 - alpha) * d1, -S2 * (d2 - zz)),
        )

    def lift(self, terms: Array, mx: Array, my: Array) -> Array:
        xi, alpha = terms
        r2 = mx * mx + my * my
        root = 1 - (2 * alpha - 1) * r2
        mz = (1 - alpha * alpha * r2) / (alpha * np.sqrt(root) + 1 - alpha)
        second = mz * mz + (1 - xi * xi) * r2
        k = (mz * xi + np.sqrt(second)) / (mz * mz + r2)
        return ray(k * mx, k * my, k * mz - xi, (root >= 0) & (second >= 0))

    def sees(self, parameters: ArrayLike, p_camera: ArrayLike) -> Mask:
        *_, xi, alpha = np.asarray(parameters, dtype=np.float64)
        p = finite_points(p_camera)
        w1 = behind(alpha)
        w2 = (w1 + xi) / np.sqrt(2 * w1 * xi + xi * xi + 1)
        d1 = np.linalg.norm(p, axis=-1)
        return (p[..., 2] > -w2 * d1) & (d1 > 0)

    def rows(self) -> Any:
        from calibrant.cameras.kernels.double_sphere_rows import rows

        return rows
