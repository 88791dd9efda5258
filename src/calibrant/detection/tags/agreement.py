"""Which of the markers seen lie as on the board: agreement between neighbours, so that a misread one cannot mislead."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from calibrant.arrays import Array, Grey
from calibrant.detection.local_homography import LocalMaps
from calibrant.detection.opencv import Markers, marker_cells, sample
from calibrant.targets.charuco import Charuco

# Markers are compared with those up to this many squares away: the diagonal neighbours and the next ones in the row.
NEIGHBOUR_SQUARES = 2.1
# A marker's corners are good to about 1 px in 15 px of side at worst: 7 % of the way to a neighbour, 0.15 squares at
# two squares. A misread marker is off by whole squares.
AGREEMENT_SQUARES = 0.35
# Neighbours' sides, as vectors, differ by perspective and by that same pixel; turned or misread ones by all of a side.
AGREEMENT_SIDES = 0.5
# A marker counts as read when at most this part of its cells is wrong: the smallest dictionary (4x4) keeps its markers
# 2 cells in 16 apart at least, and a random patch has half of them wrong.
WRONG_CELLS = 0.13
# Cells are sampled at these places, in cells from their centres: their inner halves, where blur reaches last.
_SUBCELLS = 0.25 * np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [0.0, 0.0]])


def agreeing_group(markers: Markers, target: Charuco) -> NDArray[np.bool_]:
    """The largest group of markers linked by agreement with a neighbour, as a mask (n,); none when no two agree.

    Two markers agree when their sides are alike and, stepping from one to the other by the mean of both, one arrives
    where it was seen: c_j = c_i + (J_i + J_j) / 2 (x_j - x_i), exact to second order in the change of J. A marker's
    own homography is not used: its perspective, from four corners good to a pixel, does not carry that far.
    """
    mask = np.zeros(len(markers), dtype=bool)
    index = np.flatnonzero((markers.ids >= 0) & (markers.ids < target.marker_count))
    if len(index) < 2:
        return mask
    xy = target.marker_squares[markers.ids[index]] + 0.5
    seen = markers.corners[index]
    centre = seen.mean(axis=1)
    along_x = 0.5 * (seen[:, 1] - seen[:, 0] + seen[:, 2] - seen[:, 3])
    along_y = 0.5 * (seen[:, 3] - seen[:, 0] + seen[:, 2] - seen[:, 1])
    J = np.stack([along_x, along_y], axis=-1) * (target.square / target.marker)
    step = xy[None] - xy[:, None]
    arrived = centre[:, None] + 0.5 * np.einsum("ijab,ijb->ija", J[:, None] + J[None], step)
    square_px = np.linalg.norm(J, axis=(1, 2)) / np.sqrt(2.0)
    smaller = np.minimum(square_px[:, None], square_px[None])
    distance = np.abs(step).max(axis=-1)
    close = (distance > 0) & (distance < NEIGHBOUR_SQUARES)
    alike = np.linalg.norm(J[:, None] - J[None], axis=(2, 3)) < AGREEMENT_SIDES * np.sqrt(2.0) * smaller
    there = np.linalg.norm(arrived - centre[None], axis=-1) < AGREEMENT_SQUARES * smaller
    first, second = np.nonzero(close & alike & there)
    if len(first) == 0:
        return mask
    graph = coo_matrix((np.ones(len(first)), (first, second)), shape=close.shape)
    label = connected_components(graph, directed=False)[1]
    mask[index[label == np.argmax(np.bincount(label))]] = True
    return mask


def map_from_unit_square(quads: Array, xy: Array) -> Array:
    """Points of the unit square's plane through the homographies to quads.

    (0,0), (1,0), (1,1), (0,1) -> the quad's corners: the closed form of P. Heckbert, Fundamentals of Texture Mapping
    and Image Warping (1989), section 2.2.3.
    Args: quads (n, 4, 2) pixels; xy (n, ..., 2). Returns: (n, ..., 2) pixels, infinite beyond the horizon.
    """
    p0, p1, p2, p3 = np.moveaxis(quads, 1, 0)
    d1, d2, s = p1 - p2, p3 - p2, p0 - p1 + p2 - p3
    determinant = _cross(d1, d2)
    g = _cross(s, d2) / determinant
    h = _cross(d1, s) / determinant
    axes = (len(quads),) + (1,) * (xy.ndim - 2)
    x, y = xy[..., 0], xy[..., 1]
    a = (p1 - p0 + g[:, None] * p1).reshape(*axes, 2)
    b = (p3 - p0 + h[:, None] * p3).reshape(*axes, 2)
    w = g.reshape(axes) * x + h.reshape(axes) * y + 1.0
    uv = a * x[..., None] + b * y[..., None] + p0.reshape(*axes, 2)
    return uv / np.where(w > 1e-6, w, np.nan)[..., None]


def is_negative(grey: Grey, markers: Markers, target: Charuco) -> bool:
    """Whether the markers are light on dark: the border's inside against the strip around it, by majority."""
    cell = 1.0 / (marker_cells(target.dictionary, 0).shape[0])
    along = np.linspace(0.1, 0.9, 9)
    gap = 0.25 * (target.square / target.marker - 1.0)
    border = strip(0.5 * cell, along)
    around = strip(-gap, along)
    inside = sample(grey, map_from_unit_square(markers.corners, np.tile(border, (len(markers), 1, 1))))
    outside = sample(grey, map_from_unit_square(markers.corners, np.tile(around, (len(markers), 1, 1))))
    return bool(np.median(outside.mean(axis=1) - inside.mean(axis=1)) < 0)


def read_markers(grey: Grey, maps: LocalMaps, ids: NDArray[np.int64], target: Charuco) -> NDArray[np.bool_]:
    """Which markers show their own cells where the corners around say they lie.

    The threshold is halfway between the mean grey of the cells that should be light and of those that should be dark:
    when the marker is another one, or none, the two are mixed and cells come out wrong.
    Args: maps, around each marker's centre; ids (n,). Returns: (n,).
    """
    if len(ids) == 0:
        return np.empty(0, dtype=bool)
    cells = np.stack([marker_cells(target.dictionary, int(i)) for i in ids]) != target.inverted
    side = cells.shape[1]
    centre = (np.arange(side) + 0.5) / side - 0.5
    grid = np.stack(np.meshgrid(centre, centre), axis=-1).reshape(-1, 1, 2) + _SUBCELLS / side
    grey_values = sample(grey, maps.pixels(grid.reshape(-1, 2) * (target.marker / target.square)))
    value = grey_values.reshape(len(ids), side * side, len(_SUBCELLS)).mean(axis=2)
    light = cells.reshape(len(ids), -1)
    middle = 0.5 * (_mean(value, light) + _mean(value, ~light))
    inner = np.zeros((side, side), dtype=bool)
    inner[1:-1, 1:-1] = True
    wrong = ((value > middle[:, None]) != light)[:, inner.ravel()]
    return wrong.mean(axis=1) <= WRONG_CELLS


def strip(inset: float, along: Array) -> Array:
    """Places (4 n, 2) of the unit square, along its four sides and that far within."""
    low, high = np.full_like(along, inset), np.full_like(along, 1.0 - inset)
    sides = [(along, low), (along, high), (low, along), (high, along)]
    return np.concatenate([np.column_stack(side) for side in sides])


def _mean(values: Array, where: NDArray[np.bool_]) -> Array:
    return np.where(where, values, 0.0).sum(axis=1) / np.maximum(where.sum(axis=1), 1)


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
