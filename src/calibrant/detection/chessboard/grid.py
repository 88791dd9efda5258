"""From links between corners to whole grids: rows and columns of corners, holes filled, every side grown to its end.

A grid is held as an array (rows, columns, 2) of pixels, NaN where no corner is known, whose first axis turns into the
second like the picture's y follows its x, so that a grid is never mirrored. `dark` says whether the square between
cell (0, 0) and its neighbours to the right and below is dark.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.compiled import compiled
from calibrant.detection.chessboard.candidates import Corners
from calibrant.detection.chessboard.snap import by_rows, drop_misfits, snap

Pool = tuple[Array, NDArray[np.int64]]
"""Saddles, and where each row of the image begins among them (`by_rows`)."""
Walk = NDArray[np.int64]
"""Corner, row, column and turn of each corner of a grid (n, 4): its port p points in direction (p + turn) % 4.
Directions are right, down, left, up."""

FURTHEST = 100
"""Lines that a set of linked corners may reach from where it began: more than any board has."""
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
    walks = sorted(_walks(links, least=least), key=lambda walk: -len(walk))[:most]
    grids = [_as_grid(walk, corners) for walk in walks]
    for grid in sorted(grids, key=lambda g: -g.area):
        yield _complete(grid, corners)


def _walks(links: NDArray[np.int32], *, least: int) -> list[Walk]:
    """Sets of at least so many linked corners, each with its place in the set's own rows and columns."""
    # A corner of a grid has neighbours in directions that cross; chains of links along a line are no grid.
    count = (links >= 0).sum(axis=1)
    seen = np.zeros(len(links), np.bool_)
    taken = np.full((2 * FURTHEST + 1, 2 * FURTHEST + 1), -1, np.int64)
    walks = []
    for seed in np.flatnonzero(count >= 3):
        if not seen[seed]:
            walk = _walk(seed, links, seen, taken)
            if len(walk) >= least:
                walks.append(walk)
    return walks


@compiled("int64[:, ::1](int64, int32[:, ::1], boolean[::1], int64[:, ::1])")
def _walk(seed, links, seen, taken):  # type: ignore[no-untyped-def]
    """All corners linked to one; a link that contradicts the places already known is left out.

    Sets `seen` of them; taken: all -1, and again so afterwards.
    """
    walk = np.empty((len(links), 4), np.int64)
    known = np.empty(len(links), np.int64)
    for k in range(len(links)):
        known[k] = 0
    walk[0, 0], walk[0, 1], walk[0, 2], walk[0, 3] = seed, 0, 0, 0
    taken[FURTHEST, FURTHEST] = seed
    known[seed] = 1
    count, done = 1, 0
    while done < count:
        corner, row, column, turn = walk[done, 0], walk[done, 1], walk[done, 2], walk[done, 3]
        done += 1
        for port in range(4):
            link = links[corner, port]
            if link < 0:
                continue
            other, back = link // 4, link % 4
            direction = (port + turn) % 4
            r = row + (1 if direction == 1 else -1 if direction == 3 else 0)
            c = column + (1 if direction == 0 else -1 if direction == 2 else 0)
            if known[other] > 0 or max(abs(r), abs(c)) > FURTHEST or taken[r + FURTHEST, c + FURTHEST] >= 0:
                continue
            known[other], taken[r + FURTHEST, c + FURTHEST] = 1, other
            walk[count, 0], walk[count, 1], walk[count, 2], walk[count, 3] = other, r, c, (direction + 2 - back) % 4
            count += 1
    for k in range(count):
        seen[walk[k, 0]] = True
        taken[walk[k, 1] + FURTHEST, walk[k, 2] + FURTHEST] = -1
    return walk[:count]


def _as_grid(walk: Walk, corners: Corners) -> Grid:
    index, at, turn = walk[:, 0], walk[:, 1:3] - walk[:, 1:3].min(axis=0), walk[:, 3]
    xy = np.full((*(at.max(axis=0) + 1), 2), np.nan)
    xy[at[:, 0], at[:, 1]] = corners.xy[index]
    # Between ports 0 and 1 it is dark: right and below of a corner whose turn is even. Neighbours alternate.
    dark = (at.sum(axis=1) + turn) % 2 == 0
    # At a corner's centre the picture has the mean of dark and light.
    column, row = np.rint(corners.xy[index]).astype(int).T
    contrast = corners.contrast[index] / np.maximum(corners.smooth[row, column], 1.0)
    return Grid(xy, bool(dark.mean() > 0.5), float(np.median(contrast)))


def _complete(grid: Grid, corners: Corners) -> Grid:
    """The grid with its stray lines cut, its holes filled and its sides grown, as far as saddles are found."""
    pool: Pool = by_rows(np.concatenate([corners.xy, corners.weak]), len(corners.smooth))
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
    strong: Pool = by_rows(corners.xy, len(corners.smooth))
    for _ in range(4):
        if _one_column_more(grid, corners, strong)[1] >= 2:
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
    known = grid.known
    r0, c0, r1, c1 = 0, 0, *grid.shape
    while min(r1 - r0, c1 - c0) > 1:
        inner = known[r0:r1, c0:c1]
        seen = [float(side.sum()) / len(side) for side in (inner[0], inner[-1], inner[:, 0], inner[:, -1])]
        worst = seen.index(min(seen))
        if seen[worst] >= LEAST_FILL:
            break
        r0, r1, c0, c1 = r0 + (worst == 0), r1 - (worst == 1), c0 + (worst == 2), c1 - (worst == 3)
    # Neighbouring squares alternate.
    return Grid(grid.xy[r0:r1, c0:c1], grid.dark ^ ((r0 + c0) % 2 == 1), grid.contrast)


def _fill(grid: Grid, corners: Corners, pool: Pool) -> Grid:
    """With the holes filled where a saddle lies at the predicted place."""
    xy = np.ascontiguousarray(grid.xy).copy()
    # Each round reaches one corner further into a hole.
    for _ in range(sum(grid.shape)):
        missing = np.isnan(xy[..., 0])
        if not missing.any() or not snap(xy, missing, grid.dark, grid.contrast, corners.smooth, *pool):
            break
    return Grid(xy, grid.dark, grid.contrast)


def _one_column_more(grid: Grid, corners: Corners, pool: Pool) -> tuple[Grid, int]:
    """With one more column on the right, and how many of its corners the picture shows."""
    rows, columns = grid.shape
    xy = np.full((rows, columns + 1, 2), np.nan)
    xy[:, :-1] = grid.xy
    wanted = np.zeros((rows, columns + 1), np.bool_)
    wanted[:, -1] = True
    seen = snap(xy, wanted, grid.dark, grid.contrast, corners.smooth, *pool)
    return Grid(xy, grid.dark, grid.contrast), int(seen)
