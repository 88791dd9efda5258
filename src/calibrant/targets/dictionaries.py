"""The marker dictionaries by name: bits along a side and number of markers.

The bit patterns live in the image-processing library, two floors up; their sizes are facts that a target needs to be
checked without it. A test compares this table with the library's.
"""

from __future__ import annotations

from dataclasses import dataclass

from calibrant.errors import InputError


@dataclass(frozen=True)
class DictionarySize:
    """bits: cells along a marker's side without its border; capacity: how many markers, with ids 0 .. capacity - 1."""

    bits: int
    capacity: int


DICTIONARIES: dict[str, DictionarySize] = {
    **{f"DICT_{n}X{n}_{size}": DictionarySize(n, size) for n in (4, 5, 6, 7) for size in (50, 100, 250, 1000)},
    "DICT_ARUCO_ORIGINAL": DictionarySize(5, 1024),
    "DICT_ARUCO_MIP_36h12": DictionarySize(6, 250),
    "DICT_APRILTAG_16h5": DictionarySize(4, 30),
    "DICT_APRILTAG_25h9": DictionarySize(5, 35),
    "DICT_APRILTAG_36h10": DictionarySize(6, 2320),
    "DICT_APRILTAG_36h11": DictionarySize(6, 587),
}
_BY_UPPER_CASE = {name.upper(): name for name in DICTIONARIES}


def dictionary_name(text: str) -> str:
    """The dictionary's own spelling; capitals do not matter, DICT_ and DICT_APRILTAG_ may be left out.

    Raises: InputError listing the known names.
    """
    key = text.strip().upper()
    for candidate in (key, f"DICT_{key}", f"DICT_APRILTAG_{key}"):
        if candidate in _BY_UPPER_CASE:
            return _BY_UPPER_CASE[candidate]
    raise InputError(f"unknown marker dictionary {text!r}; known dictionaries: {', '.join(DICTIONARIES)}")
