"""How well a camera's lens is known over its image: in pixels, and across a plane at a distance.

C = J_k C_k J_k^T at each pixel, J_k the derivative of the projection by the parameters: how far off a point that is
known in the camera's frame appears. Across a plane at depth z the same error is P_xy^-1 C P_xy^-T,
P_xy = d(u, v) / d(x, y).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.cameras import Camera
from calibrant.diagnose.budget.camera import of_pixel, of_position

GRID = (16, 12)
_WIDEST = 0.05
"""z of a ray of length 1 below which no plane ahead of the camera is met at a distance one works at."""


@dataclass(frozen=True, eq=False)
class ImageUncertainty:
    """1 sigma along the worst axis on GRID's cells, row by row, NaN where the camera sees nothing: sigma_px (n,), and
    sigma_mm (n,) across a plane at distance_m."""

    image_size: tuple[int, int]
    distance_m: float
    sigma_px: Array
    sigma_mm: Array


def image_uncertainty(camera: Camera, *, distance_m: float) -> ImageUncertainty:
    """On the middles of GRID's cells. Raises: InputError for a camera without covariance."""
    width, height = camera.image_size
    columns, rows = GRID
    u = (np.arange(columns) + 0.5) * width / columns - 0.5
    v = (np.arange(rows) + 0.5) * height / rows - 0.5
    p = camera.unproject(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    seen: Mask = np.asarray(np.isfinite(p).all(axis=-1))
    seen[seen] &= camera.model.valid(camera.values, p[seen])
    px, mm = np.full(len(p), np.nan), np.full(len(p), np.nan)
    px[seen] = _worst(of_pixel(camera, p[seen]))
    ahead = seen & (p[:, 2] > _WIDEST * np.linalg.norm(p, axis=1))
    at = distance_m * p[ahead] / p[ahead, 2:]
    mm[ahead] = 1e3 * _worst(of_position(camera, at)[:, :2, :2])
    return ImageUncertainty(camera.image_size, distance_m, px, mm)


def working_distance(T_camera_target: Iterable[Array]) -> float | None:
    """Median depth, metres, at which a camera saw its targets; None where it saw none."""
    depths = [float(T[2, 3]) for T in T_camera_target]
    return float(np.median(depths)) if depths and np.median(depths) > 0 else None


def _worst(C: Array) -> Array:
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(C)[..., -1], 0.0)))
