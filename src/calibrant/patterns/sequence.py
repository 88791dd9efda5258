"""A sequence of patterns that tells every pixel of a projector apart, and the order they are shown in.

    gray    the bits of column and row as Gray code, coarsest first, each followed by its inverse (Inokuchi, Sato and
            Matsuda 1984, "Range imaging system for 3-D object recognition"); white; black. OpenCV's GrayCodePattern
            has this order.
    phase   cosines along x, then along y, of periods p, p r, p r^2 … up to more than the picture's side, coarsest
            first, each shown at n shifts: I_k = (1 + cos(2 pi (x / p - k / n))) / 2; white; black
    both    the bits, the finest cosines, white, black

Pixel i is at i, as in a picture: its stripe reaches from i - 1/2 to i + 1/2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, log, log2

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError

CODES = ("gray", "phase", "both")
BIT, INVERSE, SHIFT, WHITE, BLACK = "bit", "inverse", "shift", "white", "black"
MOST_RATIO = 10.0
"""Of one period to the next finer one: a phase known to a hundredth of a turn tells tenths far apart."""
ROOM = 1.25
"""Of the coarsest period to the picture's side: noise carries no pixel at one edge over to the other."""
LARGEST_SIDE = 16384
LEAST_SHIFTS, MOST_SHIFTS = 3, 64
LEAST_PERIOD = 4
"""Pixels: fewer sample a cosine too coarsely to be one."""


@dataclass(frozen=True)
class Pattern:
    """One picture of a sequence: its kind, what it varies along (x, y, or nothing) and its number among its like.

    number: the bit, 0 the coarsest; or the shift; period: pixels of a cosine.
    """

    kind: str
    axis: str = ""
    number: int = 0
    period: float = 0.0

    @property
    def words(self) -> str:
        """The pattern, for people."""
        along = {"x": "columns", "y": "rows"}.get(self.axis, "")
        if self.kind in (BIT, INVERSE):
            return f"{along}, bit {self.number + 1}{', inverse' if self.kind == INVERSE else ''}"
        if self.kind == SHIFT:
            return f"{along}, period {self.period:g} px, shift {self.number + 1}"
        return self.kind


@dataclass(frozen=True)
class PatternSequence:
    """The patterns for a projector of (width, height) pixels. period_px: of the finest cosines; shifts: of each.

    Raises: InputError for a size, code, period or count that cannot be.

        >>> len(PatternSequence((1024, 768)).patterns)
        42
    """

    projector_size: tuple[int, int]
    code: str = "gray"
    period_px: int = 16
    shifts: int = 8

    def __post_init__(self) -> None:
        if self.code not in CODES:
            raise InputError(f"unknown patterns {self.code!r}; choose {', '.join(CODES)}")
        if not all(2 <= side <= LARGEST_SIDE for side in self.projector_size):
            width, height = self.projector_size
            raise InputError(f"a projector has 2 to {LARGEST_SIDE} pixels a side, got {width}x{height}")
        if not LEAST_SHIFTS <= self.shifts <= MOST_SHIFTS:
            raise InputError(f"cosines are shown at {LEAST_SHIFTS} to {MOST_SHIFTS} shifts, got {self.shifts}")
        if self.period_px < LEAST_PERIOD:
            raise InputError(f"a period has {LEAST_PERIOD} pixels or more, got {self.period_px}")

    def bits(self, axis: str) -> int:
        """Bits that tell the pixels along an axis apart."""
        return ceil(log2(self.side(axis)))

    def side(self, axis: str) -> int:
        """Pixels along an axis."""
        return self.projector_size[0 if axis == "x" else 1]

    def periods(self, axis: str) -> tuple[float, ...]:
        """Periods of the cosines along an axis, coarsest first; of which the first needs no unwrapping, or the bits do
        it."""
        if self.code == "gray":
            return ()
        if self.code == "both":
            return (float(self.period_px),)
        whole = max(ROOM * self.side(axis) / self.period_px, 1.0)
        steps = ceil(log(whole) / log(MOST_RATIO))
        return tuple(self.period_px * whole ** (k / max(steps, 1)) for k in range(steps, -1, -1))

    @cached_property
    def patterns(self) -> tuple[Pattern, ...]:
        """All patterns in the order they are shown in."""
        out: list[Pattern] = []
        if self.code != "phase":
            for axis in "xy":
                for bit in range(self.bits(axis)):
                    out += [Pattern(BIT, axis, bit), Pattern(INVERSE, axis, bit)]
        for axis in "xy":
            out += [Pattern(SHIFT, axis, k, p) for p in self.periods(axis) for k in range(self.shifts)]
        return (*out, Pattern(WHITE), Pattern(BLACK))

    @property
    def names(self) -> tuple[str, ...]:
        """File names of the patterns, which sort in their order: 00-columns-bit-1.png."""
        digits = max(2, len(str(len(self.patterns) - 1)))
        words = [p.words.replace(",", "").replace(".", "-").replace(" ", "-") for p in self.patterns]
        return tuple(f"{k:0{digits}d}-{text}.png" for k, text in enumerate(words))

    def level(self, pattern: Pattern) -> Array:
        """Brightness 0 … 1 along the pattern's axis, (side,), or (1,) for white and black."""
        if pattern.kind in (WHITE, BLACK):
            return np.array([1.0 if pattern.kind == WHITE else 0.0])
        i = np.arange(self.side(pattern.axis))
        if pattern.kind == SHIFT:
            turn = 2 * np.pi * (i / pattern.period - pattern.number / self.shifts)
            return np.asarray(0.5 + 0.5 * np.cos(turn))
        bit = (gray_code(i) >> (self.bits(pattern.axis) - 1 - pattern.number)) & 1
        return np.asarray(bit if pattern.kind == BIT else 1 - bit, dtype=np.float64)

    def picture(self, pattern: Pattern) -> NDArray[np.uint8]:
        """The pattern as the projector's picture (height, width), 8 bits."""
        width, height = self.projector_size
        grey = np.rint(255 * self.level(pattern)).astype(np.uint8)
        row = grey[:, None] if pattern.axis == "y" else grey[None, :]
        return np.ascontiguousarray(np.broadcast_to(row, (height, width)))


def gray_code(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """The Gray code of numbers >= 0, whose neighbours differ in one bit: n ^ (n >> 1)."""
    return np.asarray(number ^ (number >> 1))


def sizes_of_count(count: int) -> str:
    """Words for the projectors that a number of Gray-code pictures fits; empty where none does."""
    bits = (count - 2) / 2
    if bits != int(bits) or bits < 2:
        return ""
    n = int(bits)
    pairs = [(x, n - x) for x in range(1, n) if 0 <= x - (n - x) <= 1]
    sides = [f"{_sides(x)} wide and {_sides(y)} high" for x, y in pairs]
    return f"{count} pictures fit {' or '.join(sides)}" if sides else ""


def _sides(bits: int) -> str:
    return f"{2 ** (bits - 1) + 1 if bits > 1 else 2} to {2**bits} px"
