"""The largest upright rectangle in a mask: what can be cut out of an image without a black edge."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibrant.arrays import Mask

_CELLS = 160
"""The search runs on a mask of about this many cells a side, and the edges are then moved pixel by pixel."""


class Rectangle(NamedTuple):
    """Pixels x <= u < x + width, y <= v < y + height."""

    x: int
    y: int
    width: int
    height: int


def largest_rectangle(mask: Mask) -> Rectangle:
    """A rectangle of True in a mask (h, w) that no move of one edge enlarges; width and height 0 where there is none.

    It is the largest to within a cell, 1/160 of the longer side: found on whole cells, then grown to the pixel.
    """
    cell = max(1, -(-max(mask.shape) // _CELLS))
    h, w = (n // cell * cell for n in mask.shape)
    cells = mask[:h, :w].reshape(h // cell, cell, w // cell, cell)
    coarse: Mask = np.asarray(cells.all(axis=(1, 3)))
    top, left, bottom, right = (cell * edge for edge in _largest_in_cells(coarse))
    if bottom <= top or right <= left:
        return Rectangle(0, 0, 0, 0)
    grown = True
    while grown:
        grown = False
        if top > 0 and mask[top - 1, left:right].all():
            top, grown = top - 1, True
        if bottom < mask.shape[0] and mask[bottom, left:right].all():
            bottom, grown = bottom + 1, True
        if left > 0 and mask[top:bottom, left - 1].all():
            left, grown = left - 1, True
        if right < mask.shape[1] and mask[top:bottom, right].all():
            right, grown = right + 1, True
    return Rectangle(left, top, right - left, bottom - top)


def _largest_in_cells(mask: Mask) -> tuple[int, int, int, int]:
    """Top, left, bottom, right: row by row the largest rectangle under the histogram of the cells above."""
    best, found = 0, (0, 0, 0, 0)
    heights = np.zeros(mask.shape[1], dtype=np.int64)
    for row, cells in enumerate(mask):
        heights = np.where(cells, heights + 1, 0)
        stack: list[tuple[int, int]] = []  # (first column, height), heights rising
        for column, height in enumerate([*heights.tolist(), 0]):
            first = column
            while stack and stack[-1][1] >= height:
                first, tall = stack.pop()
                if tall * (column - first) > best:
                    best, found = tall * (column - first), (row + 1 - tall, first, row + 1, column)
            stack.append((first, height))
    return found
