"""Candidates for chessboard corners at one scale: saddle points of the brightness that look right from all sides.

Three steps, cheapest first:
1. Hessian: a corner is a saddle, so S = I_xy^2 - I_xx I_yy has a local maximum there. One pass over the image.
2. The saddle's centre to a fraction of a pixel, from the same derivatives: d = -H^-1 grad I.
3. Ring: on a small circle around it, brightness crosses its mean exactly four times, and opposite sides agree. The
   crossings are the directions of the two edges. Few of the maxima of a natural image pass this.

A corner that passes step 3 is `strong`; the others are kept as `weak`, and count only where a grid predicts one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.float32]

SMOOTHING_PX = 1.0
"""Blur before differentiating: the least that makes second differences of 8-bit noise usable; squares of 8 px pass."""
RING_RADIUS_PX = 4.0
"""Half of the smallest square (8 px), and outside the blur of an image that is sharp at this scale."""
RING_SAMPLES = 32
LARGEST_OFFSET_PX = 1.5
MARGIN_PX = math.ceil(RING_RADIUS_PX + LARGEST_OFFSET_PX) + 1
"""The ring of a corner next to the image's edge must lie inside."""
LEAST_CONTRAST = 3.0
"""Half the difference between dark and light, grey levels: three times the rounding of 8 bits after smoothing."""
LEAST_ANGLE = math.radians(15)
"""Between the edges of a corner: a board tilted by 75 degrees about a square's diagonal. Flatter ones are useless."""
MOST_CANDIDATES = 4000
"""Keeps the search for neighbours short on pictures of gravel; a board of 30x20 has 600 corners."""


@dataclass(frozen=True, eq=False)
class Corners:
    """Candidates at one scale.

    smooth: the image they were found in; xy (n, 2) pixels; axes (n, 2) radians: directions a and b of the two edges,
    such that the sector reached by turning from a to b (x towards y, less than half a turn) is dark; contrast (n,) grey
    levels; weak (m, 2) pixels: saddles that failed the ring.
    """

    smooth: Image
    xy: Array
    axes: Array
    contrast: Array
    weak: Array

    def __len__(self) -> int:
        return len(self.xy)


def find_corners(level: NDArray[np.uint8], *, most: int = MOST_CANDIDATES) -> Corners:
    """Candidates in a grey image (h, w); only the `most` pronounced saddles are looked at from all sides."""
    smooth = _smooth(level)
    # A corner of half-contrast c blurred by s has I_xy = (2 / pi) c / s^2 at its centre; here s is the smoothing with
    # as much blur again in the picture (variances add).
    blur_variance = 2 * SMOOTHING_PX**2 + 0.5
    least = (2 / math.pi * LEAST_CONTRAST / blur_variance) ** 2
    maxima, response = _saddles(smooth, least)
    if len(maxima) > most:
        pronounced = response >= np.partition(response, len(response) - most)[len(response) - most]
        examined, rest = maxima[pronounced], maxima[~pronounced]
    else:
        examined, rest = maxima, maxima[:0]
    passed, axes, contrast = _ring_tests(smooth, examined)
    weak = np.concatenate([examined[~passed], rest])
    return Corners(smooth, examined[passed], axes[passed], contrast[passed], weak)


def _smooth(level: NDArray[np.uint8]) -> Image:
    # Sixteenths of a grey level in 16 bits: as good as float here, and several times faster to filter.
    sixteenths = cv2.GaussianBlur(np.left_shift(level, 4, dtype=np.int16), (5, 5), SMOOTHING_PX)
    return sixteenths.astype(np.float32) * np.float32(1 / 16)


def _saddles(image: Image, least: float) -> tuple[Array, Array]:
    """Saddle points (n, 2) as x, y, and S (n,), where it is above `least` and largest within two pixels."""
    response = np.zeros_like(image)
    _respond(image, response)
    largest = cv2.dilate(response, np.ones((5, 5), np.uint8))
    at = np.flatnonzero((response == largest) & (response > least))
    y, x = np.divmod(at, image.shape[1])
    inside = (x >= MARGIN_PX) & (x < image.shape[1] - MARGIN_PX) & (y >= MARGIN_PX) & (y < image.shape[0] - MARGIN_PX)
    return _centres(image, response, x[inside], y[inside])


@njit("void(float32[:, ::1], float32[:, ::1])", cache=True, nogil=True, fastmath=True)
def _respond(image, response):  # type: ignore[no-untyped-def]
    """Fills response with S, leaving its border."""
    h, w = image.shape
    for y in range(1, h - 1):
        for x in range(1, w - 1):
            twice = np.float32(2) * image[y, x]
            xx = image[y, x + 1] - twice + image[y, x - 1]
            yy = image[y + 1, x] - twice + image[y - 1, x]
            xy = image[y + 1, x + 1] - image[y + 1, x - 1] - image[y - 1, x + 1] + image[y - 1, x - 1]
            response[y, x] = np.float32(1 / 16) * xy * xy - xx * yy


@njit("boolean(float32[:, ::1], int64, int64)", cache=True, nogil=True)
def _has_equal_before(response, x, y):  # type: ignore[no-untyped-def]
    """Whether the same response stands at an earlier pixel, row by row, within two pixels."""
    for v in range(y - 2, y + 1):
        for u in range(x - 2, x + 3):
            if v == y and u >= x:
                break
            if response[v, u] == response[y, x]:
                return True
    return False


@njit(
    "Tuple((float64[:, ::1], float64[::1]))(float32[:, ::1], float32[:, ::1], int64[::1], int64[::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def _centres(image, response, xs, ys):  # type: ignore[no-untyped-def]
    """Where the gradient vanishes near each pixel: (n, 2), and S; without those where it vanishes elsewhere."""
    found, strength = np.empty((len(xs), 2)), np.empty(len(xs))
    n = 0
    for k in range(len(xs)):
        x, y = xs[k], ys[k]
        # A drawn corner lies between pixels that are equal to the last bit: four maxima, of which the first counts.
        if _has_equal_before(response, x, y):
            continue
        gx = 0.5 * (image[y, x + 1] - image[y, x - 1])
        gy = 0.5 * (image[y + 1, x] - image[y - 1, x])
        xx = image[y, x + 1] - 2.0 * image[y, x] + image[y, x - 1]
        yy = image[y + 1, x] - 2.0 * image[y, x] + image[y - 1, x]
        xy = 0.25 * (image[y + 1, x + 1] - image[y + 1, x - 1] - image[y - 1, x + 1] + image[y - 1, x - 1])
        s = xy * xy - xx * yy
        dx = (yy * gx - xy * gy) / s
        dy = (xx * gy - xy * gx) / s
        # A centre further off than this belongs to another saddle, or to none (S is also large near thin lines).
        if abs(dx) <= LARGEST_OFFSET_PX and abs(dy) <= LARGEST_OFFSET_PX:
            found[n, 0] = x + dx
            found[n, 1] = y + dy
            strength[n] = s
            n += 1
    return found[:n].copy(), strength[:n].copy()


_ANGLES = 2 * np.pi * np.arange(RING_SAMPLES) / RING_SAMPLES
_RING = RING_RADIUS_PX * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)


@njit("float64(float32[:, ::1], float64, float64, float64[::1])", cache=True, nogil=True, inline="always")
def _ring(image, cx, cy, values):  # type: ignore[no-untyped-def]
    """Fills values (RING_SAMPLES,) on the circle around a centre, bilinear; their mean."""
    total = 0.0
    for k in range(RING_SAMPLES):
        x = cx + _RING[k, 0]
        y = cy + _RING[k, 1]
        i, j = int(x), int(y)
        u, v = x - i, y - j
        top = image[j, i] * (1.0 - u) + image[j, i + 1] * u
        low = image[j + 1, i] * (1.0 - u) + image[j + 1, i + 1] * u
        values[k] = top * (1.0 - v) + low * v
        total += values[k]
    return total / RING_SAMPLES


@njit(
    "Tuple((boolean[::1], float64[:, ::1], float64[::1]))(float32[:, ::1], float64[:, ::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def _ring_tests(image, xy):  # type: ignore[no-untyped-def]
    """Which centres (n, 2) look like corners, their axes (n, 2) and contrast (n,)."""
    n = len(xy)
    passed = np.zeros(n, np.bool_)
    axes = np.zeros((n, 2))
    contrast = np.zeros(n)
    half = RING_SAMPLES // 2
    step = 2.0 * math.pi / RING_SAMPLES
    crossing = np.empty(4)
    values = np.empty(RING_SAMPLES)
    for i in range(n):
        values -= _ring(image, xy[i, 0], xy[i, 1], values)
        odd, size = 0.0, 0.0
        for k in range(half):
            odd += abs(values[k] - values[k + half])
            size += abs(values[k]) + abs(values[k + half])
        contrast[i] = size / RING_SAMPLES
        # Half of the signal may be antisymmetric (a shadow's edge, a slope of light); more is not a corner.
        if contrast[i] < LEAST_CONTRAST or odd > 0.5 * size:
            continue
        count = 0
        falling_first = False
        for k in range(RING_SAMPLES):
            v0, v1 = values[k], values[(k + 1) % RING_SAMPLES]
            if (v0 >= 0.0) != (v1 >= 0.0):
                if count == 4:
                    count = 5
                    break
                if count == 0:
                    falling_first = v0 >= 0.0
                crossing[count] = step * (k + v0 / (v0 - v1))
                count += 1
        if count != 4:
            continue
        skew0 = crossing[2] - crossing[0] - math.pi
        skew1 = crossing[3] - crossing[1] - math.pi
        # Edges are straight through a corner; 40 degrees allow for noise at a radius of a few pixels.
        if abs(skew0) > 0.7 or abs(skew1) > 0.7:
            continue
        first = crossing[0] + 0.5 * skew0
        second = crossing[1] + 0.5 * skew1
        if second - first < LEAST_ANGLE or second - first > math.pi - LEAST_ANGLE:
            continue
        passed[i] = True
        axes[i, 0] = first if falling_first else second
        axes[i, 1] = second if falling_first else first + math.pi
    return passed, axes, contrast
