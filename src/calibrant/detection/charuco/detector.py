"""Finding ChArUco boards: markers coarse to fine, corners grown from them, the board confirmed by its own markers.

1. Markers are searched in the image made smaller, then at full size when that was not enough.
2. The largest group of markers that agree on where the board lies is the seed; a marker misread somewhere else agrees
   with nobody. The other layout of an even board is tried on the same markers, and a negative is recognised.
3. Corners grow from the seed by local homographies and are refined and checked at full size.
4. The markers are read again where the corners say they must be: at least two must show their own cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Grey
from calibrant.cameras.camera import Camera
from calibrant.detection.charuco.by_camera import agrees, maps_from_camera
from calibrant.detection.charuco.corners import Corners, corner_anchors, corners_at, grow_corners, marker_anchors
from calibrant.detection.charuco.reasons import another_board, why_not_found
from calibrant.detection.charuco.size import measured_marker
from calibrant.detection.detection import Detection, covariance_of
from calibrant.detection.opencv import Markers
from calibrant.detection.subpixel.refinement import DEFAULT, Refinement
from calibrant.detection.tags.agreement import agreeing_group, is_negative, read_markers
from calibrant.detection.tags.codes import read_codes
from calibrant.detection.tags.search import CLEAR, THIN, Effort, Ink, efforts, find_quads_at
from calibrant.errors import InputError
from calibrant.targets.charuco import Charuco
from calibrant.targets.lengths import format_length
from calibrant.targets.target import Target

# The search starts at about this many pixels along the longer side: a board that fills a quarter of the picture still
# has markers of 15 px there, the least that is read reliably.
COARSE_SIDE_PX = 800
# A homography has 8 unknowns: fewer corners than this say nothing about a camera.
LEAST_CORNERS = 4
# One marker may show by chance what it should; two, where the corners put them, do not.
LEAST_MARKERS = 2
# Markers that agree with no other are tried one by one: texture gives a few, a board that was read badly one or two.
MOST_ALONE = 4
# A marker seen anywhere on the board has all of it within this many boards' lengths, with room for perspective.
REACH_BOARDS = 1.2
# More corners place the board better, which finds the last ones.
CAMERA_ROUNDS = 2
# Markers read with another id than the place's: one in five may be misread; more, and this is another board.
OTHER_MARKERS = 0.2
# With as many of the markers beside its corners read, it is the board asked for: shifted or exchanged, hardly one fits.
SURE = 0.8


@dataclass(frozen=True, eq=False)
class _Board:
    """A board found: the target as printed (layout and colours), its corners, how many places of markers lie beside
    these, and how many markers were read there."""

    printed: Charuco
    corners: Corners
    places: int
    confirmed: int


@dataclass(frozen=True)
class CharucoDetector:
    """Finds ChArUco boards, whole or in part. refinement: how corners are measured. Registered in `registry.py`."""

    refinement: Refinement = DEFAULT

    def detect(self, grey: Grey, target: Target, *, camera: Camera | None = None) -> Detection:
        """The board's corners in a grey image (h, w).

        Args: camera, when it is known already: corners that no neighbour predicts well are then looked for where the
            camera puts them, which finds more of a board seen through a wide lens.
        """
        if not isinstance(target, Charuco):
            raise InputError(f"the ChArUco detector finds targets of kind charuco, got {target.kind}")
        seen, quads = Markers.of((), None), np.empty((0, 4, 2))
        for markers, looked_at in _searches(grey, target):
            board = _best_board(grey, target, markers, self.refinement)
            if board is not None:
                if board.confirmed < SURE * board.places:
                    shown = _all_markers(grey, board, markers)
                    other = another_board(target, shown, _at_their_places(board, shown))
                    if other is not None:
                        return other
                if camera is not None:
                    board = _with_camera(grey, board, camera, markers, self.refinement)
                return _detection(target, board, measured_marker(markers, board.printed, board.corners))
            seen = markers if len(markers) > len(seen) else seen
            quads = looked_at if len(looked_at) > len(quads) else quads
        return why_not_found(grey, target, seen, quads)


def _searches(grey: Grey, target: Charuco) -> Iterator[tuple[Markers, np.ndarray]]:
    """Markers found with more and more effort, and the quadrilaterals they were read from.

    In the whole picture, then where some were seen; where one was, others may hide behind thin paper.
    """
    seen = Markers.of((), None)
    ink: Ink = "light" if target.inverted else "dark"
    for effort in (*efforts(grey.shape, COARSE_SIDE_PX, ink), Effort(1, CLEAR, ink, THIN)):
        if effort.part == THIN and not np.any(seen.ids < target.marker_count):
            return
        low, part = _region(grey, target, seen)
        quads = find_quads_at(part, effort) + low
        markers = read_codes(grey, quads, target.dictionary)
        yield markers, quads
        seen = markers if len(markers) > len(seen) else seen


def _region(grey: Grey, target: Charuco, seen: Markers) -> tuple[np.ndarray, Grey]:
    """Where the part of the picture begins that a board with the markers seen can reach, and it; all before any was."""
    on_board = seen.subset(seen.ids < target.marker_count)
    if len(on_board) < LEAST_MARKERS:
        return np.zeros(2), grey
    side = np.linalg.norm(np.roll(on_board.corners, 1, axis=1) - on_board.corners, axis=2).max()
    reach = REACH_BOARDS * side * target.square / target.marker * max(target.columns, target.rows)
    low = np.maximum(np.floor(on_board.corners.min(axis=(0, 1)) - reach), 0).astype(int)
    high = np.ceil(on_board.corners.max(axis=(0, 1)) + reach).astype(int) + 1
    return low, np.ascontiguousarray(grey[low[1] : high[1], low[0] : high[0]])


def _best_board(grey: Grey, target: Charuco, markers: Markers, how: Refinement) -> _Board | None:
    """The board that the markers show in the layout they fit best; the layout asked for wins a tie.

    Where no two markers agree, each of them alone may lead to the others, which then confirm it.
    """
    layouts = [target] if target.rows % 2 else [target, replace(target, legacy=not target.legacy)]
    fits = [agreeing_group(markers, layout) for layout in layouts]
    best = int(np.argmax([fit.sum() for fit in fits]))
    if fits[best].any():
        return _grown(grey, layouts[best], markers.subset(fits[best]), markers, how)
    alone = np.flatnonzero(markers.ids < target.marker_count)[:MOST_ALONE]
    for k in alone:
        for layout in layouts:
            board = _grown(grey, layout, markers.subset(np.arange(len(markers)) == k), markers, how)
            if board is not None:
                return board
    return None


def _grown(grey: Grey, layout: Charuco, seed: Markers, markers: Markers, how: Refinement) -> _Board | None:
    """The board grown from markers that lie as on it, when it is confirmed."""
    printed = replace(layout, inverted=is_negative(grey, seed, layout))
    corners = grow_corners(grey, printed, marker_anchors(seed, printed), how)
    return _confirmed(grey, printed, corners, markers)


def _confirmed(grey: Grey, printed: Charuco, corners: Corners, markers: Markers) -> _Board | None:
    """The board, when the markers between its corners are its own: shown where they must be, and no others there."""
    if len(corners) < LEAST_CORNERS or _on_one_line(printed, corners):
        return None
    centres = (printed.marker_squares + 0.5).astype(np.float64)
    maps = corner_anchors(corners, printed).maps_at(centres)
    near = maps.determined & _near_a_corner(centres, printed, corners)
    ids = np.flatnonzero(near)
    confirmed = int(read_markers(grey, maps.subset(near), ids, printed).sum())
    away = np.linalg.norm(markers.corners.mean(axis=1)[:, None] - maps.centres[ids][None], axis=-1)
    at_place = away < 0.5 * maps.square_px[ids]
    others = int(np.count_nonzero(at_place & (markers.ids[:, None] != ids)))
    if confirmed < LEAST_MARKERS or others > max(1.0, OTHER_MARKERS * confirmed):
        return None
    return _Board(printed, corners, len(ids), confirmed)


def _all_markers(grey: Grey, board: _Board, markers: Markers) -> Markers:
    """The markers found, and those that are read where the board has some, whichever they are."""
    centres = (board.printed.marker_squares + 0.5).astype(np.float64)
    maps = corner_anchors(board.corners, board.printed).maps_at(centres)
    maps = maps.subset(maps.determined & _near_a_corner(centres, board.printed, board.corners))
    half = 0.5 * board.printed.marker / board.printed.square
    quads = maps.pixels(half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]))
    shown = read_codes(grey, quads, board.printed.dictionary)
    away = np.linalg.norm(markers.corners.mean(axis=1)[:, None] - shown.corners.mean(axis=1)[None], axis=-1)
    size = np.linalg.norm(markers.corners[:, 2] - markers.corners[:, 0], axis=-1)
    rest = markers.subset(away.min(axis=1, initial=np.inf) > 0.5 * size)
    return Markers(np.concatenate([shown.ids, rest.ids]), np.concatenate([shown.corners, rest.corners]))


def _at_their_places(board: _Board, markers: Markers) -> int:
    """How many markers lie where the board has them, as far as its corners tell its places."""
    on_board = markers.subset(markers.ids < board.printed.marker_count)
    places = (board.printed.marker_squares[on_board.ids] + 0.5).astype(np.float64)
    maps = corner_anchors(board.corners, board.printed).maps_at(places)
    away = np.linalg.norm(on_board.corners.mean(axis=1) - maps.centres, axis=1)
    return int(np.count_nonzero(~maps.determined | (away < 0.5 * maps.square_px)))


def _near_a_corner(centres: np.ndarray, printed: Charuco, corners: Corners) -> np.ndarray:
    """Whether a marker touches a found corner: its place is then known well enough to read it."""
    xy = printed.points[corners.index, :2] / printed.square
    return np.asarray((np.abs(centres[:, None] - xy[None]).max(axis=-1) < 0.6).any(axis=1))


def _on_one_line(printed: Charuco, corners: Corners) -> bool:
    row, column = np.divmod(corners.index, printed.columns - 1)
    centred = np.column_stack([row, column]) - np.array([row.mean(), column.mean()])
    return bool(np.linalg.svd(centred, compute_uv=False)[-1] < 1e-6)


def _with_camera(grey: Grey, board: _Board, camera: Camera, markers: Markers, how: Refinement) -> _Board:
    """The board with the corners that a known camera helps to find; never fewer than before."""
    best = board
    for _ in range(CAMERA_ROUNDS):
        maps = maps_from_camera(best.corners, board.printed, camera)
        if maps is None:
            break
        known = best.corners.subset(agrees(best.corners, maps))
        corners = corners_at(grey, board.printed, known, maps, how)
        more = _confirmed(grey, board.printed, corners.subset(agrees(corners, maps)), markers)
        if more is None or len(more.corners) <= len(best.corners):
            break
        best = more
    return best


def _detection(target: Charuco, board: _Board, marker: float | None) -> Detection:
    """Args: marker: side of the markers as measured, of a square's, where it is another one than the target's."""
    notes = []
    if marker is not None:
        notes.append(
            f"The markers measure about {marker:.2f} of a square's side, the spec says "
            f"{target.marker / target.square:.2f} ({format_length(target.marker)} of {format_length(target.square)}): "
            "measure both and correct the spec."
        )
    if board.printed.legacy != target.legacy:
        layout, option = ("legacy", "add :legacy") if board.printed.legacy else ("new", "leave :legacy out")
        notes.append(f"The board has the {layout} layout of its markers: {option} in the spec to say so.")
    if board.printed.inverted != target.inverted:
        colours, option = ("a", "add :inverted") if board.printed.inverted else ("not a", "leave :inverted out")
        notes.append(f"The board is {colours} negative: {option} in the spec to say so.")
    found = board.corners
    return Detection(
        target.point_ids[found.index], found.uv, found.sigma_px, notes=tuple(notes),
        covariance_px=covariance_of(found.sigma_px, found.shape), smeared=found.smeared,
    )  # fmt: skip
