"""Points of a picture that are found again in another one: scale-invariant features (Lowe 2004), one to one.

Light changes between two days. Greys are taken relative to their surroundings (less the mean, over the spread of a
window a sixteenth of the picture wide), so that shadows and exposure leave the features where they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.opencv import cv2

WIDEST = 960
"""Pixels of the picture's longer side that features are sought in: a place is then known to a tenth of a pixel, and a
picture takes a fifth of a second."""
MOST = 2500
"""Features of a picture; a plain scene has some hundred."""
RATIO = 0.8
"""The best match is nearer than the second by this factor (Lowe 2004, section 7.1): nine of ten wrong ones fall out."""
FLATTEST = 3.0
"""Grey levels of spread in a window that count as texture: what noise and compression make is less."""


@dataclass(frozen=True, eq=False)
class Features:
    """places (n, 2) of features in pixels of the full picture, with what they look like (n, 128)."""

    image_size: tuple[int, int]
    places: Array
    looks: NDArray[np.float32]


def features(grey: NDArray[np.uint8], image_size: tuple[int, int], *, longest: int = WIDEST) -> Features:
    """The features of a picture (h, w). Args: image_size, (width, height) of the full picture that places refer to,
    where the one at hand is a smaller copy; longest, the side in pixels that is worked on: the same for pictures that
    are compared, as the finder puts features off by a quarter of a pixel of its own."""
    small = reduced(grey, longest)
    size = (small.shape[1], small.shape[0])
    finder = cv2.SIFT.create(nfeatures=MOST, contrastThreshold=0.02)
    points, looks = finder.detectAndCompute(_evened(small), None)
    if looks is None or not len(points):
        return Features(image_size, np.zeros((0, 2)), np.zeros((0, 128), dtype=np.float32))
    at = np.array([p.pt for p in points], dtype=np.float64)
    # Pixel centres are whole: the middle of the small picture is the middle of the full one.
    ratio = np.array(image_size) / np.array(size)
    return Features(image_size, (at + 0.5) * ratio - 0.5, np.asarray(looks, dtype=np.float32))


def reduced(grey: NDArray[np.uint8], longest: int) -> NDArray[np.uint8]:
    """A picture (h, w) whose longer side is `longest` pixels at most."""
    scale = min(1.0, longest / max(grey.shape))
    size = (max(1, round(grey.shape[1] * scale)), max(1, round(grey.shape[0] * scale)))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA) if scale < 1 else np.ascontiguousarray(grey))


def _evened(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Greys relative to their surroundings, 8 bit."""
    image = grey.astype(np.float32)
    sigma = max(grey.shape) / 32
    mean = cv2.GaussianBlur(image, (0, 0), sigma)
    spread = np.sqrt(np.maximum(cv2.GaussianBlur(image * image, (0, 0), sigma) - mean * mean, 0.0))
    even = 128 + 45 * (image - mean) / np.maximum(spread, FLATTEST)
    return np.clip(np.rint(even), 0, 255).astype(np.uint8)


def matched(then: Features, now: Features) -> tuple[Array, Array]:
    """Places (m, 2) of then and of now of the features that are each other's best match.

    Raises: InputError for pictures of different shape: they are of other cameras, or cropped.
    """
    (w0, h0), (w1, h1) = then.image_size, now.image_size
    if abs(w0 * h1 - w1 * h0) > 0.01 * w0 * h1:
        raise InputError(
            f"the reference is {w0}x{h0} px and the photo {w1}x{h1} px: another camera, or one of them was cropped; "
            "take the photo as the reference was taken"
        )
    if len(then.places) < 2 or len(now.places) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    forth, second = _nearest(then.looks, now.looks)
    back, _ = _nearest(now.looks, then.looks)
    rows = np.arange(len(forth))
    good = (back[forth] == rows) & second
    place = now.places * (np.array(then.image_size) / np.array(now.image_size))
    pairs = np.concatenate([then.places[good], place[forth[good]]], axis=1)
    # One corner gives several features, of several directions: it counts once.
    _, first = np.unique(np.round(pairs, 1), axis=0, return_index=True)
    pairs = pairs[np.sort(first)]
    return pairs[:, :2], pairs[:, 2:]


def _nearest(a: NDArray[np.float32], b: NDArray[np.float32]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """The nearest of b to each of a, and whether it is clearly nearer than the second."""
    squares = np.sum(a * a, axis=1)[:, None] + np.sum(b * b, axis=1) - 2 * (a @ b.T)
    two = np.argpartition(squares, 1, axis=1)[:, :2]
    values = np.take_along_axis(squares, two, axis=1)
    order = np.argsort(values, axis=1)
    best = np.take_along_axis(two, order[:, :1], axis=1)[:, 0]
    sorted_values = np.take_along_axis(values, order, axis=1)
    return best, sorted_values[:, 0] < RATIO**2 * sorted_values[:, 1]
