"""Options of the commands about projects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Annotated, Any

from calibrant.tasks.options.fields import spread
from calibrant.tasks.options.option import Option


@dataclass(frozen=True, kw_only=True)
class ProjectOptions:
    """Which project."""

    project: Annotated[Path, Option("DIR")] = Path()
    """The project's folder; this one unless given."""


def command_line(command: str, request: Any, *, but: Sequence[str] = ("project", "folder")) -> str:
    """The command that a request is, as the journal of its project keeps it: without the project's own folder, which
    may be moved."""
    from shlex import quote

    words = ["calibrant", *command.split()]
    for field in spread(type(request)):
        value = _value_of(request, field.name)
        if field.name in but or value in (None, False, ()) or (field.default is not MISSING and value == field.default):
            continue
        values = [] if value is True else [str(v) for v in (value if isinstance(value, tuple) else [value])]
        words += [quote(v) for v in values] if field.option.positional else [field.flag, *map(quote, values)]
    return " ".join(words)


def _value_of(request: Any, name: str) -> Any:
    """A field of a request, or of one of its groups."""
    if hasattr(request, name):
        return getattr(request, name)
    groups = [v for v in vars(request).values() if hasattr(v, "__dataclass_fields__")]
    return next(_value_of(group, name) for group in groups if name in {f.name for f in spread(type(group))})
