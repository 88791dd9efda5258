"""The spot as a person sees it: both pictures with the plane's corners, the pointer's axis and the spot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.opencv import cv2
from calibrant.perceive.pointing.spot import Sight, Spot

CORNER, AXIS, SPOT = (240, 160, 40), (60, 200, 60), (60, 60, 230)
"""Blue, green and red in BGR."""
_BITS = 4
_ELLIPSE_POINTS = 72
_FARTHEST = 20_000.0
"""Pixels from a picture beyond which nothing is drawn: OpenCV counts in 16 bits and four more for parts."""


def drawn(images: Sequence[NDArray[Any]], sights: Sequence[Sight], spot: Spot) -> NDArray[np.uint8]:
    """Both pictures side by side, (h, w, 3) BGR, the lower one filled up in black."""
    parts = [_one(image, sight, spot, i) for i, (image, sight) in enumerate(zip(images, sights))]
    height = max(part.shape[0] for part in parts)
    return np.concatenate([np.pad(p, ((0, height - p.shape[0]), (0, 0), (0, 0))) for p in parts], axis=1)


def _one(image: NDArray[Any], sight: Sight, spot: Spot, side: int) -> NDArray[np.uint8]:
    canvas = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()
    unit = max(canvas.shape[1] / 1000, 0.6)
    thick = max(1, round(2 * unit))
    for u, v in sight.corners:
        cv2.circle(canvas, _fixed([u, v]), round(6 * unit * 2**_BITS), CORNER, thick, cv2.LINE_AA, _BITS)
    at = spot.uv[side]
    if np.isfinite(at).all() and np.abs(at).max() < _FARTHEST:
        far = sight.axis[np.argmax(np.linalg.norm(sight.axis - at, axis=1))]
        cv2.line(canvas, _fixed(far), _fixed(at), AXIS, thick, cv2.LINE_AA, _BITS)
        ring = _region(spot, side)
        if np.isfinite(ring).all() and np.abs(ring).max() < _FARTHEST:
            cv2.polylines(canvas, [np.rint(ring * 2**_BITS).astype(np.int32)], True, SPOT, thick, cv2.LINE_AA, _BITS)
        place = (round(float(at[0])), round(float(at[1])))
        cv2.drawMarker(canvas, place, SPOT, cv2.MARKER_CROSS, round(24 * unit), thick, cv2.LINE_AA)
    return np.asarray(canvas, dtype=np.uint8)


def _region(spot: Spot, side: int) -> Array:
    """The outline of the region of 95 %, pixels (m, 2)."""
    values, axes = np.linalg.eigh(spot.covariance)
    angle = np.linspace(0, 2 * np.pi, _ELLIPSE_POINTS, endpoint=False)
    size = np.sqrt(-2 * np.log(0.05) * np.maximum(values, 0))
    ring = spot.xy + (np.stack([np.cos(angle), np.sin(angle)], axis=1) * size) @ axes.T
    mapped = np.concatenate([ring, np.ones((len(ring), 1))], axis=1) @ spot.T[side].T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def _fixed(point: Sequence[float] | Array) -> tuple[int, int]:
    u, v = (round(float(c) * 2**_BITS) for c in point)
    return u, v
