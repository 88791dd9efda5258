"""Noise and faults of measurements: what separates a simulated data set from its truth. Pure functions of an rng."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.geometry import se3


def noisy_pixels(uv: ArrayLike, sigma_px: float, *, rng: np.random.Generator) -> Array:
    """Pixels with Gaussian noise, sigma_px along each axis. Args: uv (..., 2). Returns (..., 2)."""
    pixels = np.asarray(uv, dtype=np.float64)
    return pixels + sigma_px * rng.standard_normal(pixels.shape)


def noisy_poses(T_a_b: ArrayLike, *, sigma_mm: float, sigma_deg: float, rng: np.random.Generator) -> Array:
    """Poses moved by `se3.retract` with Gaussian noise, sigma_mm and sigma_deg along each axis.

    Args: T_a_b (..., 4, 4). Returns (..., 4, 4).
    """
    T = np.asarray(T_a_b, dtype=np.float64)
    sigma = np.repeat([np.deg2rad(sigma_deg), 1e-3 * sigma_mm], 3)
    return se3.retract(T, sigma * rng.standard_normal((*T.shape[:-2], 6)))


def shifted(T: ArrayLike, *, by: int = 1) -> Array:
    """Poses that belong to the moment `by` later: the pairing fault of a lost first picture. Args: T (n, 4, 4)."""
    return np.roll(np.asarray(T, dtype=np.float64), -by, axis=0)


def flipped_board(points: ArrayLike, T_camera_target: ArrayLike) -> Array:
    """The pose that a detector reports when it numbers a plane grid from its opposite end.

    The board is turned by half a turn about its normal through its middle: T F with F = (Rz(pi), 2 c), c the middle.
    Args: points (n, 3) metres, target frame; T_camera_target (4, 4). Returns (4, 4).
    """
    p = np.asarray(points, dtype=np.float64)
    middle = 0.5 * (p.min(axis=0) + p.max(axis=0))
    F = se3.make(np.diag([-1.0, -1.0, 1.0]), 2 * middle * [1, 1, 0])
    return np.asarray(T_camera_target, dtype=np.float64) @ F
