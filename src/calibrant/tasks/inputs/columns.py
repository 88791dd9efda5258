"""Numbers of named columns of a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.reading.files import read_text
from calibrant.reading.notes import note_unused


class Columns:
    """Numbers of named columns (n, k), and the rows' names where there is a column `image`."""

    def __init__(self, values: Array, names: tuple[str, ...] | None) -> None:
        self.values, self.names = values, names


def read_columns(path: Path, columns: Sequence[str]) -> Columns:
    """Read named columns of a CSV file. Raises: InputError naming the file, the line and what was expected."""
    text = read_text(path, what="table", expected=f"a CSV file with the columns {', '.join(columns)}")
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    try:
        fields = [name.strip() for name in reader.fieldnames or ()]
        reader.fieldnames = fields
        table = list(reader)
    except csv.Error as error:
        raise InputError(f"{path}:{reader.line_num + 1}: {error}; expected a CSV file") from None
    missing = [c for c in columns if c not in fields]
    if missing:
        raise InputError(f"{path}: no column {missing[0]!r}; expected the header {','.join(columns)}")
    twice = [c for c in columns if fields.count(c) > 1]
    if twice:
        raise InputError(f"{path}: the column {twice[0]!r} stands there twice; keep one")
    note_unused(str(path), (name for name in fields if name and name not in (*columns, "image")))
    rows, names = [], []
    for line, row in enumerate(table, start=2):
        try:
            numbers = [float(row[c] or "") for c in columns]
        except ValueError:
            numbers = [float("nan")]
        if not np.all(np.isfinite(numbers)):
            raise InputError(f"{path}:{line}: expected a finite number in each of {', '.join(columns)}")
        rows.append(numbers)
        names.append(row.get("image") or "")
    if not rows:
        raise InputError(f"{path}: the header stands alone; expected a row for each")
    return Columns(np.array(rows), tuple(names) if all(names) else None)
