"""Pairs drawn with the rows that their matches share: as the cameras took them, and rectified."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.opencv import cv2
from calibrant.perceive.stereo.rectification import Rectification

ROWS = 16
"""Lines over a picture: near enough to tell a pixel off, far enough to see the picture."""
COLOURS = ((60, 60, 230), (60, 200, 60), (240, 160, 40), (40, 200, 230))
"""Red, green, blue and yellow in BGR, one after the other."""
_BITS = 4
_STEPS = 200
"""Straight pieces of a curved line."""


def colour_of(image: NDArray[Any]) -> NDArray[np.uint8]:
    """A picture of any depth and channels as (h, w, 3) BGR, 8 bits."""
    eight = image
    if image.dtype != np.uint8:
        low, high = float(image.min()), float(image.max())
        eight = ((image.astype(np.float64) - low) * (255 / max(high - low, 1e-12))).astype(np.uint8)
    if eight.ndim == 2 or eight.shape[2] == 1:
        return np.asarray(cv2.cvtColor(eight, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return np.ascontiguousarray(eight[..., :3])


def drawn_rows(pair: Rectification, images: Sequence[NDArray[Any]]) -> NDArray[np.uint8]:
    """The pair before and after, (h, w, 3) BGR: matches share a line of one colour.

    images: left and right as the cameras took them. Cameras beside each other: before above, after below; above each
    other: before on the left, after on the right.
    """
    before, after = [], []
    for i, image in enumerate(images):
        own = colour_of(image)
        rectified = pair.maps[i].apply(own)
        for k, line in enumerate(_lines(pair, i)):
            _draw(rectified, line, k)
            _draw(own, pair.own_pixels(i, line), k)
        before.append(own)
        after.append(rectified)
    side, over = (1, 0) if pair.along == 0 else (0, 1)
    return joined([joined(before, axis=side), joined(after, axis=side)], axis=over)


def _lines(pair: Rectification, i: int) -> list[Array]:
    """Rows (columns) of rectified picture i as points (m, 2)."""
    width, height = pair.views[i].image_size
    size = (width, height)
    run = np.linspace(0, size[pair.along] - 1, _STEPS)
    out = []
    for at in (np.arange(ROWS) + 0.5) / ROWS * (size[1 - pair.along] - 1):
        line = np.empty((_STEPS, 2))
        line[:, pair.along], line[:, 1 - pair.along] = run, at
        out.append(line)
    return out


def _draw(canvas: NDArray[np.uint8], line: Array, k: int) -> None:
    height, width = canvas.shape[:2]
    with np.errstate(invalid="ignore"):
        inside = np.all((line > -width) & (line < 2 * width + height), axis=1)
    thick = max(1, round(width / 1000))
    for piece in np.split(line, np.flatnonzero(np.diff(inside.astype(np.int8))) + 1):
        if len(piece) > 1 and np.isfinite(piece).all() and np.abs(piece).max() < 2**15 / 2:
            points = np.rint(piece * 2**_BITS).astype(np.int32)
            cv2.polylines(canvas, [points], False, COLOURS[k % len(COLOURS)], thick, cv2.LINE_AA, _BITS)


def joined(parts: Sequence[NDArray[np.uint8]], *, axis: int) -> NDArray[np.uint8]:
    """Pictures beside (axis 1) or below each other (axis 0), the smaller ones filled up in black."""
    most = max(p.shape[1 - axis] for p in parts)
    padded = []
    for p in parts:
        more = [(0, 0), (0, 0), (0, 0)]
        more[1 - axis] = (0, most - p.shape[1 - axis])
        padded.append(np.pad(p, more))
    return np.concatenate(padded, axis=axis)
