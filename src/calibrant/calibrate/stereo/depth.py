"""How certain a triangulated point is: by the calibration of all eyes, and by the noise of its pixels.

A point p of the first camera's frame is where the weighted residuals project(theta_i, T_first_i^-1 p) - u_i are least.
With J their derivatives by p and W their weights, it follows what it rests on:

    dp = -A (J_theta dtheta - du),   A = (J^T W J)^-1 J^T W,     C_p = A J_theta C (A J_theta)^T + A Sigma_u A^T,

theta all lenses and places together, so that errors which they share cancel as they do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.geometry import se3, so3


@dataclass(frozen=True, eq=False)
class PointCertainty:
    """Covariances (n, 3, 3), square metres along the first camera's axes: by the calibration, and by the pixels.

    by_calibration (n, 3, p): d point / d of what the calibration's covariance is of.
    """

    calibration: Array
    matching: Array
    by_calibration: Array

    @property
    def both(self) -> Array:
        """Their sum: they are independent."""
        return self.calibration + self.matching


def point_certainty(
    cameras: Sequence[Camera],
    T_first_camera: ArrayLike,
    points: ArrayLike,
    *,
    covariance: Array,
    sigma_px: Sequence[float],
    weights: Array | None = None,
) -> PointCertainty:
    """Of points (n, 3) ahead of the cameras, first camera's frame, metres; T_first_camera (c, 4, 4).

    covariance (p, p): of the places of all cameras but the first, then of all lenses (`JointCovariance.whole`); zero
    for what is exact. sigma_px: of a pixel, per axis, by camera. weights (c, n, 2, 2): W, zero where a camera does not
    see a point; those of the most likely point, 1 / sigma^2, where none are given.
    """
    p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    n, places = len(p), 6 * (len(cameras) - 1)
    if weights is None:
        weights = np.broadcast_to(np.eye(2), (n, 2, 2)) / np.square(sigma_px)[:, None, None, None]
    H, by = np.zeros((n, 3, 3)), np.zeros((n, 3, len(covariance)))
    by_pixels = []
    column = places
    for i, (camera, T, W) in enumerate(zip(cameras, np.asarray(T_first_camera, dtype=np.float64), weights)):
        R, t = T[:3, :3], T[:3, 3]
        _, J_q, J_lens = camera.model.project_with_jacobians(camera.values, se3.apply(se3.inverse(T), p))
        J = np.where(np.any(W, axis=(1, 2))[:, None, None], J_q @ R.T, 0.0)
        g = np.swapaxes(J, 1, 2) @ W
        H += g @ J
        by_pixels.append(g)
        seen = np.where(np.any(W, axis=(1, 2))[:, None, None], J_lens, 0.0)
        by[:, :, column : column + seen.shape[2]] -= g @ seen
        column += seen.shape[2]
        if i:
            # q = R^T (p - t), with R <- exp(omega) R: R dq = [p - t]x omega - dt, and the point held.
            J_T = np.concatenate([so3.hat(p - t), np.broadcast_to(-np.eye(3), (n, 3, 3))], axis=2)
            by[:, :, 6 * (i - 1) : 6 * i] -= g @ J @ J_T
    inverse = np.linalg.inv(H)
    by = inverse @ by
    matching = np.zeros((n, 3, 3))
    for g, sigma in zip(by_pixels, sigma_px):
        A = inverse @ g
        matching += sigma**2 * A @ np.swapaxes(A, 1, 2)
    return PointCertainty(by @ covariance @ np.swapaxes(by, 1, 2), matching, by)
