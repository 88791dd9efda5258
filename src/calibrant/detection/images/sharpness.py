"""How sharp a picture is, to choose among neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.opencv import cv2

SIDE_PX = 320
"""Sharpness is compared in pictures of about this many pixels: focus and motion blur show, noise averages out."""


def sharpness(image: NDArray) -> float:
    """Variance of the Laplacian of the grey values of an image (h, w) or (h, w, 3) BGR."""
    factor = max(1, round(max(image.shape[:2]) / SIDE_PX))
    small = cv2.resize(image, (image.shape[1] // factor, image.shape[0] // factor), interpolation=cv2.INTER_AREA)
    grey = small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
    return float(cv2.Laplacian(grey, cv2.CV_32F).var())


def sharpest_together(sharp: NDArray, every: int) -> list[int]:
    """Of every `every` moments in turn the one whose least sharp picture is the sharpest, each beside its own camera.

    Args: sharp (cameras, moments).
    """
    worst = (sharp / np.maximum(np.median(sharp, axis=1, keepdims=True), np.finfo(float).tiny)).min(axis=0)
    return [first + int(np.argmax(worst[first : first + every])) for first in range(0, sharp.shape[1], every)]
