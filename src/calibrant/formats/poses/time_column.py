"""The column of a table that says when each row was taken."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.formats.poses.columns import name_and_unit
from calibrant.formats.poses.rows import PoseTable, numbers_of

_TIME = re.compile(r"^(?:header)?(?:timestamp|time|stamp|t|secs?|seconds)(?P<unit>s|ms|us|ns)?$")
_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_UNIX = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))
"""Times since 1970 are 1.8e9 s: numbers of these sizes can only be finer units of them."""


def split_times(table: PoseTable) -> tuple[Array, PoseTable] | None:
    """Times (n,) in seconds, and the table without them; None where no column holds times.

    Raises: InputError for a time that is no number, a unit that is not known.
    """
    for i, column in enumerate(table.header):
        name, unit = name_and_unit(column)
        match = _TIME.match(name)
        if match is None:
            continue
        values = numbers_of(table, (i,), bounded=False)[:, 0]
        unit = unit or match["unit"] or finer_unit(values)
        if unit not in _SECONDS:
            raise InputError(f"{table.source}: the unit {unit!r} of times is not known here; known: s, ms, us, ns")
        rest = tuple(row[:i] + row[i + 1 :] for row in table.rows)
        return values * _SECONDS[unit], replace(table, header=table.header[:i] + table.header[i + 1 :], rows=rest)
    return None


def times_beside(table: PoseTable) -> Array | None:
    """Times (n,) that stand beside poses, where they are plain numbers; a clock's "12:30:05" is passed over."""
    try:
        found = split_times(table)
    except InputError:
        return None
    return None if found is None or not np.all(np.isfinite(found[0])) else found[0]


def without_times(columns: Iterable[str]) -> list[str]:
    """The columns that hold no times."""
    return [column for column in columns if _TIME.match(name_and_unit(column)[0]) is None]


def in_seconds(values: Array) -> Array:
    """Times without a stated unit in seconds."""
    return values * _SECONDS[finer_unit(values)]


def finer_unit(values: Array) -> str:
    """The unit that times since 1970 are in by their size; seconds for all others."""
    largest = float(np.abs(values).max())
    return next((unit for bound, unit in _UNIX if largest > bound), "s")
