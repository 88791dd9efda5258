"""JSON with bounds: how deep its lists lie in each other, numbers of any length, keys given twice.

A list within a list, a thousand deep, is no table of numbers, and ends whoever walks through it by calling himself; an
integer of three hundred digits is no number that a computer calculates with. Neither stands in a file that is meant.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from typing import Any

from calibrant.errors import InputError

DEEPEST = 32
"""Lists and mappings within each other; a result file has eight, ROS messages some ten."""
_INTEGER_DIGITS = 18
"""Longer integers are floats: above all lengths, counts and times in nanoseconds."""


def parse_json(
    text: str,
    *,
    object_hook: Callable[[dict[str, Any]], Any] | None = None,
    parse_constant: Callable[[str], Any] | None = None,
) -> Any:
    """Data of a JSON text.

    Args: object_hook, parse_constant: as for `json.loads`. Raises: json.JSONDecodeError; InputError for lists too deep,
    and a key given twice in one object.
    """

    def record(pairs: list[tuple[str, Any]]) -> Any:
        out = dict(pairs)
        if len(out) != len(pairs):
            twice = next(key for key, times in Counter(key for key, _ in pairs).items() if times > 1)
            raise InputError(f"the key {twice[:40]!r} stands twice in one object; keep one of them")
        return out if object_hook is None else object_hook(out)

    try:
        data = json.loads(text, object_pairs_hook=record, parse_int=_integer, parse_constant=parse_constant)
    except RecursionError:
        raise InputError(TOO_DEEP) from None
    check_depth(data)
    return data


TOO_DEEP = f"its lists and mappings lie too deep in each other: more than {DEEPEST}"


def check_depth(data: Any) -> None:
    """Raises: InputError where lists and mappings lie more than DEEPEST deep in each other."""
    level = [data]
    for _ in range(DEEPEST):
        below: list[Any] = []
        for item in level:
            if isinstance(item, dict):
                below += [value for value in item.values() if isinstance(value, dict | list)]
            elif isinstance(item, list):
                below += [value for value in item if isinstance(value, dict | list)]
        if not below:
            return
        level = below
    raise InputError(TOO_DEEP)


def _integer(digits: str) -> int | float:
    return int(digits) if len(digits) <= _INTEGER_DIGITS else float(digits)
