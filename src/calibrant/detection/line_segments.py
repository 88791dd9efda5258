"""Straight edges of a picture, each as a row of sub-pixel points, so that a distorted lens may bend them.

Where edges are is found by OpenCV's line segment detector (von Gioi, Jakubowicz, Morel and Randall 2012, "LSD: a line
segment detector"), which breaks a bent edge into pieces that are nearly straight. Where exactly is found here: across
an edge the gradient of the smoothed picture is a Gaussian, whose peak is that of a parabola through its logarithms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter

from calibrant.arrays import Array
from calibrant.opencv import cv2

SMOOTHING_PX = 1.0
"""Sigma of the picture's smoothing: its own sampling and the lens blur are of this size."""
STEP_PX = 4.0
"""Distance of points along an edge: after smoothing by 1 px their noise is independent to exp(-4), 2 %."""
REACH_PX = 3
"""How far from the detector's line the edge is looked for: it is within a pixel, and bends by less."""
END_PX = 3.0
"""Left out at both ends, where corners bend the edge."""
FEWEST_POINTS = 5
"""A line takes two; the others tell how noisy it is."""
SHORTEST = 0.02
"""Length over the image's diagonal below which a segment's direction says nothing: 5 degrees and more of error."""


@dataclass(frozen=True, eq=False)
class Segments:
    """Edges laid end to end: uv (N, 2) sub-pixel points, offsets (m + 1,) of their first points."""

    uv: Array
    offsets: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def ends(self) -> Array:
        """First and last point (m, 2, 2) of each edge."""
        return np.stack([self.uv[self.offsets[:-1]], self.uv[self.offsets[1:] - 1]], axis=1)

    def only(self, keep: NDArray[np.bool_]) -> Segments:
        """The edges where keep (m,) is true."""
        return from_parts([p for p, k in zip(np.split(self.uv, self.offsets[1:-1]), keep) if k])


def from_parts(parts: list[Array]) -> Segments:
    """Segments of a list of points (n, 2) each."""
    offsets = np.concatenate([[0], np.cumsum([len(p) for p in parts])]).astype(np.int64)
    return Segments(np.concatenate(parts) if parts else np.empty((0, 2)), offsets)


def find_segments(grey: NDArray[np.uint8]) -> Segments:
    """Straight edges of a grey picture (h, w), the longest first."""
    # OpenCV 4 returns (n, 1, 4), OpenCV 5 (n, 4), both None where there is nothing.
    lines = cv2.createLineSegmentDetector().detect(grey)[0]
    if lines is None:
        return from_parts([])
    ends = np.asarray(lines, dtype=np.float64).reshape(-1, 2, 2)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    shortest = max(SHORTEST * float(np.hypot(*grey.shape)), (FEWEST_POINTS - 1) * STEP_PX + 2 * END_PX)
    order = [i for i in np.argsort(-length, kind="stable") if length[i] >= shortest]
    smooth = cv2.GaussianBlur(grey.astype(np.float64), (0, 0), SMOOTHING_PX)
    # Cubic splines, as the library's own look-up rounds places to 1/32 px. Central differences: (u, v) gradient.
    gradient = [spline_filter(g, order=3) for g in np.gradient(smooth)[::-1]]
    parts = [_edge_points(gradient, ends[i], float(length[i])) for i in order]
    return from_parts([p for p in parts if len(p) >= FEWEST_POINTS])


def _edge_points(gradient: list[Array], ends: Array, length: float) -> Array:
    """Points (n, 2) of the edge near a line, every STEP_PX, where the gradient across it peaks."""
    along = (ends[1] - ends[0]) / length
    across = np.array([-along[1], along[0]])
    at = np.arange(END_PX, length - END_PX + 1e-9, STEP_PX)
    steps = np.arange(-REACH_PX - 1, REACH_PX + 2, dtype=np.float64)
    places = ends[0] + at[:, None, None] * along + steps[None, :, None] * across
    rows_columns = np.moveaxis(places[..., ::-1], -1, 0)
    u, v = (map_coordinates(g, rows_columns, order=3, prefilter=False, mode="nearest") for g in gradient)
    slope = u * across[0] + v * across[1]
    slope *= np.sign(np.sum(slope)) or 1.0
    peak = np.argmax(slope[:, 1:-1], axis=1) + 1
    rows = np.arange(len(at))
    left, middle, right = (slope[rows, peak + k] for k in (-1, 0, 1))
    good = (peak > 1) & (peak < len(steps) - 2) & (left > 0) & (right > 0) & (middle > left) & (middle > right)
    good &= middle > 0.5 * np.median(middle)  # where the edge fades, its neighbours would be taken for it
    a, b, c = (np.log(np.where(good, s, 1.0)) for s in (left, middle, right))
    bend = a - 2 * b + c
    offset = steps[peak] + np.where(good, 0.5 * (a - c) / np.where(good, bend, 1.0), 0.0)
    height, width = gradient[0].shape
    points = ends[0] + at[:, None] * along + offset[:, None] * across
    inside = np.all((points > REACH_PX) & (points < np.array([width, height]) - 1 - REACH_PX), axis=1)
    return points[good & inside]
