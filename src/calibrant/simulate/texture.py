"""A target's artwork as a fine picture of its sheet: drawn once, then sampled by every rendered view.

Each texel holds the exact mean of the artwork over its area (exact for upright rectangles and markers, to 1/16 of a
texel for other polygons and discs), so that an edge keeps its true position wherever it falls within a texel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.targets import Artwork, Disc, MarkerArt, Polygon
from calibrant.targets.apriltag3 import FAMILIES, tag_cells

_TEXELS = 4096
"""Texels along the longer side: three a pixel when the sheet fills a 1280 px image, well below an image's blur."""

_BAND = 16
"""Rows that are drawn at once: 0.5 MB of numbers."""

_SUBROWS = 16
"""Scan lines a texel for slanted and round shapes: coverage is exact along x and to 1/16 texel along y."""


@dataclass(frozen=True, eq=False)
class Texture:
    """A drawn sheet.

    data (h, w, 2) uint8: grey times cover, and cover (255 on the sheet); origin (2,) metres: corner of texel (0, 0);
    texel: its side, metres; clearance (h, w) float32: how many texels around a texel the drawing has one grey.
    """

    data: NDArray[np.uint8]
    origin: Array
    texel: float
    clearance: NDArray[np.float32]


@lru_cache(maxsize=8)
def rasterise(artwork: Artwork, texels: int = _TEXELS) -> Texture:
    """Draw an artwork, `texels` along its longer side.

    Raises: InputError when the sheet has no area.
    """
    x0, y0, x1, y1 = artwork.bounds
    if not (x1 > x0 and y1 > y0):
        raise InputError(f"the artwork's sheet spans {artwork.bounds} m; expected x0 < x1 and y0 < y1")
    texel = max(x1 - x0, y1 - y0) / texels
    width, height = int(np.ceil((x1 - x0) / texel - 1e-9)), int(np.ceil((y1 - y0) / texel - 1e-9))
    origin = np.array([x0, y0])
    grey = np.full((height, width), artwork.background, dtype=np.float32)
    for shape in artwork.shapes:
        _draw(grey, shape, origin, texel)
    # The last row and column may reach beyond the sheet; their cover says how much of them is paper.
    down, across = _cover(height, 0.0, (y1 - y0) / texel), _cover(width, 0.0, (x1 - x0) / texel)
    data = np.empty((height, width, 2), dtype=np.uint8)
    for rows in _bands(height):
        cover = np.outer(down[rows], across)
        data[rows, :, 0] = np.rint(255 * (np.clip(grey[rows], 0, 1) * cover))
        data[rows, :, 1] = np.rint(255 * cover)
    return Texture(data, origin, texel, _clearance(data))


def _bands(height: int) -> Iterator[slice]:
    """Rows few enough at once for a processor's cache: a whole sheet's numbers would go to memory in every step."""
    return (slice(first, min(first + _BAND, height)) for first in range(0, height, _BAND))


def marker_bits(dictionary: str, marker_id: int) -> NDArray[np.float32]:
    """Cells of a marker with its border, (n, n), 0 ink and 1 paper, top row first.

    Raises: InputError for an unknown dictionary, or an id that it does not hold; as `tag_cells` for AprilTag 3's.
    """
    if dictionary in FAMILIES:
        return tag_cells(dictionary, marker_id).astype(np.float32)
    number = getattr(cv2.aruco, dictionary, None)
    if not dictionary.startswith("DICT_") or number is None:
        known = ", ".join(sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_")))
        raise InputError(f"unknown marker dictionary {dictionary!r}; known: {known}")
    words = cv2.aruco.getPredefinedDictionary(number)
    count = len(words.bytesList)
    if not 0 <= marker_id < count:
        raise InputError(f"{dictionary} holds the markers 0 to {count - 1}; there is no marker {marker_id}")
    # One pixel a cell: the picture of the marker is its bits.
    cells = cv2.aruco.generateImageMarker(words, marker_id, words.markerSize + 2, borderBits=1)
    return (cells > 127).astype(np.float32)


def _draw(grey: NDArray[np.float32], shape: Polygon | Disc | MarkerArt, origin: Array, texel: float) -> None:
    if isinstance(shape, MarkerArt):
        bits = np.rot90(marker_bits(shape.dictionary, shape.id), -shape.quarter_turns)
        start = (np.asarray(shape.top_left) - origin) / texel
        _draw_cells(grey, 1 - bits if shape.inverted else bits, start, shape.side / texel)
    elif isinstance(shape, Disc):
        _draw_disc(grey, (np.asarray(shape.centre) - origin) / texel, shape.radius / texel, shape.grey)
    else:
        corners = (np.asarray(shape.corners, dtype=np.float64) - origin) / texel
        box = np.array([corners.min(axis=0), corners.max(axis=0)])
        upright = len(corners) == 4 and np.all(np.isclose(corners[:, None], box).any(axis=1))
        if upright:
            _paint(grey, box[0], box[1], np.array([[shape.grey]]))
        else:
            _draw_polygon(grey, corners, shape.grey)


def _cover(n: int, start: float, stop: float) -> Array:
    """Part of each of n unit cells that the interval [start, stop] covers."""
    edges = np.clip(np.arange(n + 1, dtype=np.float64), start, stop)
    return np.diff(edges)


def _draw_cells(grey: NDArray[np.float32], cells: NDArray[np.float32], start: Array, side: float) -> None:
    _paint(grey, start, start + side, cells)


def _paint(grey: NDArray[np.float32], low: Array, high: Array, cells: NDArray) -> None:
    """Paint a grid of cells on the rectangle low..high (texels): each texel takes its exact mean, C_y cells C_x^T."""
    c0, r0 = np.maximum(np.floor(low).astype(int), 0)
    c1, r1 = np.minimum(np.ceil(high).astype(int), grey.shape[::-1])
    if c0 >= c1 or r0 >= r1:
        return
    xs = np.linspace(low[0], high[0], cells.shape[1] + 1) - c0
    ys = np.linspace(low[1], high[1], cells.shape[0] + 1) - r0
    C_x = np.stack([_cover(c1 - c0, a, b) for a, b in pairwise(xs)], axis=1)
    C_y = np.stack([_cover(r1 - r0, a, b) for a, b in pairwise(ys)], axis=1)
    patch, along, of_rows, of_columns = grey[r0:r1, c0:c1], C_y @ cells, C_y.sum(axis=1), C_x.sum(axis=1)
    for rows in _bands(r1 - r0):
        patch[rows] *= (1 - np.outer(of_rows[rows], of_columns)).astype(np.float32)
        patch[rows] += (along[rows] @ C_x.T).astype(np.float32)


def _blend_rows(grey: NDArray[np.float32], row: int, spans: list[tuple[float, float]], value: float) -> None:
    """Blend horizontal spans, one list of all scan lines of a texel row, into that row."""
    c0 = max(int(np.floor(min(a for a, _ in spans))), 0)
    c1 = min(int(np.ceil(max(b for _, b in spans))), grey.shape[1])
    if c0 >= c1:
        return
    alpha = np.zeros(c1 - c0)
    for a, b in spans:
        alpha += _cover(c1 - c0, a - c0, b - c0)
    alpha /= _SUBROWS
    part = grey[row, c0:c1]
    part += (alpha * (value - part)).astype(np.float32)


def _draw_polygon(grey: NDArray[np.float32], corners: Array, value: float) -> None:
    """Even-odd fill, scan line by scan line."""
    starts, ends = corners, np.roll(corners, -1, axis=0)
    first = max(int(np.floor(corners[:, 1].min())), 0)
    last = min(int(np.ceil(corners[:, 1].max())), grey.shape[0])
    for row in range(first, last):
        spans: list[tuple[float, float]] = []
        for k in range(_SUBROWS):
            y = row + (k + 0.5) / _SUBROWS
            crossed = (starts[:, 1] <= y) != (ends[:, 1] <= y)
            a, b = starts[crossed], ends[crossed]
            x = np.sort(a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]))
            spans += list(zip(x[0::2].tolist(), x[1::2].tolist()))
        if spans:
            _blend_rows(grey, row, spans, value)


def _draw_disc(grey: NDArray[np.float32], centre: Array, radius: float, value: float) -> None:
    (c0, r0), (c1, r1) = np.floor(centre - radius).astype(int), np.ceil(centre + radius).astype(int)
    c0, r0, c1, r1 = max(c0, 0), max(r0, 0), min(c1, grey.shape[1]), min(r1, grey.shape[0])
    if c0 >= c1 or r0 >= r1:
        return
    y = r0 + (np.arange((r1 - r0) * _SUBROWS) + 0.5) / _SUBROWS - centre[1]
    half = np.sqrt(np.maximum(radius**2 - y**2, 0.0))[:, None]
    spans = np.diff(np.clip(np.arange(c0, c1 + 1), centre[0] - half, centre[0] + half), axis=1)
    alpha = spans.reshape(r1 - r0, _SUBROWS, c1 - c0).mean(axis=1)
    part = grey[r0:r1, c0:c1]
    part += (alpha * (value - part)).astype(np.float32)


def _clearance(data: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Distance, texels, to the nearest texel that differs from a neighbour; the sheet's border counts as an edge."""
    padded = cv2.copyMakeBorder(data, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=(0, 0))
    kernel = np.ones((3, 3), dtype=np.uint8)
    # Both bytes of a texel as one number.
    alike = cv2.dilate(padded, kernel).view(np.uint16) == cv2.erode(padded, kernel).view(np.uint16)
    distance = cv2.distanceTransform(alike[1:-1, 1:-1, 0].astype(np.uint8), cv2.DIST_L2, 5)
    # The distance is between centres of texels: points may be half a diagonal off at both ends.
    return np.maximum(distance - np.float32(np.sqrt(2)), 0)
