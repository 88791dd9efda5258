"""ChArUco board: a chessboard whose white squares hold markers, so every corner is known even when part is hidden.

Frame: origin at the outer corner of the top left square, x along the rows, y down the columns, z into the board. Points
are the inner corners, row by row; ids and coordinates are those of OpenCV's CharucoBoard.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.targets.apriltag3 import board_dictionary
from calibrant.targets.dictionaries import DICTIONARIES
from calibrant.targets.grid import parse_grid
from calibrant.targets.lengths import check_length, format_length, parse_length
from calibrant.targets.target import Artwork, MarkerArt, Polygon, Target

SYNTAX = "charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY[:legacy][:inverted], such as charuco:5x7:40mm:20mm:DICT_6X6_250"


@dataclass(frozen=True)
class Charuco(Target):
    """A ChArUco board of columns x rows squares; square and marker are the sides of its squares and markers, metres.

    legacy: the layout of OpenCV before 4.6; it differs for an even number of rows: the top left square holds a marker.
    inverted: printed as a negative, with black for white.
    """

    kind: ClassVar[str] = "charuco"

    columns: int
    rows: int
    square: float
    marker: float
    dictionary: str
    legacy: bool = False
    inverted: bool = False

    def __post_init__(self) -> None:
        if self.columns < 2 or self.rows < 2:
            raise InputError(
                f"a ChArUco board needs at least 2x2 squares to have an inner corner, got {self.columns}x{self.rows}"
            )
        check_length(self.square, what="the square's side")
        check_length(self.marker, what="the marker's side")
        if self.marker >= self.square:
            raise InputError(
                f"the marker ({format_length(self.marker)}) must be smaller than the square "
                f"({format_length(self.square)}); the order is charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY"
            )
        object.__setattr__(self, "dictionary", board_dictionary(self.dictionary, kind="a ChArUco board"))
        capacity = DICTIONARIES[self.dictionary].capacity
        if self.marker_count > capacity:
            raise InputError(
                f"a board of {self.columns}x{self.rows} squares needs {self.marker_count} markers, {self.dictionary} "
                f"has only {capacity}; take a larger dictionary or fewer squares"
            )

    @property
    def marker_count(self) -> int:
        """How many markers the board holds; their ids are 0 .. marker_count - 1, row by row."""
        squares = self.columns * self.rows
        return (squares + 1) // 2 if self._top_left_holds_marker else squares // 2

    @property
    def _top_left_holds_marker(self) -> bool:
        return self.legacy and self.rows % 2 == 0

    @cached_property
    def marker_squares(self) -> NDArray[np.int64]:
        """(column, row) of the square of each marker, (marker_count, 2), in the order of their ids."""
        row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
        holds = (row + column) % 2 == (0 if self._top_left_holds_marker else 1)
        squares = np.column_stack([column, row])[holds].astype(np.int64)
        squares.setflags(write=False)
        return squares

    @cached_property
    def marker_corners(self) -> Array:
        """Corners of each marker, (marker_count, 4, 2) metres: top left, top right, bottom right, bottom left."""
        top_left = self.marker_squares * self.square + 0.5 * (self.square - self.marker)
        offsets = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * self.marker
        corners = top_left[:, None, :] + offsets
        corners.setflags(write=False)
        return corners

    @cached_property
    def points(self) -> Array:
        """Inner corners, ((columns - 1) * (rows - 1), 3) metres, row by row."""
        row, column = np.divmod(np.arange((self.columns - 1) * (self.rows - 1)), self.columns - 1)
        points = np.column_stack([(column + 1) * self.square, (row + 1) * self.square, np.zeros(len(row))])
        points.setflags(write=False)
        return points

    @cached_property
    def point_ids(self) -> NDArray[np.int64]:
        """0 .. n - 1, row by row."""
        ids = np.arange((self.columns - 1) * (self.rows - 1), dtype=np.int64)
        ids.setflags(write=False)
        return ids

    @property
    def spec(self) -> str:
        """charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY[:legacy][:inverted]."""
        fields = [
            self.kind,
            f"{self.columns}x{self.rows}",
            format_length(self.square),
            format_length(self.marker),
            self.dictionary,
        ]
        return ":".join(fields + ["legacy"] * self.legacy + ["inverted"] * self.inverted)

    def artwork(self) -> Artwork:
        """Squares and markers, with half a square of quiet zone around.

        A negative is printed on a dark ground, as its markers' borders are light and must end somewhere.
        """
        ink, s = (1.0 if self.inverted else 0.0), self.square
        marked = {(int(c), int(r)) for c, r in self.marker_squares}
        squares = tuple(
            Polygon(((c * s, r * s), ((c + 1) * s, r * s), ((c + 1) * s, (r + 1) * s), (c * s, (r + 1) * s)), grey=ink)
            for r in range(self.rows)
            for c in range(self.columns)
            if (c, r) not in marked
        )
        markers = tuple(
            MarkerArt(self.dictionary, i, (float(x), float(y)), self.marker, inverted=self.inverted)
            for i, (x, y) in enumerate(self.marker_corners[:, 0])
        )
        bounds = (-0.5 * s, -0.5 * s, (self.columns + 0.5) * s, (self.rows + 0.5) * s)
        return Artwork(bounds=bounds, shapes=squares + markers, background=1.0 - ink)

    def scaled(self, factor: float) -> Charuco:
        """The same board with square and marker times `factor`."""
        return replace(self, square=self.square * factor, marker=self.marker * factor)


def parse(fields: Sequence[str]) -> Charuco:
    """Board of a spec's fields after its kind. Raises: InputError for a field missing, unknown or impossible."""
    if len(fields) < 4:
        raise InputError(f"a ChArUco spec needs a size, two lengths and a dictionary: {SYNTAX}")
    size, square, marker, dictionary, *options = fields
    words = [word.strip().lower() for word in options]
    unknown = [word for word in words if word not in ("legacy", "inverted")]
    if unknown:
        raise InputError(f"unknown option {unknown[0]!r} of a ChArUco board; known options: legacy, inverted")
    columns, rows = parse_grid(size, what="a ChArUco board's size in squares")
    return Charuco(
        columns=columns,
        rows=rows,
        square=parse_length(square, what="the square's side"),
        marker=parse_length(marker, what="the marker's side"),
        dictionary=dictionary,
        legacy="legacy" in words,
        inverted="inverted" in words,
    )
