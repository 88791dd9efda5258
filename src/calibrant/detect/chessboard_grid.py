"""From links between corners to whole grids: rows and columns of corners, holes filled, every side grown to its end.

A grid is held as an array (rows, columns, 2) of pixels, NaN where no corner is known, whose first axis turns into the
second like the picture's y follows its x, so that a grid is never mirrored. `dark` says whether the square between
cell (0, 0) and its neighbours to the right and below is dark.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.detect.chessboard_corners import Corners
from calibrant.detect.chessboard_snap import drop_misfits, snap

Array = NDArray[np.float64]
Cells = dict[tuple[int, int], int]
Turns = dict[int, int]

LEAST_FILL = 0.5
"""Of a side's outermost line, how much must be seen for it to be part of the board and not an accident beside it."""


@dataclass(frozen=True, eq=False)
class Grid:
    """xy (rows, columns, 2) pixels, NaN where unknown; dark: colour of the square right of and below corner (0, 0);
    contrast: half the difference of dark and light over their mean, typical of its corners;
    goes_on: whether corners lie beyond its sides, on lines of which too little is seen to count them."""

    xy: Array
    dark: bool
    contrast: float
    goes_on: bool = False

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.xy.shape[0], self.xy.shape[1]

    @property
    def area(self) -> float:
        """Of the upright rectangle around the known corners, square pixels."""
        known = self.xy[self.known]
        return float(np.prod(np.ptp(known, axis=0))) if len(known) else 0.0

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which corners (rows, columns) are known."""
        return ~np.isnan(self.xy[..., 0])


def grow_grids(corners: Corners, links: NDArray[np.int32], *, least: int, most: int = 2) -> Iterator[Grid]:
    """The `most` grids with the most linked corners, at least `least`, each grown as far as the picture shows it.

    The one that covers most of the picture comes first; each is grown when it is asked for.
    """
    components = sorted(_components(links, least=least), key=lambda c: -len(c[0]))[:most]
    grids = [_as_grid(cells, turns, corners) for cells, turns in components]
    for grid in sorted(grids, key=lambda g: -g.area):
        yield _complete(grid, corners)


def _components(links: NDArray[np.int32], *, least: int) -> list[tuple[Cells, Turns]]:
    # A corner of a grid has neighbours in directions that cross; chains of links along a line are no grid.
    count = (links >= 0).sum(axis=1)
    table = links.tolist()
    seen: set[int] = set()
    components = []
    for seed in np.flatnonzero(count >= 3).tolist():
        if seed in seen:
            continue
        cells, turns = _walk(seed, table)
        seen.update(turns)
        if len(cells) >= least:
            components.append((cells, turns))
    return components


def _walk(seed: int, links: list[list[int]]) -> tuple[Cells, Turns]:
    """Corner at each (row, column), and the turn of each: its port p points in direction (p + turn) % 4.

    Directions are right, down, left, up. A link that contradicts the cells already known is left out.
    """
    steps = ((0, 1), (1, 0), (0, -1), (-1, 0))
    cells, place, turns = {(0, 0): seed}, {seed: (0, 0)}, {seed: 0}
    queue = deque([seed])
    while queue:
        corner = queue.popleft()
        row, column = place[corner]
        for port, link in enumerate(links[corner]):
            if link < 0:
                continue
            other, back = divmod(link, 4)
            direction = (port + turns[corner]) % 4
            cell = (row + steps[direction][0], column + steps[direction][1])
            if other in place or cell in cells:
                continue
            cells[cell], place[other] = other, cell
            turns[other] = (direction + 2 - back) % 4
            queue.append(other)
    return cells, turns


def _as_grid(cells: Cells, turns: Turns, corners: Corners) -> Grid:
    at = np.array(list(cells))
    index = np.array(list(cells.values()))
    at -= at.min(axis=0)
    xy = np.full((*(at.max(axis=0) + 1), 2), np.nan)
    xy[at[:, 0], at[:, 1]] = corners.xy[index]
    # Between ports 0 and 1 it is dark: right and below of a corner whose turn is even. Neighbours alternate.
    dark = (at.sum(axis=1) + np.array([turns[i] for i in index])) % 2 == 0
    # At a corner's centre the picture has the mean of dark and light.
    column, row = np.rint(corners.xy[index]).astype(int).T
    contrast = corners.contrast[index] / np.maximum(corners.smooth[row, column], 1.0)
    return Grid(xy, bool(dark.mean() > 0.5), float(np.median(contrast)))


def _complete(grid: Grid, corners: Corners) -> Grid:
    """The grid with its stray lines cut, its holes filled and its sides grown, as far as saddles are found."""
    pool = np.concatenate([corners.xy, corners.weak])
    drop_misfits(grid.xy, grid.dark, grid.contrast, corners.smooth)
    grid = _fill(_trim(grid), corners, pool)
    scraps = 0
    for _ in range(4):
        for _ in range(MOST_LINES):
            grown, seen = _one_column_more(grid, corners, pool)
            if seen < LEAST_FILL * grid.shape[0]:
                scraps += seen
                break
            grid = grown
        grid = turned(grid)
    whole = _fill(grid, corners, pool)
    grid = _trim(whole)
    # Where nothing was left over, nothing lies beyond.
    doubtful = scraps >= 2 or grid.shape != whole.shape
    return replace(grid, goes_on=doubtful and _goes_on(grid, corners))


def _goes_on(grid: Grid, corners: Corners) -> bool:
    # Only saddles that are corners from all sides: the outline of a board has bends. One may still fit by chance.
    for _ in range(4):
        if _one_column_more(grid, corners, corners.xy)[1] >= 2:
            return True
        grid = turned(grid)
    return False


MOST_LINES = 40
"""A side grows by at most so many lines; keeps pictures of endless tiles finite."""


def turned(grid: Grid) -> Grid:
    """The same grid turned by 90 degrees: its last column becomes the first row."""
    columns = grid.shape[1]
    # Square right of and below the new (0, 0) is left of and below the old (0, columns - 1): `columns - 2` squares on.
    return Grid(np.rot90(grid.xy), grid.dark ^ (columns % 2 == 1), grid.contrast)


def _trim(grid: Grid) -> Grid:
    """Without outer lines of which too little is seen."""
    while min(grid.shape) > 1:
        known = grid.known
        sides = {
            "top": known[0].mean(),
            "bottom": known[-1].mean(),
            "left": known[:, 0].mean(),
            "right": known[:, -1].mean(),
        }
        side = min(sides, key=lambda s: sides[s])
        if sides[side] >= LEAST_FILL:
            break
        if side == "top":
            grid = Grid(grid.xy[1:], not grid.dark, grid.contrast)
        elif side == "bottom":
            grid = Grid(grid.xy[:-1], grid.dark, grid.contrast)
        elif side == "left":
            grid = Grid(grid.xy[:, 1:], not grid.dark, grid.contrast)
        else:
            grid = Grid(grid.xy[:, :-1], grid.dark, grid.contrast)
    return grid


def _fill(grid: Grid, corners: Corners, pool: Array) -> Grid:
    """With the holes filled where a saddle lies at the predicted place."""
    xy = np.ascontiguousarray(grid.xy).copy()
    # Each round reaches one corner further into a hole.
    for _ in range(sum(grid.shape)):
        missing = np.isnan(xy[..., 0])
        if not missing.any() or not snap(xy, missing, grid.dark, grid.contrast, corners.smooth, pool):
            break
    return Grid(xy, grid.dark, grid.contrast)


def _one_column_more(grid: Grid, corners: Corners, pool: Array) -> tuple[Grid, int]:
    """With one more column on the right, and how many of its corners the picture shows."""
    rows, columns = grid.shape
    xy = np.full((rows, columns + 1, 2), np.nan)
    xy[:, :-1] = grid.xy
    wanted = np.zeros((rows, columns + 1), np.bool_)
    wanted[:, -1] = True
    seen = snap(xy, wanted, grid.dark, grid.contrast, corners.smooth, pool)
    return Grid(xy, grid.dark, grid.contrast), int(seen)
