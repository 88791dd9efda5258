"""Specs that name a file may end in a factor on its lengths: points:target.csv:scale=1.002."""

from __future__ import annotations

from collections.abc import Sequence

from calibrant.errors import InputError

_KEY = "scale="


def split_scale(fields: Sequence[str]) -> tuple[str, float]:
    """(file, factor) of a spec's fields; colons in the file's name are its own. Raises: InputError for a bad factor."""
    *name, last = fields or [""]
    if not last.strip().lower().startswith(_KEY):
        return ":".join([*name, last]).strip(), 1.0
    try:
        factor = float(last.strip()[len(_KEY) :])
    except ValueError:
        factor = -1.0
    if not 0.0 < factor < float("inf"):
        raise InputError(f"{last!r} is not a factor above 0, such as scale=1.002")
    return ":".join(name).strip(), factor


def format_scale(factor: float) -> str:
    """What `split_scale` reads back; nothing for 1."""
    return "" if factor == 1.0 else f":{_KEY}{factor!r}"
