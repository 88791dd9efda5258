"""A single square marker: its four corners.

Frame: origin at the marker's centre, x to the right, y down, z into the marker. Points 0 .. 3 are its corners from the
top left, clockwise.
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
from calibrant.targets.apriltag3 import FAMILIES, tag_name
from calibrant.targets.dictionaries import DICTIONARIES
from calibrant.targets.lengths import check_length, format_length, parse_length
from calibrant.targets.target import Artwork, MarkerArt, Target

SYNTAX = "marker:SIDE:DICTIONARY:ID, such as marker:50mm:DICT_APRILTAG_36h11:10"


@dataclass(frozen=True)
class Marker(Target):
    """A marker of a named dictionary, `side` metres with its black border.

    Of one of AprilTag 3's families, `side` is that of the light square in the dark ring, as AprilTag counts it; the
    code goes beyond it.
    """

    kind: ClassVar[str] = "marker"

    side: float
    dictionary: str
    id: int

    def __post_init__(self) -> None:
        check_length(self.side, what="the marker's side")
        object.__setattr__(self, "dictionary", tag_name(self.dictionary))
        check_id(self.id, self.dictionary)

    @cached_property
    def points(self) -> Array:
        """Corners, (4, 3) metres: top left, top right, bottom right, bottom left."""
        points = 0.5 * self.side * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
        points.setflags(write=False)
        return points

    @property
    def point_ids(self) -> NDArray[np.int64]:
        """0 .. 3."""
        return np.arange(4, dtype=np.int64)

    @property
    def marker_points(self) -> dict[int, NDArray[np.int64]]:
        """Point ids of the corners of each marker of the target, by the marker's id."""
        return {self.id: self.point_ids}

    @property
    def spec(self) -> str:
        """marker:SIDE:DICTIONARY:ID."""
        return f"{self.kind}:{format_length(self.side)}:{self.dictionary}:{self.id}"

    def artwork(self) -> Artwork:
        """The marker with a quiet zone of two cells."""
        half = 0.5 * self.side
        edge = half + quiet_zone(self.dictionary, self.side)
        return Artwork((-edge, -edge, edge, edge), (marker_art(self.dictionary, self.id, (-half, -half), self.side),))

    def scaled(self, factor: float) -> Marker:
        """The same marker with its side times `factor`."""
        return replace(self, side=self.side * factor)


def marker_art(dictionary: str, marker_id: int, top_left: tuple[float, float], side: float) -> MarkerArt:
    """The drawing of a marker whose square has this top left corner and side, metres: the square, or what is around
    it as well."""
    margin = FAMILIES[dictionary].margin * side if dictionary in FAMILIES else 0.0
    return MarkerArt(dictionary, marker_id, (top_left[0] - margin, top_left[1] - margin), side + 2.0 * margin)


def quiet_zone(dictionary: str, side: float) -> float:
    """How far from a marker's square other things must be, metres: two cells of paper, beyond its code."""
    if dictionary in FAMILIES:
        return (FAMILIES[dictionary].margin + 2.0 / FAMILIES[dictionary].square) * side
    return 2.0 * side / (DICTIONARIES[dictionary].bits + 2)


def check_id(marker_id: int, dictionary: str) -> int:
    """The id, checked. Raises: InputError when the dictionary has no such marker."""
    capacity = (FAMILIES.get(dictionary) or DICTIONARIES[dictionary]).capacity
    if not 0 <= marker_id < capacity:
        raise InputError(f"{dictionary} has markers 0 to {capacity - 1}, got id {marker_id}")
    return marker_id


def parse(fields: Sequence[str]) -> Marker:
    """Marker of a spec's fields after its kind. Raises: InputError for a field missing or impossible."""
    if len(fields) != 3:
        raise InputError(f"a marker needs its side, dictionary and id: {SYNTAX}")
    side, dictionary, marker_id = fields
    if not marker_id.strip().isdigit():
        raise InputError(f"a marker's id is a whole number, got {marker_id!r}: {SYNTAX}")
    return Marker(parse_length(side, what="the marker's side"), dictionary, int(marker_id))
