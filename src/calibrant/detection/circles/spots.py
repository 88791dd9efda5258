"""Round spots in a picture: dark (or light) regions whose shape is that of a filled ellipse, with rough ellipses.

A region of an adaptive threshold is a filled ellipse when its area is what its second moments say: uniform on an
ellipse of half axes a, b they have determinant (ab)^2 / 16, so 4 pi sqrt(det) = pi a b. Rings, letters, L-shapes and
frames fail this at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Grey
from calibrant.compiled import compiled
from calibrant.opencv import cv2

CONTRAST = 6
"""Grey levels that a spot differs from the mean around it: twice the noise of a poor camera after smoothing."""
LEAST_AREA_PX = 12
"""A spot of 4 pixels across: below that the shape says nothing."""
LARGEST_PART = 0.02
"""Of the picture's area: nine spots with the gaps between them would just fit."""
MOST_SPOTS = 3000
ROUNDNESS = (0.85, 1.15)
"""Of 4 pi sqrt(det) over the area: 1 for an ellipse, 1.05 for a rectangle; whole pixels shake that of small spots."""
FLATTEST = 6.0
"""Half axes' ratio: a circle tilted by 80 degrees."""


@dataclass(frozen=True, eq=False)
class Spots:
    """Centres uv (n, 2) px; shape M (n, 2, 2) px^2, (q - uv)^T M^-1 (q - uv) = 1 on the outline; area (n,) px^2."""

    uv: Array
    shape: Array
    area: Array

    def __len__(self) -> int:
        return len(self.uv)

    def scaled(self, factor: int) -> Spots:
        """The spots of an image made smaller by `factor`, in the pixels of the full one."""
        return Spots(factor * (self.uv + 0.5) - 0.5, factor**2 * self.shape, factor**2 * self.area)


def find_spots(level: Grey, *, window_px: int) -> Spots:
    """Dark spots of a grey image (h, w) that are smaller than a window of `window_px`."""
    smooth = cv2.GaussianBlur(level, (3, 3), 0.8)
    window = window_px | 1
    binary = cv2.adaptiveThreshold(smooth, 1, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, window, CONTRAST)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(binary, connectivity=4, ltype=cv2.CV_32S)
    left, top, width, height, area = stats.T
    most = min(LARGEST_PART * level.size, float(window_px) ** 2)
    whole = (left > 0) & (top > 0) & (left + width < level.shape[1]) & (top + height < level.shape[0])
    # A flat ellipse on the diagonal fills least of its box: pi k / (2 (k^2 + 1)) for a ratio k of its axes.
    filled = area > 0.5 * np.pi * FLATTEST / (FLATTEST**2 + 1) * width * height
    keep = whole & filled & (area >= LEAST_AREA_PX) & (area <= most)
    keep[0] = False
    if not keep.any():
        return Spots(np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0))
    chosen = np.flatnonzero(keep)
    return _round_ones(_moments(np.asarray(labels, np.int32), chosen, np.asarray(stats[chosen], np.int32)))


@compiled("float64[:, ::1](int32[:, ::1], int64[::1], int32[:, ::1])")
def _moments(labels, chosen, stats):  # type: ignore[no-untyped-def]
    """Rows (n, 6) of labels chosen (n,): pixels, means of x, y, and central second moments xx, xy, yy."""
    out = np.zeros((len(chosen), 6))
    for k in range(len(chosen)):
        left, top, width, height = stats[k, 0], stats[k, 1], stats[k, 2], stats[k, 3]
        n, x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(height):
            for i in range(width):
                if labels[top + j, left + i] == chosen[k]:
                    n += 1.0
                    x += i
                    y += j
                    xx += i * i
                    xy += i * j
                    yy += j * j
        x, y = x / n, y / n
        out[k, 0], out[k, 1], out[k, 2] = n, left + x, top + y
        out[k, 3], out[k, 4], out[k, 5] = xx / n - x * x, xy / n - x * y, yy / n - y * y
    return out


def _round_ones(moments: Array) -> Spots:
    count, xx, xy, yy = moments[:, [0, 3, 4, 5]].T
    # A pixel is a square: its own second moment is 1/12.
    covariance = np.stack([np.stack([xx + 1 / 12, xy], -1), np.stack([xy, yy + 1 / 12], -1)], -2)
    roundness = 4 * np.pi * np.sqrt(np.maximum(np.linalg.det(covariance), 0.0)) / count
    small, large = np.linalg.eigvalsh(covariance).T
    good = (roundness > ROUNDNESS[0]) & (roundness < ROUNDNESS[1]) & (large < FLATTEST**2 * small)
    if good.sum() > MOST_SPOTS:
        good &= count >= np.sort(count[good])[-MOST_SPOTS]
    return Spots(moments[good, 1:3], 4.0 * covariance[good], count[good])
