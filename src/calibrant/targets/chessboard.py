"""Plain chessboard: its points are the inner corners, where two dark squares meet.

Numbering: point i = row * columns + column. The target's origin is inner corner 0, and the board's outermost square
diagonally behind it (towards -x, -y) is dark. With one even and one odd count that makes the numbering unique; with
equal parity the board looks the same turned by 180 degrees (and a square one of even count by 90 degrees).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.targets.lengths import check_length
from calibrant.targets.target import Artwork, Polygon, Target


@dataclass(frozen=True)
class Chessboard(Target):
    """A chessboard of `columns` x `rows` inner corners with squares of `square` metres.

    height: of the squares down the rows, metres, where the print made rectangles of them; None for squares.
    """

    columns: int
    rows: int
    square: float
    height: float | None = None
    kind: ClassVar[str] = "chessboard"

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise InputError(
                f"a chessboard of {self.columns}x{self.rows} inner corners cannot be told from other patterns; "
                "count the corners where dark squares meet inside the board: at least 3x3"
            )
        if not (np.isfinite(self.square) and self.square > 0):
            raise InputError(f"the squares of a chessboard must be larger than 0 m, got {self.square} m")
        if self.height is not None:
            check_length(self.height, what="the height of a chessboard's squares")

    @property
    def sides(self) -> tuple[float, float]:
        """Width and height of a square, metres."""
        return self.square, self.square if self.height is None else self.height

    @property
    def points(self) -> Array:
        """Inner corners (columns * rows, 3), row by row, metres."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        steps = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1).astype(np.float64)
        return steps * [*self.sides, 1.0]

    @property
    def point_ids(self) -> NDArray[np.int64]:
        return np.arange(self.columns * self.rows, dtype=np.int64)

    @property
    def spec(self) -> str:
        lengths = [self.square] if self.height is None else [self.square, self.height]
        return ":".join([self.kind, f"{self.columns}x{self.rows}", *(f"{1e3 * length:.10g}mm" for length in lengths)])

    @property
    def turns_unnoticed_deg(self) -> int | None:
        """The smallest turn after which the board looks the same, degrees; None when there is none below 360.

        One even and one odd count: None. Equal parity: 180, and 90 for a square board of even count.
        """
        if (self.columns + self.rows) % 2:
            return None
        width, height = self.sides
        return 90 if self.columns == self.rows and self.columns % 2 == 0 and width == height else 180

    def artwork(self) -> Artwork:
        """The squares on white paper, with a quiet zone one square wide."""
        w, h = self.sides
        dark = tuple(
            Polygon(((w * i, h * j), (w * (i + 1), h * j), (w * (i + 1), h * (j + 1)), (w * i, h * (j + 1))))
            for j in range(-1, self.rows)
            for i in range(-1, self.columns)
            if (i + j) % 2 == 0
        )
        return Artwork((-2 * w, -2 * h, w * (self.columns + 1), h * (self.rows + 1)), dark)

    def scaled(self, factor: float) -> Chessboard:
        height = None if self.height is None else self.height * factor
        return replace(self, square=self.square * factor, height=height)
