"""Quadrilaterals in a grey picture: outlines of dark regions, and of holes in them, that have four straight sides.

1. A pixel is dark when it lies below the middle of the darkest and the brightest pixel around it, and these differ.
   The middle is where a blurred edge is, whatever its blur: the outline does not move with a threshold.
2. Outlines are walked along the cracks between pixels, the dark region on the right-hand side; regions that touch at a
   corner stay apart. Every outline is walked once, so the cost is the picture's pixels and its edges.
3. Four corners by the farthest points (as U. Ramer, 1972, and D. Douglas, T. Peucker, 1973); an outline that strays
   from their chords is no quadrilateral. Sides are fitted to the cracks' middles, corners are where sides meet.

A dark square on light ground comes as the outline of a region, a light one on dark ground as that of a hole.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.compiled import compiled, compiled_part
from calibrant.opencv import cv2

WINDOW_PX = 9
"""Side of the window whose extremes are compared: wider than the blur of an edge, and not much more than a marker's
border, so that light and shade within a marker's own size are told from ink."""
MIDDLE = 0.5
CONTRAST = 14
"""Grey levels between the extremes: twice what OpenCV's threshold asks below the mean, which lies halfway."""
LEAST_SIDE_PX = 6.0
"""Shortest side: a pixel a cell of the smallest markers (4 bits and a border)."""
LARGEST_BEND = 0.08
"""How far an outline may stray from its sides, over their mean length: a lens that bends a side by that much is wider
than any whose markers can be read square."""
BEND_PX = 1.2
"""And on top: cracks run up to 0.7 px beside a slanting line."""
STRAIGHT_PART = 0.12
"""Of each end of a side that is left out of its line: blur rounds the corners."""
LARGEST_RATIO = 6.0
"""Longest side over the shortest: a square tilted by 80 degrees."""
LARGEST_DETOUR = 1.25
"""Number of an outline's cracks over the way around its upright box: 1 for anything convex, noise on slanting edges
adds some. The cheapest test, that texture fails."""
LEAST_BOX_FILL = 0.15
"""Area over that of the upright box: what the flattest quadrilateral allowed has when it lies on the diagonal."""
LEAST_FILL = 0.3
"""Area over the squared mean side: 1 for a square, sin(angle) for a rhombus; flatter ones cannot be read."""


def find_quads(level: Grey, *, window_px: int = WINDOW_PX, contrast: int = CONTRAST, part: float = MIDDLE) -> Array:
    """Corners (n, 4, 2) px of the quadrilaterals in a grey picture (h, w), clockwise as seen (y down).

    Args: part: where between the darkest and the brightest of its surroundings a pixel ceases to be dark. Below the
    middle, dark regions that touch at a corner come apart in a blurred picture too, and all outlines shrink a little.
    """
    return _quads(_around_crossings(dark_regions(level, window_px=window_px, contrast=contrast, part=part)))


def dark_regions(
    level: Grey, *, window_px: int = WINDOW_PX, contrast: int = CONTRAST, part: float = MIDDLE
) -> NDArray[np.uint8]:
    """1 where a grey picture (h, w) is dark among its surroundings, (h + 2, w + 2): with a border of one pixel."""
    kernel = np.ones((window_px, window_px), np.uint8)
    low, high = cv2.erode(level, kernel), cv2.dilate(level, kernel)
    dark = np.zeros((level.shape[0] + 2, level.shape[1] + 2), np.uint8)
    _threshold(np.ascontiguousarray(level), low, high, contrast, np.float32(part), dark)
    return dark


@compiled("void(uint8[:, ::1], uint8[:, ::1], uint8[:, ::1], int64, float32, uint8[:, ::1])")
def _threshold(level, low, high, contrast, part, dark):  # type: ignore[no-untyped-def]
    """Sets dark[y + 1, x + 1] to 1 where a pixel is below that part of the way between its surroundings' extremes."""
    h, w = level.shape
    for y in range(h):
        for x in range(w):
            a = np.int32(low[y, x])
            range_ = np.int32(high[y, x]) - a
            dark[y + 1, x + 1] = (np.int32(level[y, x]) - a < part * range_) & (range_ >= contrast)


# The four pixels around a crossing of cracks, and that the crack going up from it was walked.
UPPER_LEFT, UPPER_RIGHT, LOWER_RIGHT, LOWER_LEFT, WALKED = 1, 2, 4, 8, 16


@compiled("uint8[:, ::1](uint8[:, ::1])")
def _around_crossings(dark):  # type: ignore[no-untyped-def]
    """Which of the four pixels around each crossing are dark, (h + 1, w + 1), of a mask with a border of one pixel."""
    crossing = np.empty((dark.shape[0] - 1, dark.shape[1] - 1), np.uint8)
    for y in range(crossing.shape[0]):
        for x in range(crossing.shape[1]):
            upper = dark[y, x] * UPPER_LEFT | dark[y, x + 1] * UPPER_RIGHT
            crossing[y, x] = upper | dark[y + 1, x + 1] * LOWER_RIGHT | dark[y + 1, x] * LOWER_LEFT
    return crossing


@compiled_part("int64(uint8[::1], int64, int64, int32[::1])")
def _walk(crossing, stride, start, at):  # type: ignore[no-untyped-def]
    """Walks the outline that goes up from a crossing; the crossings go to `at` as far as there is room; how many.

    The dark region is on the right-hand side. Where it ends ahead, the outline turns right; where more of it lies ahead
    on the left, it turns left.
    """
    p, direction, length = start, 0, 0
    while True:
        if length < len(at):
            at[length] = p
        length += 1
        if direction == 0:
            crossing[p] |= WALKED
            p -= stride
            here = crossing[p]
            if here & UPPER_RIGHT == 0:
                direction = 1
            elif here & UPPER_LEFT:
                direction = 3
        elif direction == 1:
            p += 1
            here = crossing[p]
            if here & LOWER_RIGHT == 0:
                direction = 2
            elif here & UPPER_RIGHT:
                direction = 0
        elif direction == 2:
            p += stride
            here = crossing[p]
            if here & LOWER_LEFT == 0:
                direction = 3
            elif here & LOWER_RIGHT:
                direction = 1
        else:
            p -= 1
            here = crossing[p]
            if here & UPPER_LEFT == 0:
                direction = 0
            elif here & LOWER_LEFT:
                direction = 2
        if p == start and direction == 0:
            return length


@compiled_part("int64(int32[::1], int64, int64, float64[::1], float64[::1])")
def _middles(at, length, stride, xs, ys):  # type: ignore[no-untyped-def]
    """Fills xs, ys with the middles of an outline's cracks, px; the area inside, negative for a hole.

    Returns 0 for an outline that winds more than a quadrilateral's, or holds too little.
    """
    row, column = divmod(at[length - 1], stride)
    area = 0
    left_most, right_most, highest, lowest = column, column, row, row
    for k in range(length):
        next_row, next_column = divmod(at[k], stride)
        left_most, right_most = min(left_most, next_column), max(right_most, next_column)
        highest, lowest = min(highest, next_row), max(lowest, next_row)
        area += column * (next_row - row)
        # Crossing (x, y) is at pixel (x - 0.5, y - 0.5).
        xs[k] = 0.5 * (column + next_column) - 0.5
        ys[k] = 0.5 * (row + next_row) - 0.5
        row, column = next_row, next_column
    width, height = right_most - left_most, lowest - highest
    winding = length > 2 * LARGEST_DETOUR * (width + height)
    little = abs(area) < max(LEAST_FILL * LEAST_SIDE_PX**2, LEAST_BOX_FILL * width * height)
    return 0 if winding or little else area


@compiled_part("Tuple((int64, float64))(float64[::1], float64[::1], int64, int64, int64)")
def _farthest(x, y, n, start, stop):  # type: ignore[no-untyped-def]
    """Position between start and stop that lies farthest from their chord, and how far."""
    x0, y0 = x[start % n], y[start % n]
    dx, dy = x[stop % n] - x0, y[stop % n] - y0
    size = max(math.hypot(dx, dy), 1e-9)
    at, best = start, 0.0
    for i in range(start + 1, stop):
        k = i - n if i >= n else i
        away = abs(dx * (y[k] - y0) - dy * (x[k] - x0))
        if away > best:
            at, best = i, away
    return at, best / size


@compiled_part("boolean(float64[::1], float64[::1], int64, int64[::1])")
def _four_corners(x, y, n, corner):  # type: ignore[no-untyped-def]
    """Fills corner (5,) with ascending positions, the last being the first plus n; False when two are one."""
    cx, cy = 0.0, 0.0
    for i in range(n):
        cx += x[i] / n
        cy += y[i] / n
    first, best = 0, -1.0
    for i in range(n):
        d2 = (x[i] - cx) ** 2 + (y[i] - cy) ** 2
        if d2 > best:
            first, best = i, d2
    second, best = 0, -1.0
    for i in range(n):
        d2 = (x[i] - x[first]) ** 2 + (y[i] - y[first]) ** 2
        if d2 > best:
            second, best = i, d2
    corner[0] = first
    corner[1] = second if second > first else second + n
    corner[2] = first + n
    for known in range(2, 4):
        split, best, at = 0, -1.0, 0
        for k in range(known):
            i, away = _farthest(x, y, n, corner[k], corner[k + 1])
            if away > best:
                split, best, at = i, away, k
        if best < 0.5 * LEAST_SIDE_PX * 0.5:
            return False
        for k in range(known, at, -1):
            corner[k + 1] = corner[k]
        corner[at + 1] = split
    return True


@compiled_part("float64(float64[::1], float64[::1], int64[::1])")
def _around(x, y, corner):  # type: ignore[no-untyped-def]
    """Length of the way around the corners."""
    n = corner[4] - corner[0]
    total = 0.0
    for k in range(4):
        i, j = corner[k] % n, corner[k + 1] % n
        total += math.hypot(x[j] - x[i], y[j] - y[i])
    return total


@compiled_part("void(float64[::1], float64[::1], int64, int64, int64, float64[::1])")
def _line(x, y, n, start, stop, line):  # type: ignore[no-untyped-def]
    """Fills line with a, b, c of a x + b y = c, a^2 + b^2 = 1, by total least squares over a side without its ends."""
    skip = int(STRAIGHT_PART * (stop - start)) + 1
    if stop - start - 2 * skip < 2:
        skip = 0
    count, sx, sy, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    x0, y0 = x[start % n], y[start % n]
    for i in range(start + skip, stop - skip + 1):
        k = i % n
        u, v = x[k] - x0, y[k] - y0
        count += 1
        sx += u
        sy += v
        sxx += u * u
        sxy += u * v
        syy += v * v
    mx, my = sx / count, sy / count
    xx, xy, yy = sxx / count - mx * mx, sxy / count - mx * my, syy / count - my * my
    # The normal is across the longer axis of the scatter, which is at half the angle of (xx - yy, 2 xy).
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    line[0], line[1] = -math.sin(angle), math.cos(angle)
    line[2] = line[0] * (x0 + mx) + line[1] * (y0 + my)


@compiled_part("boolean(float64[:, ::1])")
def _well_shaped(quad):  # type: ignore[no-untyped-def]
    """Whether the corners turn one way, no side is much shorter than another, and they are no needle."""
    shortest, longest, total, twice_area = 1e9, 0.0, 0.0, 0.0
    turns = 0
    for k in range(4):
        ax, ay = quad[k, 0] - quad[k - 1, 0], quad[k, 1] - quad[k - 1, 1]
        j = (k + 1) % 4
        bx, by = quad[j, 0] - quad[k, 0], quad[j, 1] - quad[k, 1]
        side = math.hypot(bx, by)
        shortest, longest, total = min(shortest, side), max(longest, side), total + side
        turns += 1 if ax * by - ay * bx > 0 else -1
        twice_area += quad[k, 0] * quad[j, 1] - quad[k, 1] * quad[j, 0]
    if abs(turns) != 4 or shortest < LEAST_SIDE_PX or longest > LARGEST_RATIO * shortest:
        return False
    return 0.5 * abs(twice_area) > LEAST_FILL * (0.25 * total) ** 2


@compiled_part("boolean(float64[::1], float64[::1], int64, float64[:, ::1])")
def _four_sides(x, y, n, quad):  # type: ignore[no-untyped-def]
    """Whether an outline of n points is a quadrilateral; fills its corners (4, 2) in the outline's order."""
    corner = np.empty(5, np.int64)
    if not _four_corners(x, y, n, corner):
        return False
    tolerance = BEND_PX + LARGEST_BEND * 0.25 * _around(x, y, corner)
    line = np.empty((4, 3))
    for k in range(4):
        if _farthest(x, y, n, corner[k], corner[k + 1])[1] > tolerance:
            return False
        _line(x, y, n, corner[k], corner[k + 1], line[k])
    for k in range(4):
        a, b = line[k - 1], line[k]
        det = a[0] * b[1] - a[1] * b[0]
        # Sides that run on in nearly the same direction are one.
        if abs(det) < 0.15:
            return False
        quad[k, 0] = (a[2] * b[1] - a[1] * b[2]) / det
        quad[k, 1] = (a[0] * b[2] - a[2] * b[0]) / det
        i = corner[k] % n
        if math.hypot(quad[k, 0] - x[i], quad[k, 1] - y[i]) > 2.0 * tolerance:
            return False
    return _well_shaped(quad)


@compiled("float64[:, :, ::1](uint8[:, ::1])")
def _quads(crossing):  # type: ignore[no-untyped-def]
    """All quadrilaterals, from what is around each crossing of cracks; marks there what was walked."""
    h, w = crossing.shape
    most = 2 * (h + w)
    x, y, at = np.empty(most), np.empty(most), np.empty(most, np.int32)
    quads = np.empty((64, 4, 2))
    count = 0
    quad = np.empty((4, 2))
    flat = crossing.reshape(h * w)
    for start in range(w, h * w):
        # A crack goes up from here with dark on its right only, and was not walked yet.
        if flat[start] & (UPPER_LEFT | UPPER_RIGHT | WALKED) != UPPER_RIGHT:
            continue
        length = _walk(flat, w, start, at)
        if length > most or length < 4 * LEAST_SIDE_PX:
            continue
        area = _middles(at, length, w, x, y)
        if area == 0 or not _four_sides(x, y, length, quad):
            continue
        if count == len(quads):
            larger = np.empty((2 * count, 4, 2))
            for k in range(count):
                for corner in range(4):
                    larger[k, corner, 0], larger[k, corner, 1] = quads[k, corner, 0], quads[k, corner, 1]
            quads = larger
        for k in range(4):
            # Holes are walked the other way round.
            corner = k if area > 0 else 3 - k
            quads[count, k, 0], quads[count, k, 1] = quad[corner, 0], quad[corner, 1]
        count += 1
    return quads[:count]
