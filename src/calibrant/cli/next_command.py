"""The command line that goes on from one that was given: with its inputs, and other outputs."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path

from calibrant.cli.command import Call, Command
from calibrant.cli.outputs import OutputOptions
from calibrant.tasks.options.fields import Field
from calibrant.tasks.outcome import NextStep

_FEW = 3
"""Files that are named one by one; of more in one folder, a pattern says which."""


def next_command(step: NextStep, call: Call) -> str:
    """What a person can copy and run. Options that the other command does not have, and outputs, are left out."""
    other = Command.of(step.command)
    outputs = {f.name for f in fields(OutputOptions)}
    known = {f.name for f in other.fields if not f.option.output} - outputs
    words = [w for field, given in _options(call) if field.name in known for w in _written(field, given)]
    return " ".join(["calibrant", step.command, *words, *map(shlex.quote, step.more)])


def _options(call: Call) -> Iterator[tuple[Field, Sequence[str]]]:
    """Every option that was given, with its values in their words."""
    named = {flag: f for f in call.command.fields for flag in (f.flag, f.option.short) if flag}
    field = positional = next((f for f in call.command.fields if f.option.positional), None)
    values: list[str] = []
    for word in call.arguments:
        flag, _, value = word.partition("=")
        full = field is not None and not field.many and len(values) == (field.kind is not bool)
        if flag in named or full:
            if field is not None and (values or field.kind is bool):
                yield field, values
            field, values = (named[flag], [value] if value else []) if flag in named else (positional, [word])
        else:
            values.append(word)
    if field is not None and (values or field.kind is bool):
        yield field, values


def _written(field: Field, values: Sequence[str]) -> list[str]:
    name = [] if field.option.positional else [field.flag]
    return [*name, *_patterns(values)]


def _patterns(values: Iterable[str]) -> list[str]:
    """The values for a shell; what it made of a pattern is the pattern again."""
    by_kind: dict[tuple[Path, str], list[str]] = {}
    for value in values:
        path = Path(value)
        by_kind.setdefault((path.parent, path.suffix) if path.suffix else (path, ""), []).append(value)
    out: list[str] = []
    for (folder, suffix), given in by_kind.items():
        every = {p.name for p in folder.glob(f"*{suffix}")} if suffix and len(given) > _FEW else set()
        if every and {Path(v).name for v in given} == every:
            out.append(f"*{suffix}" if folder == Path() else f"{shlex.quote(str(folder))}/*{suffix}")
        else:
            out += map(shlex.quote, given)
    return out
