"""Grids of circles: in rows and columns, or in rows shifted by turns; with one dot of double size at the origin or not.

Numbering: row by row. symmetric: point row * columns + column at (column, row) * spacing. asymmetric: odd rows are
shifted to the right by half of the distance of two circles in a row; point row * columns + column at
(2 column + row mod 2, row) * spacing, so `spacing` is the distance between rows and half of that within a row (OpenCV's
convention). The origin is the centre of circle 0, where the big dot is if there is one.
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
from calibrant.targets.grid import parse_grid
from calibrant.targets.lengths import check_length, format_length, parse_length
from calibrant.targets.target import Artwork, Disc, Target

SYNTAX = (
    "circles:COLUMNSxROWS:SPACING[:asymmetric|:symmetric][:bigdot][:inverted][:dots=DIAMETER][:down=SPACING], such as "
    "circles:7x11:40mm:asymmetric"
)
BIG = 2.0
"""Diameter of the big dot over that of the others."""
DOT = 0.5
"""Diameter of the dots over the spacing, where the spec does not say: as much ink as paper between them, and a big dot
still stands free."""


MISREAD = {
    0.5: "the distance of two circles of one row",
    float(np.sqrt(0.5)): "the distance of a circle to the nearest, in the next row,",
    2.0: "half of the distance of two rows",
}
"""Distances that may be given for the spacing of shifted rows, by the spacing over them."""


@dataclass(frozen=True)
class Circles(Target):
    """A grid of `columns` x `rows` circles, `spacing` metres apart (see the module for asymmetric ones).

    asymmetric: odd rows are shifted; bigdot: the dot at the origin has twice the diameter; inverted: light dots on a
    dark ground; dots: diameter of a dot, metres, or None for half of the spacing. It matters for the print alone: a
    detector measures the dots. down: spacing of the rows, metres, where the print made it another than along them.
    """

    kind: ClassVar[str] = "circles"

    columns: int
    rows: int
    spacing: float
    asymmetric: bool = False
    bigdot: bool = False
    inverted: bool = False
    dots: float | None = None
    down: float | None = None

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise InputError(
                f"a grid of {self.columns}x{self.rows} circles cannot be told from other spots; give at least 3x3"
            )
        check_length(self.spacing, what="the spacing of the circles")
        if self.down is not None:
            check_length(self.down, what="the spacing of the rows of circles")
        if self.asymmetric and self.bigdot:
            raise InputError("an asymmetric grid of circles needs no big dot; leave out asymmetric or bigdot")
        if self.dots is None:
            return
        check_length(self.dots, what="the diameter of the dots")
        nearest = self.spacing * (np.sqrt(2.0) if self.asymmetric else 1.0)
        widest = self.dots * (0.5 + 0.5 * BIG if self.bigdot else 1.0)
        if widest >= nearest:
            raise InputError(
                f"dots of {format_length(self.dots)}{' with one of double size' if self.bigdot else ''} touch at a "
                f"distance of {format_length(nearest)}; give their diameter, not their spacing"
            )

    @property
    def diameter(self) -> float:
        """Of a dot, metres; of the small ones where one is big."""
        return DOT * self.spacing if self.dots is None else self.dots

    @cached_property
    def steps(self) -> NDArray[np.int64]:
        """(x, y) of each circle in units of the spacing, (n, 2)."""
        row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
        steps = np.column_stack([2 * column + row % 2 if self.asymmetric else column, row]).astype(np.int64)
        steps.setflags(write=False)
        return steps

    @cached_property
    def points(self) -> Array:
        """Centres of the circles, (columns * rows, 3) metres, row by row."""
        step = [self.spacing, self.spacing if self.down is None else self.down]
        points = np.column_stack([self.steps * step, np.zeros(len(self.steps))])
        points.setflags(write=False)
        return points

    @cached_property
    def point_ids(self) -> NDArray[np.int64]:
        """0 .. n - 1, row by row."""
        ids = np.arange(self.columns * self.rows, dtype=np.int64)
        ids.setflags(write=False)
        return ids

    @property
    def turns_unnoticed_deg(self) -> int | None:
        """The smallest turn after which the grid looks the same, degrees; None when there is none below 360.

        A big dot at a corner, or shifted rows of odd number, leave none. Else 180, and 90 for a square one.
        """
        if self.bigdot or (self.asymmetric and self.rows % 2):
            return None
        square = self.columns == self.rows and not self.asymmetric and self.down in (None, self.spacing)
        return 90 if square else 180

    @property
    def spec(self) -> str:
        """circles:COLUMNSxROWS:SPACING[:asymmetric][:bigdot][:inverted][:dots=DIAMETER][:down=SPACING]."""
        options = ["asymmetric"] * self.asymmetric + ["bigdot"] * self.bigdot + ["inverted"] * self.inverted
        dots = [] if self.dots is None else [f"dots={format_length(self.dots)}"]
        down = [] if self.down is None else [f"down={format_length(self.down)}"]
        return ":".join([self.kind, f"{self.columns}x{self.rows}", format_length(self.spacing), *options, *dots, *down])

    def artwork(self) -> Artwork:
        """The dots, with a quiet zone of one spacing around their centres' box."""
        radius, s = 0.5 * self.diameter, self.spacing
        ink = 1.0 if self.inverted else 0.0
        discs = tuple(
            Disc((float(x), float(y)), radius * (BIG if self.bigdot and i == 0 else 1.0), grey=ink)
            for i, (x, y) in enumerate(self.points[:, :2])
        )
        x1, y1 = self.points[:, :2].max(axis=0)
        # A big dot, or dots that nearly touch, reach beyond one spacing: the quiet zone lies outside of them.
        edge = s + max(0.0, radius * (BIG if self.bigdot else 1.0) - 0.5 * s)
        return Artwork((-edge, -edge, float(x1) + edge, float(y1) + edge), discs, background=1.0 - ink)

    def misread(self, factor: float, *, within: float) -> tuple[str, Circles] | None:
        """Which other distance of shifted rows stands for their spacing in the spec, and the grid that was meant.

        Args: factor: how many times as large as the spec the grid is; within: how far off that may be, as a part of it.
        Returns: None where the factor is none that a mistaken distance gives, and for straight rows.
        """
        if not self.asymmetric:
            return None
        ratio = min(MISREAD, key=lambda r: abs(factor / r - 1))
        if abs(factor / ratio - 1) > within:
            return None
        return MISREAD[ratio], self.scaled(ratio)

    def scaled(self, factor: float) -> Circles:
        """The same grid with spacing and dots times `factor`."""
        dots, down = (None if length is None else length * factor for length in (self.dots, self.down))
        return replace(self, spacing=self.spacing * factor, dots=dots, down=down)


def parse(fields: Sequence[str]) -> Circles:
    """Grid of a spec's fields after its kind. Raises: InputError for a field missing, unknown or impossible."""
    if len(fields) < 2:
        raise InputError(f"a grid of circles needs a size and a spacing: {SYNTAX}")
    size, spacing, *options = fields
    words = [word.strip().lower() for word in options]
    sizes = [word.removeprefix("dots=") for word in words if word.startswith("dots=")]
    downs = [word.removeprefix("down=") for word in words if word.startswith("down=")]
    known = ("asymmetric", "symmetric", "bigdot", "inverted")
    unknown = [word for word in words if word not in known and not word.startswith(("dots=", "down="))]
    if unknown:
        raise InputError(
            f"unknown option {unknown[0]!r} of a grid of circles; known options: {', '.join(known)}, dots=DIAMETER, "
            "down=SPACING of the rows"
        )
    if "asymmetric" in words and "symmetric" in words:
        raise InputError("a grid of circles is either symmetric or asymmetric; leave one out")
    columns, rows = parse_grid(size, what="the size of a grid of circles")
    return Circles(
        columns=columns,
        rows=rows,
        spacing=parse_length(spacing, what="the spacing of the circles"),
        asymmetric="asymmetric" in words,
        bigdot="bigdot" in words,
        inverted="inverted" in words,
        dots=parse_length(sizes[-1], what="the diameter of the dots") if sizes else None,
        down=parse_length(downs[-1], what="the spacing of the rows of circles") if downs else None,
    )
