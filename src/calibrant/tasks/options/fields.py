"""A Request spread into its single options, and built from their values: what every door is made from."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from calibrant.errors import InputError
from calibrant.tasks.options.option import Option


@dataclass(frozen=True)
class Field:
    """One option: of which class it is a field (its help stands there), its type and default (MISSING: required)."""

    name: str
    owner: type
    kind: Any
    default: Any
    option: Option

    @property
    def flag(self) -> str:
        """The option's name on a command line; a field whose name Python keeps for itself ends with a dash: from_."""
        return "--" + self.name.rstrip("_").replace("_", "-")

    @property
    def required(self) -> bool:
        return self.default is MISSING

    @property
    def inner(self) -> Any:
        """The type of a value that is given: `Path` of `Path | None`."""
        return inner_of(self.kind)

    @property
    def many(self) -> bool:
        """Whether it takes any number of values."""
        return get_origin(self.kind) is tuple

    @property
    def help(self) -> str:
        """The string below the field."""
        return helps_of(self.owner).get(self.name, "")


def spread(request: type) -> tuple[Field, ...]:
    """Every option of a Request, those of its groups in their place. Raises: TypeError for a name given twice."""
    found = tuple(_spread(request))
    names = [field.name for field in found]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise TypeError(f"{request.__module__}.{request.__qualname__} has two options {', '.join(sorted(twice))}")
    return found


def _spread(request: type) -> Iterator[Field]:
    hints = get_type_hints(request, include_extras=True)
    for field in fields(request):
        hint = hints[field.name]
        if is_dataclass(hint):
            yield from _spread(hint)  # type: ignore[arg-type]
            continue
        option = Option()
        if get_origin(hint) is Annotated:
            hint, *said = get_args(hint)
            option = next((s for s in said if isinstance(s, Option)), option)
        yield Field(field.name, request, hint, field.default, option)


def build(request: type, values: Mapping[str, Any]) -> Any:
    """The Request, or a group of it, with these values of its options; the others have their defaults.

    Raises: InputError for a value of a kind that the option does not take.
    """
    hints = get_type_hints(request)
    given: dict[str, Any] = {}
    for field in fields(request):
        if is_dataclass(hints[field.name]):
            given[field.name] = build(hints[field.name], values)
        elif field.name in values:
            given[field.name] = _taken(field.name, hints[field.name], values[field.name])
    return request(**given)


def _taken(name: str, kind: Any, value: Any) -> Any:
    """A value as its field wants it: paths and texts for each other, one for many, NAME=VALUE for a mapping, and the
    spec of a target for the target."""
    value = _said(value)
    if value is None and NoneType in get_args(kind):
        return None
    wanted = inner_of(kind)
    if get_origin(wanted) is tuple:
        return tuple(words_of(name, value))
    if wanted is Path and isinstance(value, str | Path):
        return Path(value)
    if wanted is str and isinstance(value, str | Path):
        return str(value)
    if int in get_args(kind) and isinstance(value, int) and not isinstance(value, bool):
        return value
    if wanted is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if isinstance(wanted, type) and isinstance(value, wanted) and (wanted is bool or not isinstance(value, bool)):
        return value
    number = "a whole number, " if int in get_args(kind) else ""
    what = "True or False" if wanted is bool else "text or a path" if wanted in (str, Path) else str(wanted)
    raise InputError(f"{name} takes {number}{what}, got {value!r}")


def _said(value: Any) -> Any:
    """The text that says what a target is; anything else as it stands."""
    spec = getattr(value, "spec", None)
    return spec if isinstance(spec, str) else value


def inner_of(kind: Any) -> Any:
    """The type beside None."""
    return next(k for k in get_args(kind) if k is not NoneType) if NoneType in get_args(kind) else kind


def words_of(name: str, value: Any) -> Iterator[str]:
    """The texts of one value, of several, or of several by name, NAME=VALUE. Raises: InputError for anything else."""
    value = _said(value)
    if isinstance(value, str | Path):
        yield str(value)
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            yield from (f"{key}={word}" for word in words_of(name, inner))
    elif isinstance(value, Iterable):
        for word in map(_said, value):
            if not isinstance(word, str | Path):
                raise InputError(f"{name} takes texts or paths, got {word!r} among them")
            yield str(word)
    else:
        raise InputError(f"{name} takes a text, a path, several of them, or a dictionary by name; got {value!r}")


@cache
def helps_of(owner: type) -> Mapping[str, str]:
    """The strings below the fields of a class and of those it is made from, on one line each."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
    body = tree.body if isinstance(tree, ast.ClassDef) else []
    out: dict[str, str] = {}
    for base in owner.__bases__:
        out |= helps_of(base) if is_dataclass(base) else {}
    for field, below in pairwise(body):
        text = below.value.value if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) else None
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, str):
            out[field.target.id] = " ".join(text.split())
    return out
