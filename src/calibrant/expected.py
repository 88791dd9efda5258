"""Arguments of the wrong kind, from people who work in Python: what was given, and what was expected."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from calibrant.errors import InputError

_SHOWN = 60


def expect(value: Any, kinds: type | tuple[type, ...], what: str, expected: str) -> None:
    """Raises: InputError for a value that is of none of the kinds."""
    if not isinstance(value, kinds):
        raise unexpected(value, what, expected)


def unexpected(value: Any, what: str, expected: str) -> InputError:
    """The error that says what an argument is, and what it should be."""
    return InputError(f"{what} is {repr(value)[:_SHOWN]} ({type(value).__name__}); expected {expected}")


def names_of(value: Any, what: str, expected: str) -> tuple[str, ...]:
    """A list of names. Raises: InputError for anything else, a single text among it, which is a list of letters."""
    if not isinstance(value, Iterable) or isinstance(value, str | bytes | Mapping):
        raise unexpected(value, what, expected)
    names = tuple(value)
    for name in names:
        expect(name, str, f"one of {what}", expected)
    return names
