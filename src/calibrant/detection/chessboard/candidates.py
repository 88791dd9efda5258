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

import numpy as np
from numba import njit
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.compiled import compiled, compiled_part

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
    if min(level.shape) <= 2 * MARGIN_PX:
        none = np.empty((0, 2))
        return Corners(level.astype(np.float32), none, none, np.empty(0), none)
    smooth = _smooth(np.ascontiguousarray(level))
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
    n = len(examined)
    passed, axes, contrast = np.zeros(n, np.bool_), np.zeros((n, 2)), np.zeros(n)
    _ring_tests(smooth, examined, passed, axes, contrast)
    weak = np.concatenate([examined[~passed], rest])
    return Corners(smooth, examined[passed], axes[passed], contrast[passed], weak)


_KERNEL = np.exp(-0.5 * (np.arange(-2, 3) / SMOOTHING_PX) ** 2)
_K0, _K1, _K2 = (np.float32(_KERNEL[2 + k] / _KERNEL.sum()) for k in range(3))


@compiled("float32[:, ::1](uint8[:, ::1])", fastmath={"contract"})
def _smooth(level):  # type: ignore[no-untyped-def]
    """The image blurred by SMOOTHING_PX, mirrored beyond its border."""
    h, w = level.shape
    smooth = np.empty((h, w), np.float32)
    row = np.empty(w + 4, np.float32)
    for y in range(h):
        below, lowest = h - 1 - abs(h - 2 - y), h - 1 - abs(h - 3 - y)
        a, b, c, d, e = level[abs(y - 2)], level[abs(y - 1)], level[y], level[below], level[lowest]
        for x in range(w):
            near, far = np.int32(b[x]) + np.int32(d[x]), np.int32(a[x]) + np.int32(e[x])
            row[x + 2] = _K0 * np.float32(c[x]) + _K1 * np.float32(near) + _K2 * np.float32(far)
        row[0], row[1], row[w + 2], row[w + 3] = row[4], row[3], row[w], row[w - 1]
        out = smooth[y]
        for x in range(w):
            out[x] = _K0 * row[x + 2] + _K1 * (row[x + 1] + row[x + 3]) + _K2 * (row[x] + row[x + 4])
    return smooth


def _saddles(image: Image, least: float) -> tuple[Array, Array]:
    """Saddle points (n, 2) as x, y, and S (n,), where it is above `least` and largest within two pixels."""
    return _centres(image, *_maxima(image, np.float32(least)))


@compiled_part("void(float32[:, ::1], int64, float32[::1])", fastmath={"contract"}, forceinline=True)
def _respond(image, y, response):  # type: ignore[no-untyped-def]
    """Fills S of row y of the image but for its ends."""
    above, here, below = image[y - 1], image[y], image[y + 1]
    for x in range(1, image.shape[1] - 1):
        twice = np.float32(2) * here[x]
        xx = here[x + 1] - twice + here[x - 1]
        yy = below[x] - twice + above[x]
        xy = below[x + 1] - below[x - 1] - above[x + 1] + above[x - 1]
        response[x] = np.float32(1 / 16) * xy * xy - xx * yy


@compiled_part("boolean(float32[::1], float32[::1], float32[::1], int64)")
def _has_equal_before(highest, above, here, x):  # type: ignore[no-untyped-def]
    """Whether the same response stands at an earlier pixel, row by row, within two pixels."""
    for u in range(x - 2, x + 3):
        if highest[u] == here[x] or above[u] == here[x] or (u < x and here[u] == here[x]):
            return True
    return False


@compiled("UniTuple(int64[::1], 2)(float32[:, ::1], float32)", fastmath={"nnan", "nsz"})
def _maxima(image, least):  # type: ignore[no-untyped-def]
    """x and y of the pixels where S is above `least` and largest within two pixels, off the margin."""
    h, w = image.shape
    xs, ys = np.empty(h * w // 9 + 1, np.int64), np.empty(h * w // 9 + 1, np.int64)
    # Five rows of S at a time: a picture of it would cost more to fill than to compute.
    rows, down, largest = np.empty((5, w), np.float32), np.empty(w, np.float32), np.empty(w, np.float32)
    n = 0
    for k in range(5):
        rows[k, 0], rows[k, w - 1] = 0.0, 0.0
    for y in range(MARGIN_PX - 2, MARGIN_PX + 2):
        _respond(image, y, rows[y % 5])
    for y in range(MARGIN_PX, h - MARGIN_PX):
        _respond(image, y + 2, rows[(y + 2) % 5])
        a, b, c, d, e = rows[(y - 2) % 5], rows[(y - 1) % 5], rows[y % 5], rows[(y + 1) % 5], rows[(y + 2) % 5]
        # Five pixels down, then five across: loops without branches, that take several pixels at once.
        for x in range(w):
            p = a[x] if a[x] > b[x] else b[x]
            q = d[x] if d[x] > e[x] else e[x]
            p = p if p > q else q
            down[x] = p if p > c[x] else c[x]
        for x in range(w - 4):
            p = down[x] if down[x] > down[x + 1] else down[x + 1]
            q = down[x + 3] if down[x + 3] > down[x + 4] else down[x + 4]
            p = p if p > q else q
            p = p if p > down[x + 2] else down[x + 2]
            largest[x + 2] = p if p > least else least
        for x in range(MARGIN_PX, w - MARGIN_PX):
            # The first is rarely true, which is quick. A drawn corner lies between pixels that are equal to the last
            # bit: of such maxima the first counts.
            if c[x] >= largest[x] and c[x] > least and not _has_equal_before(a, b, c, x):
                xs[n], ys[n] = x, y
                n += 1
    return xs[:n], ys[:n]


@compiled("Tuple((float64[:, ::1], float64[::1]))(float32[:, ::1], int64[::1], int64[::1])")
def _centres(image, xs, ys):  # type: ignore[no-untyped-def]
    """Where the gradient vanishes near each pixel: (n, 2), and S; without those where it vanishes elsewhere."""
    found, strength = np.empty((len(xs), 2)), np.empty(len(xs))
    n = 0
    for k in range(len(xs)):
        x, y = xs[k], ys[k]
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
    return found[:n], strength[:n]


_ANGLES = 2 * np.pi * np.arange(RING_SAMPLES) / RING_SAMPLES
_RING = RING_RADIUS_PX * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)


@njit(inline="always")
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


@compiled("void(float32[:, ::1], float64[:, ::1], boolean[::1], float64[:, ::1], float64[::1])")
def _ring_tests(image, xy, passed, axes, contrast):  # type: ignore[no-untyped-def]
    """Sets which centres (n, 2) look like corners (n,), their axes (n, 2) and contrast (n,); all 0 before."""
    half = RING_SAMPLES // 2
    step = 2.0 * math.pi / RING_SAMPLES
    crossing = np.empty(4)
    values = np.empty(RING_SAMPLES)
    for i in range(len(xy)):
        mean, odd, size = _ring(image, xy[i, 0], xy[i, 1], values), 0.0, 0.0
        for k in range(RING_SAMPLES):
            values[k] -= mean
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
