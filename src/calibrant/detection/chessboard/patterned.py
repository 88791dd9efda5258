"""Are the squares of a board that was found plain? An AprilGrid's dark ones hold tags, a ChArUco board's light ones."""

from __future__ import annotations

from typing import Literal

import numpy as np

from calibrant.arrays import Array, Grey
from calibrant.detection.detection import Detection
from calibrant.targets.chessboard import Chessboard

PLACES = (0.25, 0.42, 0.58, 0.75)
"""Where a square is looked at, along either side: within the border of a tag, clear of the edges."""
UNEVEN = 0.5
"""Range within a dark square over the contrast of the board's squares, from which something is drawn in it."""
SHARE = 0.25
"""Of the squares of a colour: of an AprilGrid's dark ones every other is a tag, of a ChArUco board's light ones all."""

Squares = Literal["dark", "light"]
SQUARES: tuple[Squares, ...] = ("dark", "light")


def squares_hold_patterns(grey: Grey, found: Detection, target: Chessboard, which: Squares = "dark") -> bool:
    """Whether so many squares of a found board are uneven that it may be another target: a few pixels a square."""
    uv = np.full((target.rows, target.columns, 2), np.nan)
    uv[found.point_ids // target.columns, found.point_ids % target.columns] = found.uv
    return bool(uneven_share(grey, uv, which, dark=True) > SHARE)  # as the square behind corner 0 is


def uneven_share(grey: Grey, corners: Array, which: Squares, *, dark: bool) -> float:
    """Share of the dark or the light squares in which something is drawn, 0 where none is seen.

    Args: corners (rows, columns, 2) px, NaN where unknown; dark: the colour of the square after corner (0, 0).
    """
    cells = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, :-1], corners[1:, 1:]], axis=2)
    row, column = np.nonzero(np.isfinite(cells).all(axis=(2, 3)))
    values = _looked_at(grey, cells[row, column])
    is_dark = ((row + column) % 2 == 0) == dark
    if not is_dark.any() or is_dark.all():
        return 0.0
    contrast = float(np.median(values[~is_dark].max(axis=1)) - np.median(values[is_dark].min(axis=1)))
    asked = values[is_dark if which == "dark" else ~is_dark]
    return float((np.ptp(asked, axis=1) > UNEVEN * contrast).mean())


def _looked_at(grey: Grey, corners: Array) -> Array:
    """Grey levels (n, k) at places within squares of corners (n, 4, 2)."""
    s, t = (m.ravel() for m in np.meshgrid(PLACES, PLACES))
    weights = np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], axis=1)
    at = np.rint(weights @ corners).astype(np.int64)
    h, w = grey.shape
    return grey[at[..., 1].clip(0, h - 1), at[..., 0].clip(0, w - 1)].astype(np.float64)
