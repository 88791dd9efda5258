"""The axis of a pointer in a picture: the middle line of its longest elongated part, or of that of a colour.

Parts are what lies above or below Otsu's threshold, or within a range of hues. A part is a pointer where it is
`ELONGATED` times as long as wide and does not run along the picture's edge; its middle line is fitted to the middles of
its cross sections.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.errors import InputError
from calibrant.opencv import cv2

ELONGATED = 5.0
"""Length over width: a finger has about this, a pencil 20; hands, boards and shadows of heads have less."""
SHORTEST_PX = 20.0
"""A shorter part leaves a line less certain than 2 deg at half a pixel."""
ALONG_EDGE = 0.5
"""Part of its length that a pointer may have on the picture's edge: more is what the edge cuts off, a strip of wall
beside a table say. A pointer comes in across the edge, by its width."""
_ENDS = 0.1
"""Part of the length at each end that is left out: tips are pointed, and ends are cut off askew."""
_LEAST_SATURATION, _LEAST_VALUE = 0.3, 0.15
"""Paler or darker, a pixel's hue is noise: 8 bits then hold fewer than ten steps of it."""
_HUE_STEP = 2.0
"""Degrees of OpenCV's hue, which counts 0 to 179."""
_MAX_ROUNDS = 5
_FAR = 3.0


@dataclass(frozen=True, eq=False)
class FoundAxis:
    """points (2, 2), pixels: of the middle line of the longest elongated part, near its ends, the upper one first;
    length_px: of that part; next_px: of the next one that is elongated, 0 where there is none."""

    points: Array
    length_px: float
    next_px: float

    @property
    def words(self) -> str:
        """How far it stands out."""
        if not self.next_px:
            return f"the only elongated part, {self.length_px:.0f} px long"
        times = self.length_px / self.next_px
        return f"the longest elongated part, {self.length_px:.0f} px, {times:.2g} times as long as the next one"


def find_axis(image: NDArray[Any], *, hues_deg: tuple[float, float] | None = None) -> FoundAxis:
    """The middle line of the pointer, which is taken to be the longest elongated part.

    Args: image (h, w) or (h, w, 3) BGR, 8 bits; hues_deg: the pointer's hues, from the first up to the second, through
    0 where the second is smaller. Raises: InputError where nothing elongated is seen, or hues are asked of grey.
    """
    masks = _by_threshold(image) if hues_deg is None else [_by_hue(image, hues_deg)]
    found = [part for mask in masks for part in _elongated(mask)]
    if not found:
        what = "no hue of that range" if hues_deg is not None else "neither bright nor dark"
        raise InputError(
            f"no pointer was found: {what} of the picture has a part {ELONGATED:g} times as long as wide and "
            f"{SHORTEST_PX:g} px long; give two points of its axis, or its hue"
        )
    lengths = sorted((length for length, _ in found), reverse=True)
    _, points = max(found, key=lambda part: part[0])
    return FoundAxis(_middle_line(points), lengths[0], lengths[1] if len(lengths) > 1 else 0.0)


def _by_threshold(image: NDArray[Any]) -> list[Mask]:
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    _, bright = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    return [bright > 0, bright == 0]


def _by_hue(image: NDArray[Any], hues_deg: tuple[float, float]) -> Mask:
    if image.ndim != 3:
        raise InputError("the picture is grey and has no hues; give two points of the pointer's axis")
    hue, saturation, value = np.moveaxis(cv2.cvtColor(image, cv2.COLOR_BGR2HSV), -1, 0)
    degrees = _HUE_STEP * hue.astype(np.float64)
    first, last = (h % 360 for h in hues_deg)
    within = (degrees >= first) & (degrees <= last) if first <= last else (degrees >= first) | (degrees <= last)
    mask: Mask = within & (saturation >= 255 * _LEAST_SATURATION) & (value >= 255 * _LEAST_VALUE)
    return mask


def _elongated(mask: Mask) -> list[tuple[float, Array]]:
    """Length and pixels (n, 2) of every connected part that is elongated."""
    last = np.array(mask.shape[::-1]) - 1
    clean = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(clean)
    out = []
    for i in range(1, count):
        x, y, w, h, area = (int(n) for n in stats[i])
        if np.hypot(w, h) < SHORTEST_PX:
            continue
        rows, columns = np.nonzero(labels[y : y + h, x : x + w] == i)
        points = np.stack([columns + x, rows + y], axis=1).astype(np.float64)
        # A bar of length L has a variance of L^2 / 12 along it.
        spread = np.sqrt(12 * np.linalg.eigvalsh(np.cov(points.T) + np.eye(2) / 12)) if area > 2 else np.ones(2)
        on_edge = np.count_nonzero(np.any((points == 0) | (points == last), axis=1))
        if spread[1] >= SHORTEST_PX and spread[1] >= ELONGATED * spread[0] and on_edge <= ALONG_EDGE * spread[1]:
            out.append((float(spread[1]), points))
    return out


def _middle_line(points: Array) -> Array:
    """Ends of the line through the middles of the cross sections, one a pixel of its length."""
    centre = points.mean(axis=0)
    _, axes = np.linalg.eigh(np.cov(points.T))
    along, across = (points - centre) @ axes[:, 1], (points - centre) @ axes[:, 0]
    cell = np.floor(along).astype(np.int64)
    cells, at = np.unique(cell, return_inverse=True)
    low, high = np.full(len(cells), np.inf), np.full(len(cells), -np.inf)
    np.minimum.at(low, at, across)
    np.maximum.at(high, at, across)
    s, middle = cells + 0.5, (low + high) / 2
    inner = (s >= s.min() + _ENDS * np.ptp(s)) & (s <= s.max() - _ENDS * np.ptp(s))
    keep = inner.copy()
    slope = offset = 0.0
    for _ in range(_MAX_ROUNDS):
        slope, offset = np.polyfit(s[keep], middle[keep], 1)
        off = np.abs(middle - slope * s - offset)
        limit = _FAR * max(float(np.median(off[inner])) / 0.6745, 0.25)  # a quarter of a pixel is what cells leave
        again = inner & (off <= limit)
        if np.array_equal(again, keep) or again.sum() < 2:
            break
        keep = again
    ends = np.array([s[inner].min(), s[inner].max()])
    line = centre + ends[:, None] * axes[:, 1] + (slope * ends + offset)[:, None] * axes[:, 0]
    return line[np.argsort(line[:, 1], kind="stable")]
