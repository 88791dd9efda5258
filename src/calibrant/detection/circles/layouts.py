"""Which grid of circles a picture shows in place of the one asked for: of another size, or shifted rows or none."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibrant.detection.circles.lattice import Ints, Lattice
from calibrant.detection.detection import Detection
from calibrant.targets.circles import Circles

LEAST_LOOK = 12
"""Dots that a grid of another size needs to be called one in a message: 4x3."""
LEAST_LINES = 3
"""Columns and rows of a grid: fewer are a line of spots."""
FULL = 0.9
"""Of a layout's places that must show a dot, and of the dots that must be on it. Turned by 45 degrees, a whole grid of
one kind fills half of the other's."""
LINE = 0.5
"""Of the fullest line's dots: an outer line with fewer is not one of the grid's."""


@dataclass(frozen=True)
class Layout:
    """A grid seen: columns and rows, whether odd rows are shifted, whether its dots are light."""

    columns: int
    rows: int
    asymmetric: bool
    inverted: bool

    def is_like(self, target: Circles) -> bool:
        """Of the target's size, either way up."""
        return sorted((self.columns, self.rows)) == sorted((target.columns, target.rows))


def layouts_of(lattice: Lattice, *, inverted: bool) -> list[Layout]:
    """Those that a lattice fills: none or one, or two where shifted rows can be counted along both sides."""
    if len(lattice) < LEAST_LOOK:
        return []
    columns, rows, inside = _extent(lattice.cells)
    straight = _overlap(inside, columns * rows, len(lattice))
    # Shifted rows are every other place of the lattice turned by 45 degrees, see `placement.lattice_steps`.
    a, b = lattice.cells.T
    across, down, inside = _extent(np.stack([a + b, a - b], axis=1))
    shifted = _overlap(inside, across * down // 2, len(lattice))
    if max(straight, shifted) < FULL:
        return []
    if straight >= shifted:
        large = min(columns, rows) >= LEAST_LINES
        return [Layout(columns, rows, asymmetric=False, inverted=inverted)] if large else []
    return [
        Layout(places // 2, lines, asymmetric=True, inverted=inverted)
        for places, lines in ((across, down), (down, across))
        if places % 2 == 0 and min(places // 2, lines) >= LEAST_LINES
    ]


def is_other_kind(seen: list[Layout], target: Circles) -> bool:
    """Whether a whole grid of the target's size was seen whose rows are shifted where the target's are not, or not."""
    return any(s.asymmetric != target.asymmetric and s.is_like(target) for s in seen)


def why_not_found(seen: list[Layout], target: Circles) -> Detection:
    """The reason, by the largest grid seen; of equal ones by the one most like that asked for."""
    asked = f"{target.columns}x{target.rows}"
    if not seen:
        return Detection.nothing(f"no grid of {asked} circles was found")
    best = max(seen, key=lambda s: (s.columns * s.rows, s.is_like(target), s.rows))
    if best.asymmetric or target.asymmetric:
        return _of_shifted_rows(best, target)
    columns, rows = best.columns, best.rows
    if (rows > columns) != (target.rows > target.columns):
        rows, columns = columns, rows
    if (columns, rows) == (target.columns, target.rows):
        return _untold()
    size = f"{columns}x{rows} circles"
    # Fewer dots each way may be a part of the grid, whose others are hidden.
    another = columns > target.columns or rows > target.rows
    return Detection.nothing(f"the image looks like {size}, you asked for {asked}", looks_like=size, another=another)


def _of_shifted_rows(best: Layout, target: Circles) -> Detection:
    if best.asymmetric == target.asymmetric and (best.columns, best.rows) == (target.columns, target.rows):
        return _untold()
    columns, rows = best.columns, best.rows
    if not best.asymmetric and best.is_like(target):
        columns, rows = target.columns, target.rows
    looks = replace(
        target,
        columns=columns,
        rows=rows,
        asymmetric=best.asymmetric,
        inverted=best.inverted,
        bigdot=target.bigdot and not best.asymmetric,
        dots=None,
    ).spec
    another = best.asymmetric != target.asymmetric or columns > target.columns or rows > target.rows
    shift = "odd rows are shifted" if best.asymmetric else "no row is shifted"
    return Detection.nothing(
        f"the image looks like {looks} ({shift}), you asked for {target.spec}", looks_like=looks, another=another
    )


def _untold() -> Detection:
    return Detection.nothing(
        "a grid of circles was seen, but which dot is which cannot be told: show its origin, or all of its sides"
    )


def _overlap(inside: int, places: int, dots: int) -> float:
    """Of a layout's places the part with a dot, or of the dots the part on it: the lesser."""
    return min(inside / places, inside / dots) if places else 0.0


def _extent(cells: Ints) -> tuple[int, int, int]:
    """Columns and rows from the first to the last that is a line, and the dots between them."""
    (left, right), (top, bottom) = (_lines(c) for c in cells.T)
    x, y = cells.T
    inside = np.count_nonzero((x >= left) & (x <= right) & (y >= top) & (y <= bottom))
    return right - left + 1, bottom - top + 1, int(inside)


def _lines(places: Ints) -> tuple[int, int]:
    low = int(places.min())
    counts = np.bincount(places - low)
    kept = np.flatnonzero(counts >= LINE * counts.max())
    return low + int(kept[0]), low + int(kept[-1])
