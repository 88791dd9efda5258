"""Reading markers: the cells of a quadrilateral sampled, made bits, and looked up in a dictionary.

Cells are sampled through the quadrilateral's homography in the picture at full size, whatever size it was found at.
The border must differ from the ring around it, which tells ink from paper and a negative from a positive; what is left
of that difference in the cells is the threshold. All turns of a code are compared, and as many wrong bits allowed as
the dictionary can mend.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.compiled import compiled, compiled_part
from calibrant.detection.opencv import Markers, dictionary

Codes = NDArray[np.uint64]

LEAST_CONTRAST = 8.0
"""Grey levels between the border and the ring around it: a few times the noise of their means."""
MOST_BORDER = 0.2
"""Part of the border's cells that may look like paper: glare or a finger over a corner; texture fails in half."""
MENDED = 0.6
"""Part of the wrong bits a dictionary can mend that is allowed, as in OpenCV: beyond, texture is mended to a marker."""
RING_CELLS = 0.4
"""Where the ring around is looked at, in cells outside the border: neighbours may be a cell away."""
SAME_PLACE = 0.15
"""Centres closer than this part of the diagonal are one marker's: two markers' are a side apart."""
STEP_CELLS = 0.1
"""Outlines are told from each other by the step of grey across them, this far to each side: nearer than a border is
wide."""
INNER = 0.25
"""Samples lie in the inner half of a cell, where blur from the next ones reaches last."""


@lru_cache(maxsize=32)
def dictionary_codes(name: str) -> tuple[Codes, int]:
    """Codes (n, 4) of a dictionary's markers at every quarter turn, and how many wrong bits are mended.

    Bits row by row from the top left, the first being the highest; 1 is paper. Turn k: as read from a square whose
    first corner is the marker's own corner k, clockwise from its top left.
    """
    known = dictionary(name)
    side = int(known.markerSize)
    # OpenCV's array says (n, bytes, 4) but holds the bytes of one turn after those of another.
    packed = np.asarray(known.bytesList, np.uint8).reshape(len(known.bytesList), 4, -1)[:, 0]
    bits = np.unpackbits(packed, axis=1)
    # The last byte holds the bits that are left, at its lower end.
    rest = side * side % 8
    if rest:
        bits = np.concatenate([bits[:, : side * side - rest], bits[:, -rest:]], axis=1)
    cells = bits.reshape(-1, side, side)
    weight = np.uint64(1) << np.arange(side * side, dtype=np.uint64)[::-1]
    turned = [np.rot90(cells, k, axes=(1, 2)).reshape(len(cells), -1).astype(np.uint64) @ weight for k in range(4)]
    codes = np.ascontiguousarray(np.stack(turned, axis=1))
    return codes, int(MENDED * int(known.maxCorrectionBits))


def read_codes(grey: Grey, quads: Array, name: str, *, border: int = 1) -> Markers:
    """The markers of a dictionary among quadrilaterals (n, 4, 2) px, clockwise, upright or as negatives.

    Args: border: width of the black border, cells.
    """
    codes, mended = dictionary_codes(name)
    side = int(dictionary(name).markerSize)
    ids, corners, step = _read(np.ascontiguousarray(grey), np.ascontiguousarray(quads), side, border, codes, mended)
    return Markers(ids, corners).subset(outlines(ids, corners, step))


def outlines(ids: NDArray[np.int64], corners: Array, step: Array) -> NDArray[np.bool_]:
    """Of the quadrilaterals around one marker, the one that lies on its edge, as a mask (n,).

    A wide border is flat in its middle, and the end of what is steep has an outline of its own.
    """
    if len(ids) < 2:
        return np.ones(len(ids), dtype=bool)
    centre = corners.mean(axis=1)
    reach = SAME_PLACE * np.linalg.norm(corners[:, 2] - corners[:, 0], axis=1)
    same = (ids[:, None] == ids) & (np.linalg.norm(centre[:, None] - centre, axis=2) < reach[:, None])
    order = np.arange(len(ids))
    better = (step > step[:, None]) | ((step == step[:, None]) & (order < order[:, None]))
    return np.asarray(~(same & better).any(axis=1))


@compiled_part("float64(uint8[:, ::1], float64, float64)")
def _bilinear(grey, u, v):  # type: ignore[no-untyped-def]
    """Grey value at a pixel; outside the image the nearest one's."""
    u = min(max(u, 0.0), grey.shape[1] - 1.001)
    v = min(max(v, 0.0), grey.shape[0] - 1.001)
    i, j = int(u), int(v)
    a, b = u - i, v - j
    top = grey[j, i] * (1.0 - a) + grey[j, i + 1] * a
    low = grey[j + 1, i] * (1.0 - a) + grey[j + 1, i + 1] * a
    return top * (1.0 - b) + low * b


@compiled_part("boolean(float64[:, ::1], float64[::1])")
def _from_unit_square(quad, H):  # type: ignore[no-untyped-def]
    """Fills H (8,) = a, b, c, d, e, f, g, h of u = (a x + b y + c) / (g x + h y + 1), v likewise (Heckbert 1989)."""
    d1x, d1y = quad[1, 0] - quad[2, 0], quad[1, 1] - quad[2, 1]
    d2x, d2y = quad[3, 0] - quad[2, 0], quad[3, 1] - quad[2, 1]
    sx = quad[0, 0] - quad[1, 0] + quad[2, 0] - quad[3, 0]
    sy = quad[0, 1] - quad[1, 1] + quad[2, 1] - quad[3, 1]
    det = d1x * d2y - d1y * d2x
    if abs(det) < 1e-9:
        return False
    g, h = (sx * d2y - sy * d2x) / det, (d1x * sy - d1y * sx) / det
    H[0], H[1], H[2] = quad[1, 0] - quad[0, 0] + g * quad[1, 0], quad[3, 0] - quad[0, 0] + h * quad[3, 0], quad[0, 0]
    H[3], H[4], H[5] = quad[1, 1] - quad[0, 1] + g * quad[1, 1], quad[3, 1] - quad[0, 1] + h * quad[3, 1], quad[0, 1]
    H[6], H[7] = g, h
    return True


@compiled_part("float64(uint8[:, ::1], float64[::1], float64, float64)")
def _at(grey, H, x, y):  # type: ignore[no-untyped-def]
    """Grey value at a place of the unit square; beyond the horizon some value of the picture."""
    w = max(H[6] * x + H[7] * y + 1.0, 1e-3)
    return _bilinear(grey, (H[0] * x + H[1] * y + H[2]) / w, (H[3] * x + H[4] * y + H[5]) / w)


@compiled_part("float64(uint8[:, ::1], float64[::1], int64)")
def _ring(grey, H, side):  # type: ignore[no-untyped-def]
    """Mean grey value of the ring around."""
    out = RING_CELLS / side
    total = 0.0
    for k in range(side):
        along = (k + 0.5) / side
        total += _at(grey, H, along, -out) + _at(grey, H, along, 1.0 + out)
        total += _at(grey, H, -out, along) + _at(grey, H, 1.0 + out, along)
    return total / (4 * side)


@compiled_part("float64(uint8[:, ::1], float64[::1], int64)")
def _step(grey, H, side):  # type: ignore[no-untyped-def]
    """Mean step of grey across the outline, to either side."""
    out = STEP_CELLS / side
    total = 0.0
    for k in range(side):
        along = (k + 0.5) / side
        total += _at(grey, H, along, -out) - _at(grey, H, along, out)
        total += _at(grey, H, along, 1.0 + out) - _at(grey, H, along, 1.0 - out)
        total += _at(grey, H, -out, along) - _at(grey, H, out, along)
        total += _at(grey, H, 1.0 + out, along) - _at(grey, H, 1.0 - out, along)
    return abs(total) / (4 * side)


@compiled_part("boolean(uint8[:, ::1], float64[::1], int64, float64)")
def _bordered(grey, H, side, ring):  # type: ignore[no-untyped-def]
    """Whether the outermost cells differ from the ring around, most of them to one side: what texture fails at once."""
    lighter, darker = 0, 0
    for k in range(side):
        along, near, far = (k + 0.5) / side, 0.5 / side, 1.0 - 0.5 / side
        for turn in range(4):
            x = along if turn < 2 else near if turn == 2 else far
            y = near if turn == 0 else far if turn == 1 else along
            difference = _at(grey, H, x, y) - ring
            lighter += difference > 0.5 * LEAST_CONTRAST
            darker += difference < -0.5 * LEAST_CONTRAST
    return max(lighter, darker) >= (1.0 - MOST_BORDER) * 4 * side


@compiled_part("void(uint8[:, ::1], float64[::1], float64[:, ::1])")
def _cells(grey, H, value):  # type: ignore[no-untyped-def]
    """Fills value (side, side) with the cells' mean grey values."""
    side = len(value)
    for j in range(side):
        for i in range(side):
            x, y, d = (i + 0.5) / side, (j + 0.5) / side, INNER / side
            total = _at(grey, H, x, y) + _at(grey, H, x - d, y - d) + _at(grey, H, x + d, y - d)
            value[j, i] = 0.2 * (total + _at(grey, H, x - d, y + d) + _at(grey, H, x + d, y + d))


@compiled_part("Tuple((boolean, uint64))(float64[:, ::1], float64, int64)")
def _bits(value, ring, border):  # type: ignore[no-untyped-def]
    """Whether cells (side, side) have a marker's border, and the code within it."""
    side = len(value)
    total, count = 0.0, 0
    for j in range(side):
        for i in range(side):
            if min(i, j, side - 1 - i, side - 1 - j) < border:
                total += value[j, i]
                count += 1
    ink = total / count
    if abs(ring - ink) < LEAST_CONTRAST:
        return False, np.uint64(0)
    sign = 1.0 if ring > ink else -1.0
    # Blur takes more of a single cell's light than of the ring's: the threshold moves to the middle of what cells show.
    light, lights = ring, 1
    for j in range(border, side - border):
        for i in range(border, side - border):
            if sign * (value[j, i] - 0.5 * (ink + ring)) > 0.0:
                light += value[j, i]
                lights += 1
    threshold = 0.5 * (ink + light / lights)
    wrong = 0
    code = np.uint64(0)
    for j in range(side):
        for i in range(side):
            paper = sign * (value[j, i] - threshold) > 0.0
            if min(i, j, side - 1 - i, side - 1 - j) < border:
                wrong += paper
            else:
                code = (code << np.uint64(1)) | np.uint64(paper)
    return wrong <= MOST_BORDER * count, code


@compiled_part("int64(uint64)")
def _ones(c):  # type: ignore[no-untyped-def]
    """How many bits are set: sums of neighbouring bits, pairs, quadruples, then of all bytes."""
    c = c - ((c >> np.uint64(1)) & np.uint64(0x5555555555555555))
    c = (c & np.uint64(0x3333333333333333)) + ((c >> np.uint64(2)) & np.uint64(0x3333333333333333))
    c = (c + (c >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((c * np.uint64(0x0101010101010101)) >> np.uint64(56))


@compiled_part("Tuple((int64, int64))(uint64, uint64[:, ::1], int64)")
def _look_up(code, codes, mended):  # type: ignore[no-untyped-def]
    """Id and turn of the marker nearest to a code; -1 when none is near enough."""
    best, which, turn = mended + 1, -1, 0
    for i in range(len(codes)):
        for k in range(4):
            wrong = _ones(code ^ codes[i, k])
            if wrong < best:
                best, which, turn = wrong, i, k
                if wrong == 0:
                    return which, turn
    return which, turn


@compiled("void(uint64[::1], uint64[:, ::1], int64, int64[:, ::1])")
def look_up(read, codes, mended, found):  # type: ignore[no-untyped-def]
    """Fills found (n, 2) with id and turn of the marker nearest to each code read (n,); -1 when none is near enough."""
    for i in range(len(read)):
        found[i, 0], found[i, 1] = _look_up(read[i], codes, mended)


@compiled(
    "Tuple((int64[::1], float64[:, :, ::1], float64[::1]))"
    "(uint8[:, ::1], float64[:, :, ::1], int64, int64, uint64[:, ::1], int64)"
)
def _read(grey, quads, bits, border, codes, mended):  # type: ignore[no-untyped-def]
    """Ids (n,), corners (n, 4, 2) from each marker's own top left, and steps of grey (n,), where a code is shown."""
    side = bits + 2 * border
    ids, corners, step = np.empty(len(quads), np.int64), np.empty((len(quads), 4, 2)), np.empty(len(quads))
    value, H = np.empty((side, side)), np.empty(8)
    count = 0
    for n in range(len(quads)):
        if not _from_unit_square(quads[n], H):
            continue
        ring = _ring(grey, H, side)
        if not _bordered(grey, H, side, ring):
            continue
        _cells(grey, H, value)
        ok, code = _bits(value, ring, border)
        if not ok:
            continue
        which, turn = _look_up(code, codes, mended)
        if which < 0:
            continue
        ids[count] = which
        step[count] = _step(grey, H, side)
        for k in range(4):
            corners[count, k] = quads[n, (k - turn) % 4]
        count += 1
    return ids[:count].copy(), corners[:count].copy(), step[:count].copy()
