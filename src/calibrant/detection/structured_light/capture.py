"""A capture: the camera's pictures of a pattern sequence, in its order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.errors import InputError
from calibrant.patterns.sequence import BIT, BLACK, INVERSE, SHIFT, WHITE, PatternSequence

Grey = NDArray[np.uint8]
Picture = NDArray[Any]
"""Numbers of a picture's size, of any type: single precision saves half of the memory."""


@dataclass(frozen=True, eq=False)
class Capture:
    """Pictures (n, h, w), 8 bits, of the patterns of a sequence in its order; names: of the files, for messages.

    Raises: InputError where there are more or fewer than the sequence has.
    """

    name: str
    sequence: PatternSequence
    pictures: Grey
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        n = len(self.sequence.patterns)
        if self.pictures.ndim != 3 or len(self.pictures) != n or len(self.names) != n:
            raise InputError(f"{self.name}: {len(self.pictures)} pictures, the sequence has {n}")

    @property
    def white(self) -> Grey:
        """The picture in full light."""
        return self.pictures[self.place(WHITE)]

    @property
    def black(self) -> Grey:
        """The picture without the projector's light."""
        return self.pictures[self.place(BLACK)]

    def place(self, kind: str, axis: str = "", number: int = 0, period: float = 0.0) -> int:
        """Where a pattern stands."""
        wanted = (kind, axis, number, period)
        return next(k for k, p in enumerate(self.sequence.patterns) if (p.kind, p.axis, p.number, p.period) == wanted)

    def pairs(self, axis: str) -> list[tuple[Grey, Grey]]:
        """The pictures of every bit and of its inverse, coarsest first; none for cosines alone."""
        if self.sequence.code == "phase":
            return []
        bits = range(self.sequence.bits(axis))
        return [(self.pictures[self.place(BIT, axis, b)], self.pictures[self.place(INVERSE, axis, b)]) for b in bits]

    def shifted(self, axis: str, period: float) -> Grey:
        """The pictures (n, h, w) of a cosine at all its shifts."""
        first = self.place(SHIFT, axis, 0, period)
        return self.pictures[first : first + self.sequence.shifts]

    def called(self, k: int) -> str:
        """File name of a picture, for messages."""
        return PurePath(self.names[k]).name

    def reordered(self, order: NDArray[np.int64]) -> Capture:
        """The same with picture order[k] in place k."""
        return Capture(self.name, self.sequence, self.pictures[order], tuple(self.names[k] for k in order))


def read_pictures(files: Sequence[str], grey_of: Callable[[str], Grey]) -> Grey:
    """The pictures (n, h, w) of files, each as `grey_of` reads it. Raises: InputError for pictures of several sizes."""
    first = grey_of(files[0])
    pictures = np.empty((len(files), *first.shape), dtype=np.uint8)
    for k, file in enumerate(files):
        one = first if k == 0 else grey_of(file)
        if one.shape != first.shape:
            (h, w), (h0, w0) = one.shape, first.shape
            raise InputError(f"{file} is {w} × {h} px, {files[0]} {w0} × {h0} px: one camera takes one size")
        pictures[k] = one
    return pictures
