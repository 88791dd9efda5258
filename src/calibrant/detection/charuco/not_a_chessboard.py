"""A ChArUco board that was asked for as a chessboard: named, with the spec that says what it is.

Its inner corners are those of a chessboard, and where their number is the one asked for they are measured as such; but
markers say which corner is which, in every view and in parts of the board, and a chessboard's spec does without them.
"""

from __future__ import annotations

from dataclasses import replace

from calibrant.arrays import Grey
from calibrant.detection.charuco.detector import COARSE_SIDE_PX
from calibrant.detection.charuco.reasons import dictionary_seen
from calibrant.detection.charuco.size import size_seen
from calibrant.detection.detection import Detection
from calibrant.detection.tags.search import efforts, find_quads_at
from calibrant.errors import InputError
from calibrant.targets.charuco import Charuco
from calibrant.targets.chessboard import Chessboard
from calibrant.targets.lengths import format_length
from calibrant.targets.target import Target


def named(grey: Grey, target: Target, detection: Detection) -> Detection:
    """What the chessboard's detector said of a grey image (h, w), and of a ChArUco board what it is.

    Raises: InputError when the target is not a chessboard.
    """
    if not isinstance(target, Chessboard):
        raise InputError(f"a chessboard was looked for, not a target of kind {target.kind!r}")
    board = charuco_seen(grey, target.square)
    if board is None:
        return detection
    if detection.found:
        note = f"The light squares hold markers: as {board} its corners are told apart in any view, and in parts of it."
        return replace(detection, notes=(*detection.notes, note))
    seen = f"a ChArUco board (use {board})"
    return Detection.nothing(f"the image looks like {seen}, you asked for {target.spec}", looks_like=seen, another=True)


def charuco_seen(grey: Grey, square: float) -> str | None:
    """The spec of the ChArUco board that a grey image shows, the markers' side open; None where it shows none.

    Args: square, the side of its squares, metres, which no picture tells.
    """
    for effort in efforts(grey.shape, COARSE_SIDE_PX)[:-1]:  # not the faintest: this is asked of every miss
        seen = dictionary_seen(grey, find_quads_at(grey, effort))
        board = None if seen is None else size_seen(seen[1], Charuco(2, 2, square, 0.5 * square, seen[0]))
        if board is not None:
            return f"charuco:{board.columns}x{board.rows}:{format_length(square)}:MARKER:{board.dictionary}"
    return None
