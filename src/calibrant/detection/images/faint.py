"""Pictures of more than 8 bits whose target is fainter than 8 bits can show: thermal ones, where a gradient fills them.

What a scene radiates, or the light on it, is L(p) (1 + c(p)) with L smooth and c the target's contrast. Divided by its
own blur by a Gaussian G the picture is

    I / (G * I) = (1 + c) / (1 + G * c)  to first order in L's slope,

in which L is gone, and which is then stretched over 8 bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from calibrant.arrays import Array, Grey
from calibrant.detection.images.images import load_image
from calibrant.opencv import cv2

WIDTHS = (1 / 12, 1 / 40)
"""Standard deviation of the blur over the picture's longest side, the widest first: it must reach over the target's
parts, which fill a fortieth to a tenth of a picture, and not over the light's changes."""
OUTLYING_PERCENT = 2.0
"""Of the values at each end: hot parts, dead pixels and the rims of both do not decide the stretch."""
ROOM = 0.25
"""Beyond the others' range at each end, in parts of it: a target that is more contrasty than most is not clipped."""
SHADES = 256
"""What 8 bits tell apart: a picture of no more values has nothing else to show."""


def flattened(path: Path) -> Iterator[Grey]:
    """A picture of more than 8 bits (h, w) less its gradient, in 8 bits, by wider and narrower blurs.

    None for one of 8 bits: what it shows has been looked at already.
    Raises: InputError as `load_image`.
    """
    image = load_image(path)
    if image.dtype in (np.uint8, np.bool_):
        return
    grey = image[..., :3].mean(axis=2) if image.ndim == 3 else image
    grey = np.nan_to_num(grey.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
    if len(np.unique(grey)) <= SHADES:
        return
    for width in WIDTHS:
        yield _stretched(_divided(grey, width * max(grey.shape)))


def _divided(grey: Array, sigma_px: float) -> Array:
    around = np.asarray(cv2.GaussianBlur(grey, (0, 0), sigma_px, borderType=cv2.BORDER_REFLECT), np.float64)
    # Where a counter starts at zero there is no ratio; a part of the typical value keeps it finite.
    least = 1e-3 * float(np.median(np.abs(around))) + 1e-12
    return np.asarray(grey / np.maximum(around, least), np.float64)


def _stretched(ratio: Array) -> Grey:
    low, high = np.percentile(ratio, [OUTLYING_PERCENT, 100.0 - OUTLYING_PERCENT])
    room = ROOM * (high - low)
    scale = 255.0 / max(high - low + 2.0 * room, 1e-12)
    return np.asarray(np.clip(np.rint((ratio - low + room) * scale), 0, 255), np.uint8)
