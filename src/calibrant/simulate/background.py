"""What lies behind a target: edges of all kinds that are no board, so that detectors have to find the board."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.opencv import cv2


def clutter(image_size: tuple[int, int], *, shapes: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """A background of soft stains, quadrilaterals, ellipses and lines.

    Args: image_size (width, height), px; shapes: how many of the sharp ones. Returns (height, width), grey 0..1.
    """
    width, height = image_size
    stains = rng.uniform(0.25, 0.65, size=(6, 8)).astype(np.float32)
    image = cv2.resize(stains, (width, height), interpolation=cv2.INTER_CUBIC)
    scale = max(width, height)
    for kind in rng.integers(3, size=shapes):
        centre = rng.uniform((0, 0), (width, height))
        half = scale * rng.uniform(0.01, 0.12, size=2)
        turn = rng.uniform(0, np.pi)
        grey = float(rng.uniform(0.05, 0.95))
        axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        if kind == 0:
            signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
            corners = centre + (signs * half * rng.uniform(0.7, 1.3, size=(4, 2))) @ axes
            cv2.fillConvexPoly(image, np.rint(corners).astype(np.int32), grey, lineType=cv2.LINE_8)
        elif kind == 1:
            middle = (int(centre[0]), int(centre[1]))
            cv2.ellipse(image, middle, (int(half[0]), int(half[1])), float(np.rad2deg(turn)), 0, 360, grey, -1)
        else:
            a, b = centre - 3 * half[0] * axes[0], centre + 3 * half[0] * axes[0]
            thickness = int(rng.integers(1, 8))
            cv2.line(image, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), grey, thickness)
    return np.clip(image, 0, 1)
