"""Frozen records as JSON and back, by their annotations: every key checked, every message naming the place."""

from __future__ import annotations

import json
import types
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from math import isnan
from typing import Any, Union, get_args, get_origin, get_type_hints

from calibrant.errors import InputError

Json = dict[str, Any]

_WORDS: dict[Any, str] = {str: "text", bool: "true or false", int: "an integer", float: "a number"}


def as_json(value: Any) -> Any:
    """A record as JSON has it: an object of its fields, those left out that are as the class has them by default."""
    if is_dataclass(value) and not isinstance(value, type):
        told = {f.name: getattr(value, f.name) for f in fields(value) if not _is_default(f, getattr(value, f.name))}
        return {name: as_json(item) for name, item in told.items()}
    if isinstance(value, Mapping):
        return {str(key): as_json(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [as_json(item) for item in value]
    return value


def from_json(kind: Any, data: Any, where: str) -> Any:
    """A value of annotation `kind` from JSON.

    Raises: InputError: the place, what was found there and what was expected; a key that the record does not know.
    """
    if is_dataclass(kind) and isinstance(kind, type):
        return _record(kind, data, where)
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        wanted = next(a for a in arguments if a is not type(None))
        return None if data is None else from_json(wanted, data, where)
    if origin is tuple:
        return _items(arguments, data, where)
    if origin is not None and issubclass(origin, Mapping):
        if not isinstance(data, dict):
            raise _unexpected(data, where, "an object")
        return {key: from_json(arguments[1], item, f"{where}.{key}") for key, item in data.items()}
    return _plain(kind, data, where)


def _record(kind: type, data: Any, where: str) -> Any:
    if not isinstance(data, dict):
        raise _unexpected(data, where, "an object")
    hints = _hints(kind)
    unknown = [key for key in data if key not in hints]
    if unknown:
        raise InputError(f"{where} has the key {unknown[0]!r}; expected: {', '.join(hints)}")
    missing = [f.name for f in fields(kind) if f.name not in data and _default(f) is MISSING]
    if missing:
        raise InputError(f"{where} has no key {missing[0]!r}; it has: {', '.join(data) or 'none'}")
    return kind(**{key: from_json(hints[key], item, f"{where}.{key}") for key, item in data.items()})


def _items(arguments: tuple[Any, ...], data: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(data, list):
        raise _unexpected(data, where, "a list")
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        return tuple(from_json(arguments[0], item, f"{where}[{i}]") for i, item in enumerate(data))
    if len(data) != len(arguments):
        raise _unexpected(data, where, f"{len(arguments)} values")
    return tuple(from_json(a, item, f"{where}[{i}]") for i, (a, item) in enumerate(zip(arguments, data)))


def _plain(kind: type, data: Any, where: str) -> Any:
    # In Python a bool is an int; in a file it is not. A number without a fraction may be written as an integer.
    fits = isinstance(data, (int, float) if kind is float else kind) and (kind is bool or not isinstance(data, bool))
    if not fits:
        raise _unexpected(data, where, _WORDS[kind])
    return float(data) if kind is float else data


def _default(f: Field[Any]) -> Any:
    if f.default_factory is not MISSING:
        return f.default_factory()
    return f.default


def _is_default(f: Field[Any], value: Any) -> bool:
    """Whether it is the class's own; NaN, which stands for a number that is not known, is no other than itself."""
    default = _default(f)
    return value is default or value == default or (isinstance(value, float) and isnan(value) and default != default)


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _unexpected(data: Any, where: str, expected: str) -> InputError:
    return InputError(f"{where} is {json.dumps(data)[:60]}, expected {expected}")
