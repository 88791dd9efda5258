"""AprilTag 3's families whose code surrounds the square that is measured: tagStandard41h12 and its kin.

A white ring of cells lies within the square, a black one around it, and the code's cells within and around both. The
square's side, from the white ring's edge to its edge, is the tag's size, as AprilTag's authors count it; the print is
larger. Upright is upright as the authors print them, and corner 0 is then at the top left.

The codes are the authors' and come with their library, in the package pupil-apriltags: what needs them (printing,
detecting) says how to get it. Sizes are facts, which a target needs to be checked; a test compares them.

Source: M. Krogius, A. Haggenmiller, E. Olson, Flexible Layouts for Fiducial Tags, IROS 2019.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.errors import InputError, MissingExtraError
from calibrant.targets.dictionaries import dictionary_name

Cells = NDArray[np.bool_]


@dataclass(frozen=True)
class TagFamily:
    """square: cells along the side of the square that is measured; total: cells along the whole tag; capacity: how many
    tags, with ids 0 .. capacity - 1."""

    square: int
    total: int
    capacity: int

    @property
    def margin(self) -> float:
        """How far the tag goes beyond its square, to each side, as a part of the square's side."""
        return 0.5 * (self.total / self.square - 1.0)


FAMILIES: dict[str, TagFamily] = {
    "tagStandard41h12": TagFamily(5, 9, 2115),
    "tagStandard52h13": TagFamily(6, 10, 48714),
    "tagCircle21h7": TagFamily(5, 9, 38),
    "tagCircle49h12": TagFamily(5, 11, 65535),
    "tagCustom48h12": TagFamily(6, 10, 42211),
}
_BY_LOWER_CASE = {name.lower(): name for name in FAMILIES}


@dataclass(frozen=True, eq=False)
class TagCodes:
    """codes (n,), the first bit being the highest, 1 being paper; row, column (bits,) of each bit's cell, from the
    whole tag's top left; distance: bits by which any two codes differ at least."""

    codes: NDArray[np.uint64]
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    distance: int


def tag_name(text: str) -> str:
    """The name of one of AprilTag 3's families or of a dictionary, in its own spelling; `tag` may be left out.

    Raises: InputError listing the known names.
    """
    key = text.strip().lower()
    for candidate in (key, f"tag{key}"):
        if candidate in _BY_LOWER_CASE:
            return _BY_LOWER_CASE[candidate]
    try:
        return dictionary_name(text)
    except InputError as error:
        raise InputError(f"{error}, {', '.join(FAMILIES)}") from None


def board_dictionary(text: str, *, kind: str) -> str:
    """As `dictionary_name`, for a board of markers. Raises: InputError, also for a family that boards are not made of.

    Args: kind: what the board is, such as "a ChArUco board".
    """
    key = text.strip().lower()
    name = _BY_LOWER_CASE.get(key) or _BY_LOWER_CASE.get(f"tag{key}")
    if name is not None:
        raise InputError(
            f"{name} is for single tags, whose code goes beyond their square: {kind} has no room for it; give "
            f"marker:SIDE:{name}:ID, or bundle:FILE for several"
        )
    return dictionary_name(text)


@lru_cache(maxsize=8)
def tag_codes(name: str) -> TagCodes:
    """The codes of a family. Raises: MissingExtraError when the package that has them is not installed."""
    try:
        from pupil_apriltags import Detector
    except ImportError:
        raise MissingExtraError(
            f"the codes of {name} come with AprilTag 3's own library, which is not installed: "
            "pip install 'calibrant[apriltag3]'"
        ) from None
    # A detector prepares for every code with up to two wrong bits, half a minute for the large families; one of the
    # smallest family loads the library, and the family's record needs no detector.
    library = Detector(families="tag16h5")
    create, destroy = (getattr(library.libc, f"{name}_{what}") for what in ("create", "destroy"))
    create.restype, destroy.restype = type(library.tag_families["tag16h5"]), None
    # Its finaliser frees the families before the detector that still reads them; a family forgotten is not freed.
    library.tag_families.clear()
    family = create()
    try:
        return _copied(family.contents)
    finally:
        destroy(family)


def _copied(record: Any) -> TagCodes:
    start = (record.total_width - record.width_at_border) // 2
    # Places before the square are negative numbers, kept in unsigned ones.
    place = [np.array(at[: record.nbits], np.uint32).astype(np.int32) for at in (record.bit_y, record.bit_x)]
    row, column = (at.astype(np.int64) + start for at in place)
    return TagCodes(np.array(record.codes[: record.ncodes], np.uint64), row, column, int(record.h))


def tag_rings(name: str) -> tuple[Cells, Cells]:
    """The ring of paper within the square and the ring of ink around it, as masks (total, total)."""
    family = FAMILIES[name]
    centre = 0.5 * (family.total - 1)
    away = np.abs(np.arange(family.total) - centre)
    away = np.maximum(away[:, None], away)
    paper = 0.5 * (family.square - 1)
    return away == paper, away == paper + 1


@lru_cache(maxsize=256)
def tag_cells(name: str, tag_id: int) -> Cells:
    """The cells of a whole tag (total, total): true is paper, false is ink. Raises: as `tag_codes`.

    Beyond a round tag's code is paper; within tagCustom48h12's is ink, as its authors draw it.
    """
    known = tag_codes(name)
    paper, ink = tag_rings(name)
    centre = len(paper) // 2
    cells = np.ones(paper.shape, dtype=bool)
    cells[centre - 1 : centre + 1, centre - 1 : centre + 1] = False
    cells[paper], cells[ink] = True, False
    high_first = np.arange(len(known.row), dtype=np.uint64)[::-1]
    cells[known.row, known.column] = (known.codes[tag_id] >> high_first) & np.uint64(1)
    cells.setflags(write=False)
    return cells
