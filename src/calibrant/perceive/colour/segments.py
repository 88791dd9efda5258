"""Connected parts of a mask: cleaned by opening and closing, each with its area and its centre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.errors import RefusedError
from calibrant.opencv import cv2
from calibrant.perceive.colour.ranges import ColourRange

LEAST_AREA_PX = 30
"""Less is a speck: an object of 6 x 5 pixels has edges of hardly any length."""
ALIKE = 3.0
"""A second part is as good as the largest where that is less than this many times larger: a cube seen from the same
place at 1.7 times the distance, and no further."""


@dataclass(frozen=True, eq=False)
class Segment:
    """One connected part. mask (h, w) of the whole picture; centre (2,), pixels: the mean of its pixels; area_px;
    box: first column, first row, width, height; on_edge: whether the picture's edge cuts it."""

    mask: Mask
    centre: Array
    area_px: int
    box: tuple[int, int, int, int]
    on_edge: bool

    @property
    def words(self) -> str:
        """ "1250 px at (320, 241)"."""
        return f"{self.area_px} px at ({self.centre[0]:.0f}, {self.centre[1]:.0f})"


def cleaned(mask: Mask, *, open_px: int = 3, close_px: int = 5) -> Mask:
    """A mask without specks narrower than `open_px` (opening), then without gaps narrower than `close_px` (closing).

    Discs of that diameter; 0 or 1 leaves the step out.
    """
    out: NDArray[Any] = mask.astype(np.uint8)
    for size, step in ((open_px, cv2.MORPH_OPEN), (close_px, cv2.MORPH_CLOSE)):
        if size > 1:
            out = cv2.morphologyEx(out, step, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))
    return np.asarray(out > 0)


def segments(mask: Mask, *, least_area_px: int = LEAST_AREA_PX) -> list[Segment]:
    """All connected parts of at least that area, largest first.

    >>> mask = np.zeros((40, 60), bool)
    >>> mask[10:20, 20:31] = True
    >>> [(s.area_px, s.centre.tolist()) for s in segments(mask)]
    [(110, [25.0, 14.5])]
    """
    count, labels, stats, centres = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    height, width = mask.shape
    out = []
    for i in range(1, count):
        x, y, w, h, area = (int(n) for n in stats[i])
        if area >= least_area_px:
            cut = x == 0 or y == 0 or x + w == width or y + h == height
            out.append(Segment(labels == i, np.asarray(centres[i], dtype=np.float64), area, (x, y, w, h), cut))
    return sorted(out, key=lambda s: -s.area_px)


def find_segments(
    image: NDArray[Any],
    colour: ColourRange,
    *,
    open_px: int = 3,
    close_px: int = 5,
    least_area_px: int = LEAST_AREA_PX,
) -> list[Segment]:
    """The parts of a picture (h, w, 3), BGR, that have a colour, largest first; none where there are none."""
    mask = cleaned(colour.mask(image), open_px=open_px, close_px=close_px)
    return segments(mask, least_area_px=least_area_px)


def the_one(found: Sequence[Segment], *, near: tuple[float, float] | None = None, what: str = "the object") -> Segment:
    """The one segment that is meant: the one nearest to a pixel, else the largest where no other is like it.

    Raises: RefusedError where there is none, or another as good.
    """
    if not found:
        raise RefusedError(
            f"{what} was not found: no part of the picture of {LEAST_AREA_PX} px or more has its colour. Is it in "
            "view? Pick its colour again from a pixel on it"
        )
    if near is not None:
        return min(found, key=lambda s: float(np.linalg.norm(s.centre - near)))
    others = [s for s in found[1:] if found[0].area_px < ALIKE * s.area_px]
    if others:
        listed = ", ".join(s.words for s in (found[0], *others))
        raise RefusedError(
            f"{1 + len(others)} parts of the picture could be {what}: {listed}; give a pixel near the one that is "
            "meant, or a narrower range of colours"
        )
    return found[0]
