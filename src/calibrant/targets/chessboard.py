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
from calibrant.targets.target import Artwork, Polygon, Target


@dataclass(frozen=True)
class Chessboard(Target):
    """A chessboard of `columns` x `rows` inner corners with squares of `square` metres."""

    columns: int
    rows: int
    square: float
    kind: ClassVar[str] = "chessboard"

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise InputError(
                f"a chessboard of {self.columns}x{self.rows} inner corners cannot be told from other patterns; "
                "count the corners where dark squares meet inside the board: at least 3x3"
            )
        if not (np.isfinite(self.square) and self.square > 0):
            raise InputError(f"the squares of a chessboard must be larger than 0 m, got {self.square} m")

    @property
    def points(self) -> Array:
        """Inner corners (columns * rows, 3), row by row, metres."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return self.square * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1).astype(np.float64)

    @property
    def point_ids(self) -> NDArray[np.int64]:
        return np.arange(self.columns * self.rows, dtype=np.int64)

    @property
    def spec(self) -> str:
        return f"chessboard:{self.columns}x{self.rows}:{1e3 * self.square:.10g}mm"

    @property
    def turns_unnoticed_deg(self) -> int | None:
        """The smallest turn after which the board looks the same, degrees; None when there is none below 360.

        One even and one odd count: None. Equal parity: 180, and 90 for a square board of even count.
        """
        if (self.columns + self.rows) % 2:
            return None
        return 90 if self.columns == self.rows and self.columns % 2 == 0 else 180

    def artwork(self) -> Artwork:
        """The squares on white paper, with a quiet zone one square wide."""
        s = self.square
        dark = tuple(
            Polygon(((s * i, s * j), (s * (i + 1), s * j), (s * (i + 1), s * (j + 1)), (s * i, s * (j + 1))))
            for j in range(-1, self.rows)
            for i in range(-1, self.columns)
            if (i + j) % 2 == 0
        )
        return Artwork((-2 * s, -2 * s, s * (self.columns + 1), s * (self.rows + 1)), dark)

    def scaled(self, factor: float) -> Chessboard:
        return replace(self, square=self.square * factor)
