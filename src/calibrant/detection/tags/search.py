"""Markers of a picture: quadrilaterals found in a smaller copy, their codes read at full size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibrant.arrays import Array, Grey
from calibrant.detection.opencv import Markers, shrink
from calibrant.detection.tags.codes import read_codes
from calibrant.detection.tags.families import read_family
from calibrant.detection.tags.quads import MIDDLE, find_quads
from calibrant.opencv import cv2
from calibrant.targets.apriltag3 import FAMILIES

Ink = Literal["dark", "light"]

CLEAR, FAINT = 20, 10
"""Grey levels between light and dark around an edge. Most boards differ by many more, and noise by less."""
SMOOTH_PX = 3
"""A copy at full size is smoothed over this many pixels: noise there would make outlines of its own."""


THIN = 0.3
"""Part of the way from ink to paper, below the middle: strips of paper a pixel or two wide, grey in a blurred picture,
still part a marker from the squares around it."""


@dataclass(frozen=True)
class Effort:
    """How markers are looked for: in a picture smaller by `factor`, with edges of at least `contrast` grey levels.

    ink: what a region is made of. A light region in a dark one is found as its hole either way, but not where the dark
    around it is thinner than a pixel or two. part: as `find_quads` takes it.
    """

    factor: int
    contrast: int = CLEAR
    ink: Ink = "dark"
    part: float = MIDDLE


def efforts(shape: tuple[int, ...], coarse_side_px: int, ink: Ink = "dark", *, part: float = MIDDLE) -> list[Effort]:
    """From the cheapest to the most thorough: smaller copies first, then faint edges."""
    factor = max(1, round(max(shape) / coarse_side_px))
    factors = [factor]
    while factors[-1] > 1:
        factors.append(factors[-1] // 2)
    # Where edges are faint noise is as strong as they are, except in a smaller copy.
    clear = [Effort(f, CLEAR, ink, part) for f in factors]
    return [*clear, Effort(factor, FAINT, ink, part)]


def find_quads_at(grey: Grey, effort: Effort) -> np.ndarray:
    """Quadrilaterals (n, 4, 2), px of the full picture."""
    level = level_of(grey, effort)
    # Pixel (0, 0) is the centre of the top left pixel at either size.
    return effort.factor * (find_quads(level, contrast=effort.contrast, part=effort.part) + 0.5) - 0.5


def level_of(grey: Grey, effort: Effort) -> Grey:
    """The picture that is searched: smaller or smoothed, ink dark."""
    level = shrink(grey, effort.factor)
    if effort.factor == 1:
        level = np.asarray(cv2.blur(level, (SMOOTH_PX, SMOOTH_PX)), np.uint8)
    if effort.ink == "light":
        level = np.asarray(cv2.bitwise_not(level), np.uint8)
    return level


def find_markers(grey: Grey, name: str, effort: Effort, *, border: int = 1) -> Markers:
    """Markers of a dictionary, upright or as a negative. Args: border: width of the black border, cells.

    Their corners are good to half a pixel of the smaller picture.
    """
    return read_quads(grey, find_quads_at(grey, effort), name, border=border)


def read_quads(grey: Grey, quads: Array, name: str, *, border: int = 1) -> Markers:
    """The markers of a dictionary, or of one of AprilTag 3's families, among quadrilaterals (n, 4, 2) px."""
    return read_family(grey, quads, name) if name in FAMILIES else read_codes(grey, quads, name, border=border)
