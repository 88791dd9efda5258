"""Where a grid's missing corners should be, and whether one is there. Compiled; used by `chessboard_grid`.

Four equally spaced points on a line keep their cross ratio 4/3 in any view, so that from the distances d1, d2 between
the last three follows the next: d0 = d1 (d1 + d2) / (3 d2 - d1).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from calibrant.compiled import compiled, compiled_part
from calibrant.detection.chessboard.links import edge_between

Array = NDArray[np.float64]

SNAP = 0.25
"""How far from its prediction a corner may lie, over the distance of its neighbours: half way to a square's middle."""
LEAST_CONTRAST = 0.25
"""Of the squares around a corner, over that of the grid: glare takes some, the end of the board takes all. Both are
differences over brightness, which a shadow does not change."""
NEAR, FAR = 0.2, 0.35
"""Where the squares around a corner are looked at, over the distance to the next corners. A narrow white margin before
a dark backdrop looks like squares at one depth, not at two; boards whose outer squares are cut in half pass."""
LEAST_DIFFERENCE = 2.0
"""Grey levels between dark and light squares: above the rounding of 8 bits."""


@compiled_part("UniTuple(float64, 3)(float64[:, :, ::1], int64, int64, int64, int64)")
def _along(xy, row, column, dr, dc):  # type: ignore[no-untyped-def]
    """(x, y, weight) that the line leaving (row, column) by (dr, dc) predicts for it; weight 0 when it cannot."""
    rows, columns = xy.shape[0], xy.shape[1]
    known = 0
    p = np.empty((3, 2))
    for k in range(1, 4):
        r, c = row + k * dr, column + k * dc
        if not (0 <= r < rows and 0 <= c < columns) or math.isnan(xy[r, c, 0]):
            break
        p[known, 0], p[known, 1] = xy[r, c, 0], xy[r, c, 1]
        known += 1
    if known < 2:
        return 0.0, 0.0, 0.0
    x1, y1 = p[0, 0] - p[1, 0], p[0, 1] - p[1, 1]
    ratio = 1.0
    if known == 3:
        d1 = math.sqrt(x1 * x1 + y1 * y1)
        d2 = math.sqrt((p[1, 0] - p[2, 0]) ** 2 + (p[1, 1] - p[2, 1]) ** 2)
        # A step changes by less than a third from square to square in any view that can be used.
        ratio = min(max((d1 + d2) / max(3.0 * d2 - d1, 1e-9), 2.0 / 3.0), 1.5)
    return p[0, 0] + ratio * x1, p[0, 1] + ratio * y1, float(known)


@compiled_part("boolean(float64[:, :, ::1], int64, int64, float64[::1])")
def predict(xy, row, column, out):  # type: ignore[no-untyped-def]
    """Fills out with x, y, and the steps ux, uy to the next column, vx, vy to the next row; False when unknown."""
    rows, columns = xy.shape[0], xy.shape[1]
    for k in range(6):
        out[k] = 0.0
    across, down = 0, 0
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        for c in range(max(column - 2, 0), min(column + 2, columns - 1)):
            if not (math.isnan(xy[r, c, 0]) or math.isnan(xy[r, c + 1, 0])):
                out[2] += xy[r, c + 1, 0] - xy[r, c, 0]
                out[3] += xy[r, c + 1, 1] - xy[r, c, 1]
                across += 1
    for r in range(max(row - 2, 0), min(row + 2, rows - 1)):
        for c in range(max(column - 1, 0), min(column + 2, columns)):
            if not (math.isnan(xy[r, c, 0]) or math.isnan(xy[r + 1, c, 0])):
                out[4] += xy[r + 1, c, 0] - xy[r, c, 0]
                out[5] += xy[r + 1, c, 1] - xy[r, c, 1]
                down += 1
    if across == 0 or down == 0:
        return False
    out[2], out[3], out[4], out[5] = out[2] / across, out[3] / across, out[4] / down, out[5] / down
    total = 0.0
    for dr, dc in ((0, 1), (1, 0)):
        r0, c0, r1, c1 = row - dr, column - dc, row + dr, column + dc
        if r0 >= 0 and c0 >= 0 and r1 < rows and c1 < columns:
            x = 0.5 * (xy[r0, c0, 0] + xy[r1, c1, 0])
            y = 0.5 * (xy[r0, c0, 1] + xy[r1, c1, 1])
            if not math.isnan(x):
                out[0] += x
                out[1] += y
                total += 1.0
    if total == 0.0:
        for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            x, y, weight = _along(xy, row, column, dr, dc)
            out[0] += weight * x
            out[1] += weight * y
            total += weight
    if total == 0.0:
        for dr in (-1, 1):
            for dc in (-1, 1):
                r, c = row + dr, column + dc
                if 0 <= r < rows and 0 <= c < columns:
                    x = xy[r, column, 0] + xy[row, c, 0] - xy[r, c, 0]
                    y = xy[r, column, 1] + xy[row, c, 1] - xy[r, c, 1]
                    if not math.isnan(x):
                        out[0] += x
                        out[1] += y
                        total += 1.0
    if total == 0.0:
        return False
    out[0], out[1] = out[0] / total, out[1] / total
    return True


@compiled("float64[:, ::1](float64[:, :, ::1], boolean[:, ::1])")
def steps_at(xy, wanted):  # type: ignore[no-untyped-def]
    """Steps ux, uy, vx, vy (n, 4) as from `predict` at the wanted corners, row by row; 0 where they are not known."""
    count = 0
    for row in range(wanted.shape[0]):
        for column in range(wanted.shape[1]):
            count += 1 if wanted[row, column] else 0
    steps, out = np.empty((count, 4)), np.empty(6)
    n = 0
    for row in range(xy.shape[0]):
        for column in range(xy.shape[1]):
            if wanted[row, column]:
                predict(xy, row, column, out)
                for k in range(4):
                    steps[n, k] = out[2 + k]
                n += 1
    return steps


@compiled_part("boolean(float32[:, ::1], float64, float64, float64[::1], boolean, float64)")
def looks_like_corner(image, x, y, step, dark, contrast):  # type: ignore[no-untyped-def]
    """Whether the four squares around (x, y) alternate clearly, both near to it and far.

    step: as from `predict`; dark: colour of the square towards the next column and row; contrast: of the grid, half the
    difference of dark and light over their mean.
    """
    h, w = image.shape
    darkest_light, lightest_dark = 1e9, -1e9
    for depth in (NEAR, FAR):
        for a in (-depth, depth):
            for b in (-depth, depth):
                i = int(x + a * step[2] + b * step[4] + 0.5)
                j = int(y + a * step[3] + b * step[5] + 0.5)
                if i < 0 or j < 0 or i >= w or j >= h:
                    return False
                if (a * b > 0) == dark:
                    lightest_dark = max(lightest_dark, image[j, i])
                else:
                    darkest_light = min(darkest_light, image[j, i])
    difference = darkest_light - lightest_dark
    return difference >= max(LEAST_CONTRAST * contrast * (darkest_light + lightest_dark), LEAST_DIFFERENCE)


@compiled_part("boolean(float32[:, ::1], float64[:, :, ::1], int64, int64, float64, float64, boolean, float64)")
def edges_arrive(image, xy, row, column, x, y, dark, contrast):  # type: ignore[no-untyped-def]
    """Whether an edge of the right colours leads from (x, y) all the way to each neighbour that is known.

    dark: colour of the square towards the next column and row.
    """
    rows, columns = xy.shape[0], xy.shape[1]
    level = image[min(max(int(y + 0.5), 0), image.shape[0] - 1), min(max(int(x + 0.5), 0), image.shape[1] - 1)]
    # Half of what the squares must show: next to an edge, blur has taken part of it.
    least = max(0.5 * LEAST_CONTRAST * contrast * level, 0.5 * LEAST_DIFFERENCE)
    for turn in range(4):
        r = row + (1 if turn == 1 else -1 if turn == 3 else 0)
        c = column + (1 if turn == 0 else -1 if turn == 2 else 0)
        if not (0 <= r < rows and 0 <= c < columns) or math.isnan(xy[r, c, 0]):
            continue
        # Going right or left, the side to which one turns has the colour of the square right and below; going down or
        # up, the other.
        if dark ^ (turn % 2 == 1):
            arrives = edge_between(image, x, y, xy[r, c, 0], xy[r, c, 1], least)
        else:
            arrives = edge_between(image, xy[r, c, 0], xy[r, c, 1], x, y, least)
        if not arrives:
            return False
    return True


def by_rows(xy: Array, height: int) -> tuple[Array, NDArray[np.int64]]:
    """Points (m, 2) in the order of the image's rows they lie in, and where each of its rows begins, (height + 1,)."""
    row = np.clip(xy[:, 1].astype(np.int64), 0, height - 1)
    first = np.zeros(height + 1, np.int64)
    np.cumsum(np.bincount(row, minlength=height), out=first[1:])
    return np.ascontiguousarray(xy[np.argsort(row, kind="stable")]), first


@compiled("int64(float64[:, :, ::1], boolean[:, ::1], boolean, float64, float32[:, ::1], float64[:, ::1], int64[::1])")
def snap(xy, wanted, dark, contrast, image, pool, first):  # type: ignore[no-untyped-def]
    """Sets the `wanted` corners of a grid xy where a saddle lies as predicted; how many were set.

    dark: colour of the square right of and below corner (0, 0); contrast: of the grid; pool (m, 2), first: the saddles
    as from `by_rows`.
    """
    rows, columns = xy.shape[0], xy.shape[1]
    found = np.empty((rows, columns), np.int64)
    step = np.empty(6)
    count = 0
    for row in range(rows):
        for column in range(columns):
            found[row, column] = -1
            if not wanted[row, column] or not predict(xy, row, column, step):
                continue
            across = math.sqrt(step[2] ** 2 + step[3] ** 2)
            down = math.sqrt(step[4] ** 2 + step[5] ** 2)
            best = (SNAP * min(across, down)) ** 2
            nearest = -1
            reach = math.sqrt(best)
            upper = min(max(int(step[1] - reach), 0), len(first) - 1)
            lower = min(max(int(step[1] + reach) + 1, 0), len(first) - 1)
            for k in range(first[upper], first[lower]):
                d2 = (pool[k, 0] - step[0]) ** 2 + (pool[k, 1] - step[1]) ** 2
                if d2 < best:
                    best = d2
                    nearest = k
            if nearest < 0:
                continue
            here = dark ^ ((row + column) % 2 == 1)
            x, y = pool[nearest, 0], pool[nearest, 1]
            if looks_like_corner(image, x, y, step, here, contrast) and edges_arrive(
                image, xy, row, column, x, y, here, contrast
            ):
                found[row, column] = nearest
                count += 1
    for row in range(rows):
        for column in range(columns):
            k = found[row, column]
            if k >= 0:
                xy[row, column, 0], xy[row, column, 1] = pool[k, 0], pool[k, 1]
    return count


@compiled("int64(float64[:, :, ::1], boolean, float64, float32[:, ::1])")
def drop_misfits(xy, dark, contrast, image):  # type: ignore[no-untyped-def]
    """Unsets corners that lie elsewhere than their neighbours say, or whose squares do not alternate; how many."""
    rows, columns = xy.shape[0], xy.shape[1]
    drop = np.empty((rows, columns), np.int64)
    step = np.empty(6)
    for row in range(rows):
        for column in range(columns):
            drop[row, column] = 0
            if math.isnan(xy[row, column, 0]) or not predict(xy, row, column, step):
                continue
            across = math.sqrt(step[2] ** 2 + step[3] ** 2)
            down = math.sqrt(step[4] ** 2 + step[5] ** 2)
            off = math.sqrt((xy[row, column, 0] - step[0]) ** 2 + (xy[row, column, 1] - step[1]) ** 2)
            here = dark ^ ((row + column) % 2 == 1)
            # Twice the tolerance of a prediction, for a wrong neighbour spoils it too.
            if off > 2.0 * SNAP * min(across, down) or not looks_like_corner(
                image, xy[row, column, 0], xy[row, column, 1], step, here, contrast
            ):
                drop[row, column] = 1
    count = 0
    for row in range(rows):
        for column in range(columns):
            if drop[row, column] > 0:
                xy[row, column, 0], xy[row, column, 1] = np.nan, np.nan
                count += 1
    return count
