"""A picture as the person beside the robot sees it: the points found, and whether it is a sample or why not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.tasks.live.sampling import Look

_GREEN, _YELLOW = (80, 200, 60), (40, 190, 250)


def shown(grey: NDArray[np.uint8], look: Look, words: str) -> NDArray[np.uint8]:
    """(h, w, 3) in BGR of a picture (h, w): green points and frame for a sample, yellow ones otherwise."""
    from calibrant.opencv import cv2

    out = np.repeat(grey[..., None], 3, axis=2)
    colour = _GREEN if look.reason is None else _YELLOW
    for u, v in look.uv:
        cv2.circle(out, (round(float(u)), round(float(v))), 4, colour, 1, cv2.LINE_AA)
    height, width = grey.shape
    size = max(0.4, width / 1200)
    text = f"{words}: {look.reason or 'taken'}"
    cv2.putText(out, text, (8, round(26 * size) + 4), cv2.FONT_HERSHEY_SIMPLEX, size, colour, 2, cv2.LINE_AA)
    if look.reason is None:
        cv2.rectangle(out, (0, 0), (width - 1, height - 1), colour, 6)
    return out
