"""How well the lens is known in the image's corners, where often no point was seen.

The sigma of a pixel at a fixed ray says little: a turn of the camera moves the whole image, and the pose of whatever is
seen takes it up. What counts is what is left at the corner once the turn that fits the seen points best is taken out,

    R = J_corner - J_turn A,  A = argmin |J_seen - J_turn A|,  sigma^2 = largest eigenvalue of R C R^T,

with C the covariance of the lens and J its derivatives at rays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.derivatives import derivatives
from calibrant.cameras import Camera
from calibrant.geometry import so3

CORNERS = {"upper left": (0, 0), "upper right": (1, 0), "lower left": (0, 1), "lower right": (1, 1)}
_STEPS = 10
_SETTLED_PX = 0.01
"""Where sigma is asked for, a hundredth of a pixel is near enough."""
_ENOUGH = 200
"""Seen points that tell a turn as well as thousands do."""


def enough_of(points: int) -> slice:
    """Which of so many seen points to ask; of these it chooses all."""
    return slice(None, None, max(1, points // _ENOUGH))


def corner_sigmas(camera: Camera, seen: Array, names: Sequence[str]) -> dict[str, float]:
    """1 sigma, px, worst direction, of the pixel at these corners; NaN where the lens shows nothing there.

    Args: seen (N, 3), the points that were seen, camera frame, metres.
    """
    if camera.covariance is None or not len(seen):
        return dict.fromkeys(names, float("nan"))
    some = np.asarray(seen[enough_of(len(seen))], dtype=np.float64)
    turn, lens = _derivatives(camera, some)
    good = np.isfinite(lens.reshape(len(lens), -1).sum(axis=1))
    k = lens.shape[2]
    A = np.linalg.lstsq(turn[good].reshape(-1, 3), lens[good].reshape(-1, k), rcond=None)[0]
    width, height = camera.image_size
    rays = _rays(camera, np.array([CORNERS[n] for n in names]) * [width - 1.0, height - 1.0])
    there = np.isfinite(rays.sum(axis=1))
    turn, lens = _derivatives(camera, np.where(there[:, None], rays, [0.0, 0.0, 1.0]))
    R = lens - turn @ A
    variance = np.linalg.eigvalsh(R @ camera.covariance @ np.swapaxes(R, 1, 2))[:, -1]
    sigma = np.where(there, np.sqrt(np.maximum(variance, 0.0)), np.nan)
    return dict(zip(names, sigma.tolist()))


def _rays(camera: Camera, pixels: Array) -> Array:
    """Rays (n, 3) of pixels: Newton's steps from the ray without distortion, several times faster for a few pixels than
    `unproject`, which first finds where the lens folds; it answers where they do not settle inside the valid field."""
    fx, fy, cx, cy = (camera.parameters[n] for n in ("fx", "fy", "cx", "cy"))
    rays = np.column_stack([(pixels - [cx, cy]) / [fx, fy], np.ones(len(pixels))])
    for _ in range(_STEPS):
        uv, J, _ = derivatives(camera, rays)
        J = J[:, :, :2]
        determinant = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
        if not determinant.min() > 0:  # beyond the fold, or no pixel at all
            return camera.unproject(pixels)
        off = pixels - uv
        if np.abs(off).max() < _SETTLED_PX:
            return rays
        step = np.stack(
            [J[:, 1, 1] * off[:, 0] - J[:, 0, 1] * off[:, 1], J[:, 0, 0] * off[:, 1] - J[:, 1, 0] * off[:, 0]]
        )
        rays[:, :2] += (step / determinant).T
    return camera.unproject(pixels)


def _derivatives(camera: Camera, points: Array) -> tuple[Array, Array]:
    """d pixel / d (turn of the camera) (n, 2, 3) and / d parameters (n, 2, k) at points of the camera frame."""
    _, J_point, J_lens = derivatives(camera, points)
    return -J_point @ so3.hat(points), J_lens
