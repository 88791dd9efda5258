"""Sizes of grids as people type them: 9x6."""

from __future__ import annotations

import re

from calibrant.errors import InputError

_GRID = re.compile(r"\s*(\d+)\s*[x×*]\s*(\d+)\s*", re.IGNORECASE)


def parse_grid(text: str, *, what: str) -> tuple[int, int]:
    """(columns, rows) of COLUMNSxROWS. Raises: InputError for anything else."""
    match = _GRID.fullmatch(text)
    if match is None:
        raise InputError(f"{what}: {text!r} is not a size; write COLUMNSxROWS, such as 9x6")
    return int(match[1]), int(match[2])
