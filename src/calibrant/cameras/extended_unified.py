"""Extended unified camera model: alpha in [0, 1], beta > 0.

    rho = sqrt(beta R2 + Z^2),  S = 1 / (alpha rho + (1 - alpha) Z),  u = fx S X + cx,  v = fy S Y + cy

alpha = 0 is the pinhole, beta = 1 the unified model with xi = alpha / (1 - alpha). Both directions are closed forms.
Source: Khomutenko, Garcia and Martinet 2016, "An enhanced unified camera model", eq. 3 to 13.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.cameras.model import finite_points
from calibrant.cameras.radial import Radial, Shape, ray


class ExtendedUnified(Radial):
    """Points projected onto an ellipsoid, then from a point on its axis onto the image."""

    name: str = "extended_unified"
    parameter_names: tuple[str, ...] = ("fx", "fy", "cx", "cy", "alpha", "beta")
    parameter_units: tuple[str, ...] = ("px",) * 4 + ("1",) * 2
    neutral: ClassVar[dict[str, float]] = {"beta": 1.0}
    start_terms: ClassVar[dict[str, float]] = {"alpha": 0.5}
    summary: str = "fisheyes with few points: two terms, closed form both ways"

    def shape(self, terms: Array, R2: Array, z: Array) -> Shape:
        alpha, beta = terms
        rho = np.sqrt(beta * R2 + z * z)
        S = 1 / (alpha * rho + (1 - alpha) * z)
        S2 = S * S
        return Shape(
            S,
            -S2 * alpha * beta / rho,
            -S2 * (alpha * z / rho + 1 - alpha),
            (-S2 * (rho - z), -S2 * alpha * R2 / (2 * rho)),
        )

    def lift(self, terms: Array, mx: Array, my: Array) -> Array:
        alpha, beta = terms
        s = beta * (mx * mx + my * my)
        root = 1 - (2 * alpha - 1) * s
        z = (1 - alpha * alpha * s) / (alpha * np.sqrt(root) + 1 - alpha)
        return ray(mx, my, z, root >= 0)

    def sees(self, parameters: ArrayLike, p_camera: ArrayLike) -> Mask:
        *_, alpha, beta = np.asarray(parameters, dtype=np.float64)
        p = finite_points(p_camera)
        rho = np.sqrt(beta * (p[..., 0] ** 2 + p[..., 1] ** 2) + p[..., 2] ** 2)
        return (p[..., 2] > -behind(alpha) * rho) & (rho > 0)

    def rows(self) -> Any:
        from calibrant.cameras.kernels.extended_unified_rows import rows

        return rows


def behind(alpha: float) -> float:
    """w, the model seeing Z > -w rho: up to where the denominator vanishes, or where the image turns back."""
    return float(alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha)
