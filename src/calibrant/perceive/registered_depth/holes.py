"""Small holes of a depth picture, filled by the plane through their rim where the rim is one; told as filled."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.opencv import cv2
from calibrant.perceive.registered_depth.noise import DepthNoise

LARGEST_PX = 400
"""A hole of 20 x 20 pixels; what is larger hides more than it can be guessed from its rim."""
_FAR = 5.0
"""Sigmas that a rim may leave its own plane by: more is a step, and what lies in the hole is not known."""


def fill_holes(
    depth: Array, *, noise: DepthNoise, largest_px: int = LARGEST_PX, wanted: Mask | None = None
) -> tuple[Array, Mask]:
    """The depth (h, w) with its small holes filled, and where it was filled (h, w).

    1/z is linear across a plane, so that the rim's inverse depths are fitted by a linear function of the pixels. Holes
    across a step in depth, larger than `largest_px` pixels, or at the picture's edge stay holes. wanted (h, w): where
    holes are filled, everywhere by default.
    """
    hole = ~np.isfinite(depth)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(hole.astype(np.uint8), connectivity=4)
    out, filled = np.array(depth), np.zeros(depth.shape, dtype=np.bool_)
    height, width = depth.shape
    for i in range(1, count):
        x, y, w, h, area = (int(n) for n in stats[i])
        if area > largest_px or x == 0 or y == 0 or x + w == width or y + h == height:
            continue
        rows, columns = slice(y - 1, y + h + 1), slice(x - 1, x + w + 1)
        inside = labels[rows, columns] == i
        if wanted is not None and not (wanted[rows, columns] & inside).any():
            continue
        rim = (cv2.dilate(inside.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & np.isfinite(depth[rows, columns])
        v, u = np.nonzero(rim)
        if len(v) < 4:
            continue
        A = np.stack([u, v, np.ones(len(u))], axis=1).astype(np.float64)
        q = 1 / depth[rows, columns][rim]
        fit, *_ = np.linalg.lstsq(A, q, rcond=None)
        if np.abs(A @ fit - q).max() > _FAR * noise.inverse_sigma:
            continue
        v, u = np.nonzero(inside)
        inverse = np.stack([u, v, np.ones(len(u))], axis=1) @ fit
        if inverse.min() <= 0:
            continue
        out[rows, columns][inside] = 1 / inverse
        filled[rows, columns] |= inside
    return out, filled
