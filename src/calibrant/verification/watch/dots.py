"""Gripper features in a hand camera's pictures: dots that stay where they are, as long as the camera does.

A dot is looked for around the pixel that it had at the calibration: of the blobs there, darker or lighter than what
surrounds them, the one nearest to that pixel; its place is the centroid of contrast. A camera on the gripper sees its
own gripper at the same pixels from every pose, so that

    off_i = uv_i - uv_then = -e_then + d + e_i,

d the shift of each dot, needs neither the robot nor the lens. A move of the camera (6 numbers) is told from the shifts
where three dots or more are known in the gripper; two dots tell that, when and by how many pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.verification.watch.sequential import Sight

REACH_PX = 25
"""How far a dot is looked for from where it was: a push of some 5 mm at a hand camera's distance."""
LEAST_CONTRAST = 20.0
"""Grey levels between a dot and what is around it, of 255."""


@dataclass(frozen=True, eq=False)
class DotsThen:
    """uv (m, 2) of the dots in the picture of then, pixels, and where they are in the gripper (m, 3), metres."""

    uv: Array
    points: Array
    sigma_px: float


def find_dots(grey: NDArray[Any], uv: Array, *, reach: int = REACH_PX) -> Array:
    """Pixels (m, 2) of the dots in a grey picture (h, w), NaN for one that is not there."""
    return np.array([_near(np.asarray(grey, dtype=np.float32), p, reach) for p in uv]).reshape(-1, 2)


def _near(grey: NDArray[Any], at: Array, reach: int) -> tuple[float, float]:
    h, w = grey.shape
    x0, y0 = (max(round(float(c)) - reach, 0) for c in at)
    part = grey[y0 : min(y0 + 2 * reach + 1, h), x0 : min(x0 + 2 * reach + 1, w)]
    if part.size == 0:
        return float("nan"), float("nan")
    around = float(np.median(part))
    best, nearest = (float("nan"), float("nan")), float("inf")
    for contrast in (around - part, part - around):
        most = float(contrast.max())
        if most < LEAST_CONTRAST:
            continue
        count, labels, stats, _ = cv2.connectedComponentsWithStats((contrast > most / 2).astype(np.uint8))
        for k in range(1, count):
            x, y, width, height, area = stats[k]
            cut = x == 0 or y == 0 or x + width == part.shape[1] or y + height == part.shape[0]
            if cut or area < 4:
                continue
            grown = cv2.dilate((labels == k).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
            weight = np.where(grown, np.maximum(contrast - most / 8, 0.0), 0.0)
            rows, columns = np.mgrid[0 : part.shape[0], 0 : part.shape[1]]
            u, v = (float((weight * c).sum() / weight.sum()) for c in (columns, rows))
            away = float(np.hypot(x0 + u - at[0], y0 + v - at[1]))
            if away < nearest and away <= reach:
                best, nearest = (x0 + u, y0 + v), away
    return best


def dot_sights(names: list[str], found: Array, then: DotsThen) -> tuple[Sight, ...]:
    """Sights of pictures whose dots are at found (n, m, 2) pixels. Raises: InputError for a dot that was not found."""
    m = 2 * len(then.uv)
    nothing = np.zeros((m, 0))
    for name, uv in zip(names, found):
        lost = np.flatnonzero(~np.isfinite(uv).all(axis=1))
        if len(lost):
            raise InputError(
                f"{name}: feature {lost[0] + 1} is not near pixel ({then.uv[lost[0], 0]:.0f}, "
                f"{then.uv[lost[0], 1]:.0f}), where it was"
            )
    noise = then.sigma_px**2 * np.eye(m)
    return tuple(
        Sight(name, (uv - then.uv).ravel(), then.sigma_px * np.eye(m), nothing, 0, np.eye(m), noise)
        for name, uv in zip(names, found)
    )


def camera_move(
    camera: Camera, T_gripper_camera: Array, then: DotsThen, shift: Array, covariance: Array
) -> tuple[Array, Array] | None:
    """The camera's move (6,), T_before_after in its own axes, with its covariance, from the dots' shifts (2 m,) px.

    None for fewer than three dots, or three that do not tell it. Least squares on du = -J (v + omega x p) d.
    """
    if len(then.uv) < 3:
        return None
    p = se3.apply(se3.inverse(T_gripper_camera), then.points)
    _, J_point, _ = camera.model.project_with_jacobians(camera.values, p)
    J = -np.concatenate([-J_point @ so3.hat(p), J_point], axis=-1).reshape(-1, 6)
    white = np.linalg.cholesky(covariance)
    A, b = np.linalg.solve(white, J), np.linalg.solve(white, shift)
    scale = 1 / np.linalg.norm(A, axis=0)
    U, s, Vt = np.linalg.svd(A * scale, full_matrices=False)
    if s[-1] < 1e-4 * s[0]:
        return None
    back = scale[:, None] * (Vt.T / s) @ U.T
    return back @ b, back @ back.T
