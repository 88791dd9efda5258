"""What a calibration target is: named points in metres, and the artwork to print or render.

Target frame: origin at the point the target's file names, x to the right along the first row, y down the rows, z into
the board (so a camera that looks at the board's face sees z pointing away from it). The board's plane is z = 0.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array


@dataclass(frozen=True)
class Polygon:
    """A filled polygon in the target's plane: corners ((x, y), …), metres; grey 0 is ink, 1 is paper."""

    corners: tuple[tuple[float, float], ...]
    grey: float = 0.0


@dataclass(frozen=True)
class Disc:
    """A filled disc in the target's plane, metres."""

    centre: tuple[float, float]
    radius: float
    grey: float = 0.0


@dataclass(frozen=True)
class MarkerArt:
    """A square fiducial of a named dictionary: corner (x, y) at its top left, side in metres.

    quarter_turns: how often it is turned clockwise by 90 degrees from upright, upright being OpenCV's.
    Its bits are drawn by who renders it: they live in the image-processing library, two floors up.
    """

    dictionary: str
    id: int
    top_left: tuple[float, float]
    side: float
    inverted: bool = False
    quarter_turns: int = 0


@dataclass(frozen=True)
class Artwork:
    """A target's drawing: (x0, y0, x1, y1) of the sheet's printed area with its quiet zone, metres, and its shapes.

    Shapes are drawn in order, on paper (grey 1) unless `background` says otherwise.
    """

    bounds: tuple[float, float, float, float]
    shapes: tuple[Polygon | Disc | MarkerArt, ...]
    background: float = 1.0


class Target(ABC):
    """One kind of target. Subclass it as a frozen dataclass in its own file; register it in `targets/registry.py`."""

    kind: ClassVar[str]

    @property
    @abstractmethod
    def points(self) -> Array:
        """All points of the target, (n, 3) metres, target frame."""

    @property
    @abstractmethod
    def point_ids(self) -> NDArray[np.int64]:
        """Labels (n,) of `points`."""

    @property
    @abstractmethod
    def spec(self) -> str:
        """The spec that `parse_target` reads back to an equal target, e.g. chessboard:9x6:25mm."""

    @abstractmethod
    def artwork(self) -> Artwork:
        """What to print."""

    @abstractmethod
    def scaled(self, factor: float) -> Target:
        """The same target with all lengths times `factor`."""
