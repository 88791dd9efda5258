"""Which part of a plain chessboard reaches into the image: known where its own outline says so, else refused.

Corners of a plain board carry no names: a part of it can be numbered only from ends of the board that are seen. A side
of the grid found is
- an `end` when the outermost squares are whole and white paper follows all along them, where a board that went on would
  show every other square dark;
- `cut` when the next line of corners would lie outside the image;
- unknown otherwise: hidden, blurred, or a board without a margin.
Along an axis of which all corners are seen the place is known; along the other it is when one side is an end and the
other is cut. Every way to turn the board is held against that and against the colours of its squares; the corners are
numbered when one place remains, and refused when another is possible as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Grey
from calibrant.detection.chessboard.grid import Grid, turned
from calibrant.detection.opencv import sample
from calibrant.targets.chessboard import Chessboard

LEAST_LINES = 4
"""Lines of corners that must lead to a side to judge it: three squares, of which one or two are dark."""
WHOLE, BEYOND = 0.8, 1.2
"""Where the outermost squares and the paper after them are looked at, in squares from the last corners: a fifth on each
side of the edge for what extrapolation and blur may take; margins of a third of a square are seen."""
ALONG = np.array([0.3, 0.4, 0.5, 0.6, 0.7])
"""Places along each square whose mean is looked at."""
LIGHT = 0.25
"""How far from the middle, over the difference of dark and light, a square must be: half way to its own colour."""
LEAST_DIFFERENCE = 6.0
"""Grey levels between neighbouring squares: three times the rounding and blocks of compressed pictures."""
BORDER_PX = 8.0
"""Corners nearer than this to the edge of the image they are looked for in are not found."""
CORNER_REACH = 0.35
"""Of a square, the part around a corner that must be in the image for it to be found."""


class Side(Enum):
    """What is known of a side of a grid."""

    END = "end"
    CUT = "cut"
    UNKNOWN = "unknown"


@dataclass(frozen=True, eq=False)
class Placed:
    """A grid turned as the target, and the target's row and column of its first corner."""

    grid: Grid
    row: int
    column: int


def place(level: Grey, grid: Grid, target: Chessboard) -> list[Placed] | str:
    """The places on the board that a part of it may have, one for each turn that looks the same; or why none is known.

    None, without a reason, when the image cuts no side: it is a board of another size then.
    Args: level: the image that the grid's pixels are of.
    """
    turns = [grid]
    for _ in range(3):
        turns.append(turned(turns[-1]))
    # Turned once, the right side is what was the bottom; then the left, then the top.
    right = [_right_side(level, turn) for turn in turns]
    if Side.CUT not in right:
        return []
    placed: dict[int, Placed] = {}
    for k, turn in enumerate(turns):
        rows = _places(turn.shape[0], target.rows, right[(k + 3) % 4], right[(k + 1) % 4])
        columns = _places(turn.shape[1], target.columns, right[(k + 2) % 4], right[k])
        if not rows or not columns:
            continue
        if len(rows) > 1 or len(columns) > 1:
            return _unknown(
                grid, target, "its ends are seen on too few sides; show one end of each direction, margin too"
            )
        if turn.dark == ((rows[0] + columns[0]) % 2 == 0) or target.rows % 2 == target.columns % 2 == 0:
            placed[k] = Placed(turn, rows[0], columns[0])
    step = 4 if target.turns_unnoticed_deg is None else target.turns_unnoticed_deg // 90
    if len({k % step for k in placed}) > 1:
        least = min(target.rows, target.columns) + 1
        return _unknown(
            grid,
            target,
            f"its long and short sides cannot be told apart; show at least {least} corners of its long side",
        )
    if not placed:
        return _unknown(grid, target, "what is seen of its ends and colours does not fit such a board")
    return list(placed.values())


def _unknown(grid: Grid, target: Chessboard, why: str) -> str:
    seen = int(grid.known.sum())
    return (
        f"only {seen} of {target.rows * target.columns} corners are in the image, and which ones cannot be known: {why}"
    )


def _places(seen: int, count: int, before: Side, after: Side) -> list[int]:
    """The places that `seen` lines may have among `count`, by the sides before and after them."""
    room = count - seen
    if room < 0 or (room > 0 and before == after == Side.END):
        return []
    if room == 0 and Side.UNKNOWN not in (before, after):
        return [0]
    if (before, after) == (Side.END, Side.CUT):
        return [0]
    if (before, after) == (Side.CUT, Side.END):
        return [room]
    # A hidden side may have more lines behind it, also when all are seen that were asked for: a larger board.
    return list(range(room + 2))


def _right_side(level: Grey, grid: Grid) -> Side:
    """Whether the board ends after the grid's last column, the image does, or neither is seen."""
    xy = grid.xy
    leads = np.asarray(~np.isnan(xy[:, -3:, 0]).any(axis=1))
    if leads.sum() < LEAST_LINES or xy.shape[1] < 3:
        return Side.UNKNOWN
    beyond = _extrapolated(xy[leads, -3:], np.array([1.0, 1.0 + CORNER_REACH]))
    height, width = level.shape
    near, far = beyond[:, 0], beyond[:, 1]
    size = np.array([width, height]) - 1.0
    over = (near < BORDER_PX) | (near > size - BORDER_PX) | (far < 0) | (far > size)
    out = np.asarray(over.any(axis=1))
    # Where the image's edge runs across the board at a slant, some lines end before the last column.
    if 4 * out.sum() >= len(out) and 2 * (out.sum() + np.count_nonzero(~leads)) >= len(leads):
        return Side.CUT
    return Side.END if _ends(level, grid, leads) else Side.UNKNOWN


def _ends(level: Grey, grid: Grid, leads: NDArray[np.bool_]) -> bool:
    """Whether whole squares follow the last column, and light paper on all of them."""
    xy = grid.xy
    both = np.asarray(leads[:-1] & leads[1:])
    if both.sum() < LEAST_LINES - 1:
        return False
    depths = np.array([-0.5, 0.5, WHOLE, BEYOND])
    upper, lower = (_extrapolated(part[both, -3:], depths) for part in (xy[:-1], xy[1:]))
    places = upper[:, :, None] + ALONG[:, None] * (lower - upper)[:, :, None]
    inside = np.asarray(_inside(places, level.shape).all(axis=(1, 2)))
    if inside.sum() < max(LEAST_LINES - 1, 0.5 * len(inside)):
        return False
    value = sample(level, places[inside].reshape(inside.sum(), -1, 2)).reshape(inside.sum(), len(depths), len(ALONG))
    inner, outer, edge, paper = np.moveaxis(value.mean(axis=2), 1, 0)
    row = np.flatnonzero(both)[inside]
    sign = np.where(grid.dark ^ ((row + xy.shape[1]) % 2 == 0), -1.0, 1.0)
    # Across the last line of corners the colours change: the two tell dark from light at this place.
    middle, difference = 0.5 * (inner + outer), sign * (outer - inner)
    whole = sign * (edge - middle) > LIGHT * difference
    light = paper - middle > LIGHT * difference
    return bool(np.all((difference >= LEAST_DIFFERENCE) & whole & light))


def _extrapolated(line: Array, depth: Array) -> Array:
    """Points (n, m, 2) at depths (m,) squares after the last of three equally spaced points a line, (n, 3, 2).

    Along a line x(s) = (a + b s) / (1 + c s) in any view; its three values at s = -2, -1, 0 give a, b and c.
    """
    d1 = np.linalg.norm(line[:, 2] - line[:, 1], axis=1)
    d2 = np.linalg.norm(line[:, 1] - line[:, 0], axis=1)
    # x(0) = 0, x(-1) = -d1, x(-2) = -(d1 + d2): b = d1 (1 - c) and c as here. Steps change by less than a third from
    # square to square in any view that can be used.
    c = np.clip(0.5 * (d2 - d1) / np.maximum(d2, 1e-9), -0.25, 0.17)
    along = d1[:, None] * (1.0 - c)[:, None] * depth / (1.0 + c[:, None] * depth)
    direction = (line[:, 2] - line[:, 1]) / np.maximum(d1, 1e-9)[:, None]
    return np.asarray(line[:, 2][:, None] + along[..., None] * direction[:, None])


def _inside(uv: Array, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    height, width = shape[:2]
    return np.asarray((uv >= 0).all(axis=-1) & (uv[..., 0] <= width - 1) & (uv[..., 1] <= height - 1))
