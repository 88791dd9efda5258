"""Are the dark squares of a board that was found plain? Those of an AprilGrid hold tags."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array, Grey
from calibrant.detection.detection import Detection
from calibrant.targets.chessboard import Chessboard

PLACES = (0.25, 0.42, 0.58, 0.75)
"""Where a square is looked at, along either side: within the border of a tag, clear of the edges."""
UNEVEN = 0.5
"""Range within a dark square over the contrast of the board's squares, from which something is drawn in it."""
SHARE = 0.25
"""Of the dark squares: of an AprilGrid's every other one is a tag."""


def squares_hold_patterns(grey: Grey, found: Detection, target: Chessboard) -> bool:
    """Whether so many dark squares of a found board are uneven that it may be another target: a few pixels a square."""
    uv = np.full((target.rows, target.columns, 2), np.nan)
    uv[found.point_ids // target.columns, found.point_ids % target.columns] = found.uv
    cells = np.stack([uv[:-1, :-1], uv[:-1, 1:], uv[1:, :-1], uv[1:, 1:]], axis=2)
    row, column = np.nonzero(np.isfinite(cells).all(axis=(2, 3)))
    if not len(row):
        return False
    values = _looked_at(grey, cells[row, column])
    dark = (row + column) % 2 == 0  # as the square behind corner 0 is
    if not dark.any() or dark.all():
        return False
    contrast = float(np.median(values[~dark].max(axis=1)) - np.median(values[dark].min(axis=1)))
    uneven = np.ptp(values[dark], axis=1) > UNEVEN * contrast
    return bool(uneven.mean() > SHARE)


def _looked_at(grey: Grey, corners: Array) -> Array:
    """Grey levels (n, k) at places within squares of corners (n, 4, 2)."""
    s, t = (m.ravel() for m in np.meshgrid(PLACES, PLACES))
    weights = np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], axis=1)
    at = np.rint(weights @ corners).astype(np.int64)
    h, w = grey.shape
    return grey[at[..., 1].clip(0, h - 1), at[..., 0].clip(0, w - 1)].astype(np.float64)
