"""The order people give to numbered files: 2.png before 10.png."""

from __future__ import annotations

import re


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sorting key that compares runs of digits as numbers and the rest as text without case."""
    parts = re.split(r"(\d+)", name)
    return tuple((0, int(part), part) if part.isdigit() else (1, 0, part.lower()) for part in parts if part)
