"""Any points, from a file: for targets that are measured or found by other means.

A CSV file with a header: x,y,z in metres, or x_mm,y_mm,z_mm, and id if the points have labels of their own (else they
count from 0). Nothing is known of what they look like, so they can be neither printed nor detected; their observations
come from a file.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.reading.files import read_text
from calibrant.reading.notes import note_unused
from calibrant.targets.scale import format_scale, split_scale
from calibrant.targets.target import Artwork, Target

SYNTAX = "points:FILE with a CSV file of x,y,z in metres, or x_mm,y_mm,z_mm, and id, such as points:target.csv"


@dataclass(frozen=True)
class PointList(Target):
    """Points (id, x, y, z), metres, of a file; `scale` is a factor on all of them."""

    kind: ClassVar[str] = "points"

    file: str
    labelled: tuple[tuple[int, float, float, float], ...]
    scale: float = 1.0

    @cached_property
    def points(self) -> Array:
        """(n, 3) metres, as in the file."""
        points = self.scale * np.array([p[1:] for p in self.labelled], dtype=np.float64)
        points.setflags(write=False)
        return points

    @property
    def point_ids(self) -> NDArray[np.int64]:
        """The file's ids, or 0 .. n - 1."""
        return np.array([p[0] for p in self.labelled], dtype=np.int64)

    @property
    def spec(self) -> str:
        """points:FILE."""
        return f"{self.kind}:{self.file}{format_scale(self.scale)}"

    def artwork(self) -> Artwork:
        """Raises: InputError, as nothing is known of what the points look like."""
        raise InputError(f"{self.spec}: a list of points has no artwork; print a target of another kind")

    def scaled(self, factor: float) -> PointList:
        """The same points times `factor`."""
        return replace(self, scale=self.scale * factor)


def parse(fields: Sequence[str]) -> PointList:
    """Points of a spec's fields after its kind. Raises: InputError naming the file and line that cannot be used."""
    name, scale = split_scale(fields)
    if not name:
        raise InputError(f"a list of points needs its file: {SYNTAX}")
    return PointList(name, _read_points(Path(name)), scale)


def _read_points(path: Path) -> tuple[tuple[int, float, float, float], ...]:
    text = read_text(path, what="points file", expected="a CSV file")
    reader = csv.DictReader(line for line in text.splitlines() if line.strip() and not line.startswith("#"))
    try:
        names = [n.strip() for n in reader.fieldnames or ()]
        reader.fieldnames = names
        table = list(reader)
    except csv.Error as error:
        raise InputError(f"points file {path}: {error}; expected a CSV file") from None
    units = [u for u, factor in _UNITS.items() if all(f"{axis}{u}" in names for axis in "xyz")]
    if len(units) != 1:
        raise InputError(
            f"points file {path} has the columns {', '.join(names) or 'none'}; expected x,y,z in metres, or "
            "x_mm,y_mm,z_mm"
        )
    note_unused(f"points file {path}", (n for n in names if n and n not in ("id", *(f"{a}{units[0]}" for a in "xyz"))))
    rows = [_listed_point(row, units[0], i, path) for i, row in enumerate(table)]
    if len(rows) < 4 or len({r[0] for r in rows}) < len(rows):
        raise InputError(f"points file {path}: expected at least 4 points with ids of their own, got {len(rows)} rows")
    return tuple(rows)


_UNITS = {"": 1.0, "_mm": 1e-3}


def _listed_point(row: dict[str, str], unit: str, index: int, path: Path) -> tuple[int, float, float, float]:
    try:
        x, y, z = (_UNITS[unit] * float(row[f"{axis}{unit}"]) for axis in "xyz")
        label = int(row["id"]) if "id" in row else index
    except (TypeError, ValueError):
        shown = str(row)[:80]
        raise InputError(f"points file {path}: point {index + 1} has a value that is not a number: {shown}") from None
    if not np.all(np.isfinite([x, y, z])) or not abs(label) < 2**62:
        raise InputError(f"points file {path}: point {index + 1} is not finite: {row}")
    return label, x, y, z
