"""Central cameras whose image is turned about the axis like the scene: fisheye, sphere and division models.

    R2 = X^2 + Y^2,  m = S(R2, Z; terms) (X, Y),  u = fx m_x + cx,  v = fy m_y + cy

A model gives S and its derivatives; everything else follows:

    dm/dX = (S + X^2 T, X Y T),  dm/dZ = S_Z (X, Y),  T = 2 dS/dR2
"""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.cameras.model import CameraModel, Projection, finite_points


class Shape(NamedTuple):
    """S (...), T = 2 dS/dR2, S_Z = dS/dZ and the derivatives of S by the model's terms."""

    S: Array
    T: Array
    S_z: Array
    by_terms: tuple[Array, ...]


class Radial(CameraModel):
    """A model whose parameters are fx fy cx cy and the terms of `shape`."""

    projection: Projection = "central"

    @abstractmethod
    def shape(self, terms: Array, R2: Array, z: Array) -> Shape:
        """S and its derivatives at points that the model sees."""

    @abstractmethod
    def lift(self, terms: Array, mx: Array, my: Array) -> Array:
        """Directions (..., 3) of image-plane points, NaN where there is none."""

    @abstractmethod
    def sees(self, parameters: ArrayLike, p_camera: ArrayLike) -> Mask: ...

    def project(self, parameters: ArrayLike, p_camera: ArrayLike) -> Array:
        fx, fy, cx, cy, *_ = a = np.asarray(parameters, dtype=np.float64)
        x, y, R2, z = self._seen(a, p_camera)
        with np.errstate(all="ignore"):
            S = self.shape(a[4:], R2, z).S
        return np.stack([fx * S * x + cx, fy * S * y + cy], axis=-1)

    def project_with_jacobians(self, parameters: ArrayLike, p_camera: ArrayLike) -> tuple[Array, Array, Array]:
        fx, fy, cx, cy, *_ = a = np.asarray(parameters, dtype=np.float64)
        x, y, R2, z = self._seen(a, p_camera)
        with np.errstate(all="ignore"):
            S, T, S_z, by_terms = self.shape(a[4:], R2, z)
        uv = np.stack([fx * S * x + cx, fy * S * y + cy], axis=-1)
        J_point = np.empty((*x.shape, 2, 3))
        J_point[..., 0, 0], J_point[..., 0, 1], J_point[..., 0, 2] = fx * (S + x * x * T), fx * x * y * T, fx * x * S_z
        J_point[..., 1, 0], J_point[..., 1, 1], J_point[..., 1, 2] = fy * x * y * T, fy * (S + y * y * T), fy * y * S_z
        J_k = np.zeros((*x.shape, 2, len(a)))
        J_k[..., 0, 0], J_k[..., 1, 1], J_k[..., 0, 2], J_k[..., 1, 3] = S * x, S * y, 1.0, 1.0
        for column, by_term in enumerate(by_terms, 4):
            J_k[..., 0, column], J_k[..., 1, column] = fx * x * by_term, fy * y * by_term
        return uv, J_point, J_k

    def _seen(self, parameters: Array, p_camera: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """x, y, R2, z, with NaN in R2 for points without a pixel, which spreads to all that follows."""
        p = finite_points(p_camera)
        x, y, z = p[..., 0], p[..., 1], p[..., 2]
        return x, y, np.where(self.sees(parameters, p), x * x + y * y, np.nan), z

    def _unproject(self, parameters: Array, uv: Array) -> Array:
        fx, fy, cx, cy, *_ = parameters
        with np.errstate(all="ignore"):
            rays = self.lift(parameters[4:], (uv[:, 0] - cx) / fx, (uv[:, 1] - cy) / fy)
        # A closed form may go on past the rim, to directions that the model images elsewhere.
        return np.where(self.sees(parameters, rays)[:, None], rays, np.nan)


def ray(x: Array, y: Array, z: Array, good: Mask) -> Array:
    """Directions (..., 3), NaN where not `good`."""
    return np.where(good[..., None], np.stack([x, y, z], axis=-1), np.nan)
