"""Why no ChArUco board was found: another dictionary, another size, too little of it, or nothing at all."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array, Grey
from calibrant.detection.charuco.size import OTHER_MARKER, size_seen
from calibrant.detection.detection import Detection
from calibrant.detection.opencv import Markers
from calibrant.detection.tags.agreement import agreeing_group
from calibrant.detection.tags.codes import read_codes
from calibrant.targets.charuco import Charuco
from calibrant.targets.dictionaries import DICTIONARIES
from calibrant.targets.lengths import format_length

# One of each family: the smaller dictionaries of a size are the first markers of its largest.
_FAMILIES = (
    "DICT_4X4_1000",
    "DICT_5X5_1000",
    "DICT_6X6_1000",
    "DICT_7X7_1000",
    "DICT_ARUCO_ORIGINAL",
    "DICT_APRILTAG_36h11",
    "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_16h5",
    "DICT_ARUCO_MIP_36h12",
)
# Small dictionaries are misread in texture now and then; three different markers of one are no accident.
_LEAST_OTHER_MARKERS = 3
# Markers away from their places, over those at them, beyond which another board is looked for: one in five is misread.
OTHERS = 0.25


def why_not_found(grey: Grey, target: Charuco, markers: Markers, quads: Array) -> Detection:
    """No points, and the reason in words.

    Args: markers, the most that were read of the target's dictionary; quads (n, 4, 2) px, where others may be read.
    """
    if min(target.columns, target.rows) == 2 and np.any(markers.ids < target.marker_count):
        return Detection.nothing(
            f"the corners of a ChArUco board of {target.columns}x{target.rows} squares lie on one line, which fixes "
            "neither a pose nor a camera: use a board of three squares or more each way, or its markers as a bundle"
        )
    seen = size_seen(markers, target)
    if seen is not None and not _the_same(seen, target):
        return _another_size(seen, target)
    ids = np.unique(markers.ids)
    last = target.marker_count - 1
    size = f"{target.columns}x{target.rows}"
    if len(ids[ids > last]) >= _LEAST_OTHER_MARKERS:
        return Detection.nothing(
            f"markers of {target.dictionary} with ids up to {ids[-1]} seen, a board of {size} squares has 0..{last}; "
            "give the board's real size in squares",
            looks_like=f"a ChArUco board with ids up to {ids[-1]}",
            another=True,
        )
    on_board = int(np.count_nonzero(ids <= last))
    if on_board >= _LEAST_OTHER_MARKERS:
        return Detection.nothing(
            f"{on_board} markers of the board seen, but they do not lie as on a board of {size} squares, or too few "
            "corners between them are in the picture, or all on one line; check the size in squares and its order, "
            "columns x rows"
        )
    if on_board:
        return Detection.nothing(
            f"only {on_board} of the board's {last + 1} markers seen, two that touch the same corners are needed"
        )
    other = _other_dictionary(grey, target, quads)
    if other is not None:
        return Detection.nothing(
            f"markers of {other} seen, you asked for {target.dictionary}",
            looks_like=f"a ChArUco board with {other}",
            another=True,
        )
    return _chessboard_seen(grey, target) or Detection.nothing(f"no markers of {target.dictionary} seen")


def _chessboard_seen(grey: Grey, target: Charuco) -> Detection | None:
    """No points, where the image shows a board without markers."""
    from calibrant.detection.chessboard.detector import plain_board_seen  # not needed where the board is found

    if (shape := plain_board_seen(grey)) is None:
        return None
    spec = f"chessboard:{shape[0]}x{shape[1]}:{format_length(target.square)}"
    if sorted(shape) == sorted((target.columns - 1, target.rows - 1)):
        return Detection.nothing(
            f"corners of a board of {target.columns}x{target.rows} squares seen, but no marker between them: they are "
            f"too blurred, or it is a chessboard (use {spec})"
        )
    seen = f"a chessboard (use {spec})"
    return Detection.nothing(f"the image looks like {seen}, you asked for {target.spec}", looks_like=seen, another=True)


def another_board(target: Charuco, markers: Markers, explained: int) -> Detection | None:
    """No points, where the markers lie as on a board of another size, and more of them than on the one asked for.

    Args: explained: how many of the markers lie where the board asked for has them.
    """
    others = len(markers) - explained
    if others < _LEAST_OTHER_MARKERS or others <= OTHERS * explained:
        return None
    seen = size_seen(markers, target)
    if seen is None or (seen.columns, seen.rows) == (target.columns, target.rows):
        return None
    more = int(np.count_nonzero(agreeing_group(markers, seen))) > explained
    return _another_size(seen, target) if more else None


def _the_same(seen: Charuco, target: Charuco) -> bool:
    """Whether a board told by its markers alone is the one asked for, as well as these tell."""
    same = (seen.columns, seen.rows) == (target.columns, target.rows)
    return same and abs(seen.marker / target.marker - 1.0) < OTHER_MARKER


def _another_size(seen: Charuco, target: Charuco) -> Detection:
    """The size or the proportions that the picture shows, beside what was asked for."""
    size, asked = (f"{board.columns}x{board.rows}" for board in (seen, target))
    if size != asked:
        # Rows below the picture's edge cannot be counted; the markers' numbers tell the columns from any part.
        cut = seen.rows < target.rows
        looks_like = f"{seen.columns} columns of squares, {seen.rows} rows of them seen" if cut else f"{size} squares"
        return Detection.nothing(
            f"the image looks like {looks_like}, you asked for {asked}", looks_like=looks_like, another=True
        )
    marker, square = format_length(round(seen.marker, 4)), format_length(target.square)
    return Detection.nothing(
        f"its markers measure {marker} on squares of {square}, you asked for {format_length(target.marker)}",
        looks_like=f"{size} squares of {square} with markers of {marker}",
    )


def _other_dictionary(grey: Grey, target: Charuco, quads: Array) -> str | None:
    """The dictionary most of whose markers are in the picture, None without one, or where it is the target's."""
    seen = dictionary_seen(grey, quads)
    if seen is None or seen[0] == target.dictionary or target.dictionary in _members(seen[0]):
        return None
    return seen[0]


def dictionary_seen(grey: Grey, quads: Array) -> tuple[str, Markers] | None:
    """The dictionary most of whose markers are in the picture, the smallest that holds their ids, and they."""
    found = {name: read_codes(grey, quads, name) for name in _FAMILIES}
    counts = {name: len(np.unique(markers.ids)) for name, markers in found.items() if len(markers)}
    if not counts or max(counts.values()) < _LEAST_OTHER_MARKERS:
        return None
    family = max(counts, key=lambda name: counts[name])
    highest = int(found[family].ids.max())
    return next(name for name in _members(family) if DICTIONARIES[name].capacity > highest), found[family]


def _members(family: str) -> list[str]:
    """The dictionaries whose markers are all in a family's largest, smallest first."""
    stem = family.removesuffix("_1000")
    if stem == family:
        return [family]
    return [f"{stem}_{size}" for size in (50, 100, 250, 1000)]
