"""Which candidate corners are neighbours on a board.

Every corner has four ports, in the order in which one meets them turning from x to y: along a, along b, against a,
against b. Turning from port 0 to port 1 crosses a dark square, from 1 to 2 a light one, and so on. On a board, the line
that leaves a corner by an a-port (dark on the side to which one turns) arrives at a b-port of the next one, because
colours alternate. Two corners are linked when each is the other's nearest that fits:
1. it lies in the port's direction, and the port's direction lies back;
2. a-ports meet b-ports;
3. along the whole way, one side is darker than the other by a good part of the corners' contrast.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from calibrant.compiled import compiled, compiled_part
from calibrant.detection.chessboard.candidates import Corners

ANGLE_TOLERANCE = math.radians(16)
"""Of a direction read from a ring of 4 px (two samples); half of the least angle between edges would be too strict."""
LEAST_EDGE = 0.25
"""Contrast along an edge over that of its corners: blur and glare take some, texture has no sides at all."""


def neighbours(corners: Corners) -> NDArray[np.int32]:
    """Index of the neighbour at each port (n, 4), -1 where there is none. Links are mutual."""
    if len(corners) == 0:
        return np.full((0, 4), -1, np.int32)
    h, w = corners.smooth.shape
    # On average one candidate a bin: bins that hold more cost more, empty ones must be stepped through.
    bin_size = max(8.0, math.sqrt(h * w / len(corners)))
    nearest = _nearest(corners.smooth, corners.xy, corners.axes, corners.contrast, bin_size)
    return _mutual(nearest)


@compiled_part("boolean(float32[:, ::1], float64, float64, float64, float64, float64)")
def edge_between(image, x0, y0, x1, y1, least):  # type: ignore[no-untyped-def]
    """Whether the side to which one turns (x towards y) is darker than the other by 2 `least` all along p0 -> p1."""
    h, w = image.shape
    dx, dy = x1 - x0, y1 - y0
    length = math.sqrt(dx * dx + dy * dy)
    # Far enough from the line to be off its blur, near enough to stay inside squares seen at a slant.
    offset = min(max(0.15 * length, 1.5), 6.0)
    nx, ny = -dy / length * offset, dx / length * offset
    for k in range(1, 4):
        x, y = x0 + 0.25 * k * dx, y0 + 0.25 * k * dy
        i0, j0 = int(x + nx + 0.5), int(y + ny + 0.5)
        i1, j1 = int(x - nx + 0.5), int(y - ny + 0.5)
        if min(i0, i1) < 0 or min(j0, j1) < 0 or max(i0, i1) >= w or max(j0, j1) >= h:
            return False
        if image[j1, i1] - image[j0, i0] < 2.0 * least:
            return False
    return True


@compiled_part("Tuple((int32[::1], int32[::1], int32[::1]))(float64[:, ::1], float64, int64, int64)")
def _binned(xy, bin_size, across, down):  # type: ignore[no-untyped-def]
    """Corners by bins of the picture: where each bin's members begin, the members, and the bin of each corner (n,)."""
    n = len(xy)
    start, home = np.empty(across * down + 1, np.int32), np.empty(n, np.int32)
    for k in range(len(start)):
        start[k] = 0
    for i in range(n):
        home[i] = int(xy[i, 1] / bin_size) * across + int(xy[i, 0] / bin_size)
        start[home[i] + 1] += 1
    for k in range(across * down):
        start[k + 1] += start[k]
    filled, members = np.empty(across * down, np.int32), np.empty(n, np.int32)
    for k in range(across * down):
        filled[k] = start[k]
    for i in range(n):
        members[filled[home[i]]] = i
        filled[home[i]] += 1
    return start, members, home


@compiled("int32[:, ::1](float32[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], float64)")
def _nearest(image, xy, axes, contrast, bin_size):  # type: ignore[no-untyped-def]
    """Nearest corner (n, 4) in each port's direction that fits, as from * 4 + port of its own; -1 for none."""
    n = len(xy)
    h, w = image.shape
    across, down = int(w / bin_size) + 1, int(h / bin_size) + 1
    start, members, home = _binned(xy, bin_size, across, down)
    direction = np.empty((n, 2, 2))
    for i in range(n):
        for axis in range(2):
            direction[i, axis, 0], direction[i, axis, 1] = math.cos(axes[i, axis]), math.sin(axes[i, axis])
    least_cos = math.cos(ANGLE_TOLERANCE)
    # A board of 3x3 corners has four squares a side: a square is at most a quarter of the picture.
    furthest = int(0.3 * max(h, w) / bin_size) + 1
    nearest, best = np.empty((n, 4), np.int32), np.empty(4)
    for i in range(n):
        for port in range(4):
            nearest[i, port], best[port] = -1, (bin_size * (furthest + 1)) ** 2
        column, row = home[i] % across, home[i] // across
        for ring in range(furthest + 1):
            # All that is nearer than this has been seen already.
            seen = bin_size * max(ring - 1, 0)
            if max(best[0], best[1], best[2], best[3]) <= seen * seen:
                break
            for v in range(max(row - ring, 0), min(row + ring, down - 1) + 1):
                whole = abs(v - row) == ring
                for u in range(column - ring, column + ring + 1, 1 if whole else max(2 * ring, 1)):
                    if u < 0 or u >= across:
                        continue
                    for m in range(start[v * across + u], start[v * across + u + 1]):
                        j = members[m]
                        dx, dy = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
                        d2 = dx * dx + dy * dy
                        if j == i or d2 < 16.0:
                            continue
                        reach = least_cos * math.sqrt(d2)
                        for axis in range(2):
                            along = direction[i, axis, 0] * dx + direction[i, axis, 1] * dy
                            port = axis if along > 0.0 else axis + 2
                            if abs(along) < reach or d2 >= best[port]:
                                continue
                            # The other end's line leads back along its other axis.
                            along = direction[j, 1 - axis, 0] * dx + direction[j, 1 - axis, 1] * dy
                            back = 1 - axis if along < 0.0 else 3 - axis
                            if abs(along) < reach:
                                continue
                            least = LEAST_EDGE * min(contrast[i], contrast[j])
                            # An a-port has its dark side where one turns to; seen from the b-port it is the other.
                            a, b = (i, j) if axis == 0 else (j, i)
                            if edge_between(image, xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], least):
                                best[port] = d2
                                nearest[i, port] = 4 * j + back
    return nearest


def _mutual(nearest: NDArray[np.int32]) -> NDArray[np.int32]:
    """Only the links where each end names the other: (n, 4) as 4 * corner + its port, -1 for none."""
    own = np.arange(nearest.size, dtype=np.int32)
    flat = nearest.ravel()
    agreed = (flat >= 0) & (flat[flat] == own)
    return np.where(agreed, flat, -1).astype(np.int32).reshape(nearest.shape)
