"""The size of a ChArUco board that is not the one asked for: columns, rows and marker, read from where its markers lie.

Ids count the markers row by row, so that the number of columns says where each lies beside which. Every number of
columns is tried; with the right one, neighbouring markers agree (`markers.agreeing_group`). The proportion of square
and marker, which the agreement needs, comes from the same neighbours: centres differ by

    c_j - c_i = (square / marker) (J_i + J_j) / 2 (x_j - x_i),     J the marker's own sides, px.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calibrant.detection.charuco.corners import Corners, corner_anchors
from calibrant.detection.opencv import Markers
from calibrant.detection.tags.agreement import NEIGHBOUR_SQUARES, agreeing_group
from calibrant.targets.charuco import Charuco
from calibrant.targets.dictionaries import DICTIONARIES

LEAST_MARKERS = 6
"""Markers that must be seen and agree: fewer lie on boards of several widths."""
LEAST_PART = 0.7
"""Of the markers seen that must agree; the others may be misread, or on another board."""
MOST_COLUMNS = 40
LEAST_MEASURED = 3
OTHER_MARKER, OUTLINE_PX = 0.1, 2.0
"""What a marker's side may be off the spec's, relative and in pixels: outlines are good to a pixel at each end."""
ROUNDED = 0.05
"""Of a square's side: what is said of a marker's size, so that pictures of one board say the same."""
LARGEST_PROPORTION = 5.0
"""Square over marker: markers any smaller are not read at a distance that shows the board."""


def size_seen(markers: Markers, target: Charuco) -> Charuco | None:
    """The board of the target's dictionary on which the markers lie, with the target's square; None when unclear.

    A board whose last row shows no marker is taken for one without that row.
    """
    best: list[tuple[int, Charuco]] = []
    if len(np.unique(markers.ids)) < LEAST_MARKERS:
        return None
    for board in _boards(target, int(markers.ids.max())):
        proportion = _proportion(markers, board)
        if not 1.0 < proportion < LARGEST_PROPORTION:
            continue
        fitted = replace(board, marker=board.square / proportion)
        best.append((int(np.count_nonzero(agreeing_group(markers, fitted))), fitted))
    best.sort(key=lambda pair: -pair[0])
    if not best or best[0][0] < max(LEAST_MARKERS, LEAST_PART * len(markers)):
        return None
    unclear = len(best) > 1 and best[1][0] == best[0][0]
    return None if unclear else best[0][1]


def measured_marker(markers: Markers, board: Charuco, corners: Corners) -> float | None:
    """Side of the markers over that of the squares, to ROUNDED; None where it is the board's own.

    Sides are turned into squares by the map that the corners around give; their median counts from LEAST_MEASURED on.
    """
    on_board = markers.subset(markers.ids < board.marker_count)
    if len(on_board) < LEAST_MEASURED:
        return None
    places = (board.marker_squares[on_board.ids] + 0.5).astype(np.float64)
    maps = corner_anchors(corners, board).maps_at(places)
    away = np.linalg.norm(on_board.corners.mean(axis=1) - maps.centres, axis=1)
    good = maps.determined & (away < 0.5 * maps.square_px)
    if np.count_nonzero(good) < LEAST_MEASURED:
        return None
    maps, seen = maps.subset(good), on_board.corners[good]
    sides = np.linalg.solve(maps.px_per_square[:, None], (np.roll(seen, -1, axis=1) - seen)[..., None])[..., 0]
    part = float(np.median(np.linalg.norm(sides, axis=2).mean(axis=1)))
    own = board.marker / board.square
    off_px = abs(part - own) * float(np.median(maps.square_px))
    if abs(part / own - 1.0) < OTHER_MARKER or off_px < OUTLINE_PX:
        return None
    return ROUNDED * round(part / ROUNDED)


def _boards(target: Charuco, last_id: int) -> Iterator[Charuco]:
    """Boards of all widths, with as many rows as the highest id needs."""
    capacity = DICTIONARIES[target.dictionary].capacity
    for columns in range(2, MOST_COLUMNS + 1):
        for legacy in (False, True):
            # The old layout differs for an even number of rows alone.
            step = 2 if legacy else 1
            rows = 2
            while (board := _bare(target, columns, rows, legacy=legacy)) is not None and board.marker_count <= last_id:
                rows += step
            if board is not None and board.marker_count <= capacity:
                yield board


def _bare(target: Charuco, columns: int, rows: int, *, legacy: bool) -> Charuco | None:
    """The target with another size; None when its dictionary has not as many markers."""
    if (columns * rows + 1) // 2 > DICTIONARIES[target.dictionary].capacity:
        return None
    return replace(target, columns=columns, rows=rows, legacy=legacy)


def _proportion(markers: Markers, board: Charuco) -> float:
    """Square over marker by the median pair of neighbours; 0 without any."""
    xy = board.marker_squares[markers.ids] + 0.5
    centre = markers.corners.mean(axis=1)
    c = markers.corners
    J = 0.5 * np.stack([c[:, 1] - c[:, 0] + c[:, 2] - c[:, 3], c[:, 3] - c[:, 0] + c[:, 2] - c[:, 1]], axis=-1)
    step = xy[None] - xy[:, None]
    distance = np.abs(step).max(axis=-1)
    first, second = np.nonzero((distance > 0) & (distance < NEIGHBOUR_SQUARES))
    if len(first) == 0:
        return 0.0
    predicted = 0.5 * np.einsum("nab,nb->na", J[first] + J[second], step[first, second])
    seen = centre[second] - centre[first]
    return float(np.median((seen * predicted).sum(axis=1) / (predicted**2).sum(axis=1)))
