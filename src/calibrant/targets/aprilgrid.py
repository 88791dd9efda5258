"""AprilGrid: tags in rows and columns with small squares at their corners, in Kalibr's layout and numbering.

Seen upright, tag 0 is at the lower left and tags count to the right and then upwards; each tag has a black border two
cells wide, and a black square of the gap's size at each of its corners, so that at every corner two dark squares meet.
Points count the corners from tag 0's lower left one, to the right along a row of 2 columns corners, then upwards.

Frame: origin at point 0, x to the right, y down, z into the board, so all points have y <= 0. Kalibr has y up and z out
of the board: p_kalibr = (x, -y, -z).

Upright, the tags' codes run from the upper left as AprilTag's authors print them; OpenCV draws them turned by 180
degrees, so its first corner is the lower right one.
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

SYNTAX = (
    "aprilgrid:COLUMNSxROWS:TAG:SPACING:FAMILY[:border=1] with the spacing as a part of the tag, such as "
    "aprilgrid:6x6:88mm:0.3:36h11"
)
KALIBR_BORDER = 2
TURNS = 2
"""Quarter turns between AprilTag's upright and OpenCV's."""


@dataclass(frozen=True)
class AprilGrid(Target):
    """A grid of `columns` x `rows` tags of side `tag` metres, `spacing` * tag apart.

    dictionary: the tags' family; border: width of the black border, cells (2 in Kalibr's print, 1 in others).
    """

    kind: ClassVar[str] = "aprilgrid"

    columns: int
    rows: int
    tag: float
    spacing: float
    dictionary: str
    border: int = KALIBR_BORDER

    def __post_init__(self) -> None:
        if self.columns < 1 or self.rows < 1:
            raise InputError(f"an AprilGrid needs at least one tag, got {self.columns}x{self.rows}")
        check_length(self.tag, what="the tag's side")
        if not 0.0 < self.spacing < 1.0:
            raise InputError(
                f"the spacing of an AprilGrid is the gap between tags over a tag's side, above 0 and below 1; got "
                f"{self.spacing:g}"
            )
        if self.border not in (1, 2):
            raise InputError(f"the border of the tags is 1 or 2 cells wide, got {self.border}")
        object.__setattr__(self, "dictionary", board_dictionary(self.dictionary, kind="an AprilGrid"))
        capacity = DICTIONARIES[self.dictionary].capacity
        if self.columns * self.rows > capacity:
            raise InputError(
                f"a grid of {self.columns}x{self.rows} tags needs {self.columns * self.rows} ids, {self.dictionary} "
                f"has only {capacity}"
            )

    @property
    def pitch(self) -> float:
        """Distance from tag to tag, metres."""
        return self.tag * (1.0 + self.spacing)

    @cached_property
    def tag_points(self) -> NDArray[np.int64]:
        """Point ids of each tag's corners, (tags, 4): upper left, upper right, lower right, lower left."""
        row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
        width = 2 * self.columns
        lower_left = 2 * row * width + 2 * column
        ids = np.stack([lower_left + width, lower_left + width + 1, lower_left + 1, lower_left], axis=1)
        ids.setflags(write=False)
        return ids.astype(np.int64)

    @cached_property
    def points(self) -> Array:
        """Corners of the tags, (4 columns rows, 3) metres, in the order of the labels."""
        row, column = np.divmod(np.arange(4 * self.columns * self.rows), 2 * self.columns)
        x = column // 2 * self.pitch + column % 2 * self.tag
        y = row // 2 * self.pitch + row % 2 * self.tag
        points = np.column_stack([x, -y, np.zeros(len(x))])
        points.setflags(write=False)
        return points

    @cached_property
    def point_ids(self) -> NDArray[np.int64]:
        """0 .. n - 1, from the lower left, row by row upwards."""
        ids = np.arange(4 * self.columns * self.rows, dtype=np.int64)
        ids.setflags(write=False)
        return ids

    @property
    def spec(self) -> str:
        """aprilgrid:COLUMNSxROWS:TAG:SPACING:DICTIONARY[:border=1]."""
        size, tag = f"{self.columns}x{self.rows}", format_length(self.tag)
        border = [] if self.border == KALIBR_BORDER else [f"border={self.border}"]
        return ":".join([self.kind, size, tag, repr(float(self.spacing)), self.dictionary, *border])

    def artwork(self) -> Artwork:
        """The tags and the squares at their corners, with a quiet zone of one gap around."""
        gap = self.spacing * self.tag
        shapes: list[Polygon | MarkerArt] = []
        # Neighbouring tags share squares, which are drawn once: ink laid twice on a partly covered cell would widen it.
        drawn: set[tuple[int, int]] = set()
        inner = self.tag * (1.0 - 2.0 * (self.border - 1) / (self.bits + 2 * self.border))
        for i, corners in enumerate(self.points[self.tag_points, :2]):
            x, y = (float(c) for c in corners[0])
            shapes.append(_square(x, y, self.tag))
            inset = 0.5 * (self.tag - inner)
            shapes.append(MarkerArt(self.dictionary, i, (x + inset, y + inset), inner, quarter_turns=TURNS))
            row, column = divmod(i, self.columns)
            for right, down in ((0, 0), (1, 0), (1, 1), (0, 1)):
                place = (column + right, row - down)
                if place in drawn:
                    continue
                drawn.add(place)
                left, top = x + right * (self.tag + gap) - gap, y + down * (self.tag + gap) - gap
                shapes.append(_square(left, top, gap))
        x1, y0 = float(self.points[:, 0].max()), float(self.points[:, 1].min())
        return Artwork((-2 * gap, y0 - 2 * gap, x1 + 2 * gap, 2 * gap), tuple(shapes))

    @property
    def bits(self) -> int:
        """Cells along a tag's side without its border."""
        return DICTIONARIES[self.dictionary].bits

    def scaled(self, factor: float) -> AprilGrid:
        """The same grid with tags times `factor`."""
        return replace(self, tag=self.tag * factor)


def _square(x: float, y: float, side: float) -> Polygon:
    return Polygon(((x, y), (x + side, y), (x + side, y + side), (x, y + side)))


def parse(fields: Sequence[str]) -> AprilGrid:
    """Grid of a spec's fields after its kind. Raises: InputError for a field missing, unknown or impossible."""
    if len(fields) < 4:
        raise InputError(f"an AprilGrid needs a size, the tag's side, the spacing and the family: {SYNTAX}")
    size, tag, spacing, family, *options = fields
    columns, rows = parse_grid(size, what="the size of an AprilGrid in tags")
    try:
        ratio = float(spacing)
    except ValueError:
        raise InputError(
            f"the spacing of an AprilGrid is the gap between tags over a tag's side, such as 0.3; got {spacing!r}"
        ) from None
    border = KALIBR_BORDER
    for option in (o.strip().lower() for o in options):
        if option not in ("border=1", "border=2"):
            raise InputError(f"unknown option {option!r} of an AprilGrid; known options: border=1, border=2")
        border = int(option[-1])
    return AprilGrid(columns, rows, parse_length(tag, what="the tag's side"), ratio, family, border)
