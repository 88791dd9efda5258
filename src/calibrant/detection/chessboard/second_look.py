"""The second look at chessboards: where another camera that saw the whole board says its corners are.

Corners of a plain board carry no names, so that a part of it is not numbered by its own image. Where the board was at
that moment is known from the other camera, and a grid's place on it by the nearest of the corners expected: a grid that
is one corner off is a whole square away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibrant.arrays import Array, Grey
from calibrant.detection.chessboard.detector import LEAST_LOOK, at_every_scale, measured
from calibrant.detection.chessboard.grid import Grid, turned
from calibrant.detection.chessboard.partial import Placed
from calibrant.detection.detection import Detection
from calibrant.detection.images.images import load_grey
from calibrant.detection.subpixel.refinement import DEFAULT, Refinement
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.targets.chessboard import Chessboard

NEAR = 0.35
"""Of a square, that corners may be off from where they are expected: a place one corner beside is a whole one off."""
ALIKE = 0.9
"""Part of a grid's corners that have the same place on the board; others are next to a corner that bends away."""


@dataclass(frozen=True, eq=False)
class Expected:
    """An image, and where the board's corners are expected in it: ways (k, n, 2) pixels, NaN where behind the camera;
    several where the other camera cannot tell which of two poses the board has."""

    file: Path
    ways: Array


def look_there(
    images: Sequence[Expected], *, target: Chessboard, mirror_x: bool = False, refinement: Refinement = DEFAULT
) -> list[Detection | None]:
    """The part of the board that each image shows where it is expected; None where it shows none, or cannot be read."""
    cv2.setNumThreads(1)
    out: list[Detection | None] = []
    for image in images:
        try:
            grey = load_grey(image.file)
        except InputError:
            out.append(None)  # gone since the first look
            continue
        if mirror_x:
            grey = np.ascontiguousarray(grey[:, ::-1])
        out.append(part_there(grey, target, image.ways, refinement=refinement))
    return out


def part_there(grey: Grey, target: Chessboard, ways: Array, *, refinement: Refinement = DEFAULT) -> Detection | None:
    """The part of a board in a grey image (h, w) whose corners are expected at one of ways (k, n, 2); else None."""
    best: tuple[float, Placed, int] | None = None
    for found in at_every_scale(grey, target):
        if found.grid.known.sum() < LEAST_LOOK:
            continue
        for expected in ways:
            here = _placed(found.grid, target, expected)
            # The more corners the better; of as many, the nearest.
            if here is not None and (best is None or (-_count(here[1]), here[0]) < (-_count(best[1]), best[0])):
                best = (*here, found.factor)
    if best is None:
        return None
    found_there = measured(grey, best[1], best[2], target, LEAST_LOOK, refinement)
    return found_there if found_there.found else None


def _count(placed: Placed) -> int:
    return int(placed.grid.known.sum())


def _placed(grid: Grid, target: Chessboard, expected: Array) -> tuple[float, Placed] | None:
    """The grid at the place on the board that is expected there, and how far it is from it, in squares."""
    there = np.flatnonzero(np.isfinite(expected).all(axis=1))
    if len(there) < LEAST_LOOK:
        return None
    best: tuple[float, Placed] | None = None
    turn = grid
    for _ in range(4):
        known = np.argwhere(turn.known)
        xy = turn.xy[turn.known]
        nearest = there[np.argmin(np.linalg.norm(xy[:, None] - expected[there], axis=2), axis=1)]
        places = np.column_stack(np.divmod(nearest, target.columns)) - known
        offsets, counts = np.unique(places, axis=0, return_counts=True)
        row, column = (int(v) for v in offsets[np.argmax(counts)])
        fits = counts.max() >= ALIKE * len(known)
        inside = row >= 0 and column >= 0
        inside &= row + turn.shape[0] <= target.rows and column + turn.shape[1] <= target.columns
        if fits and inside:
            ids = (known[:, 0] + row) * target.columns + known[:, 1] + column
            off = float(np.nanmedian(np.linalg.norm(xy - expected[ids], axis=1))) / _square(turn)
            if off <= NEAR and (best is None or off < best[0]):
                best = off, Placed(turn, row, column)
        turn = turned(turn)
    return best


def _square(grid: Grid) -> float:
    """A typical distance of neighbouring corners, px."""
    steps = [np.linalg.norm(np.diff(grid.xy, axis=axis), axis=2).ravel() for axis in (0, 1)]
    return float(np.nanmedian(np.concatenate(steps)))
