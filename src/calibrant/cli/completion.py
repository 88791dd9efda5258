"""Completion of commands and options in a person's shell, as cyclopts makes it."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Annotated, Any, Literal

from calibrant.cli.command import Command, collector
from calibrant.errors import InputError
from calibrant.tasks.options.fields import Field
from calibrant.tasks.registry import GROUPS, TASKS

FILES = ("FILE", "IMAGE", "DIR")
"""How the names of values begin that are files or folders."""


def install() -> str:
    """Write the completion script of the shell that runs this, and have the shell read it; says where it is.

    Raises: InputError where the shell is none that is known.
    """
    from cyclopts import App, CycloptsError
    from cyclopts.completion.detect import ShellDetectionError

    app = App(name="calibrant", help_flags=("--help", "-h"), version_flags=("--version",))
    groups = {name: App(name=name, help=words) for name, words in GROUPS.items()}
    for group in groups.values():
        app.command(group)
    for name in TASKS:
        first, _, second = name.partition(" ")
        (groups[first] if second else app).command(_completed(Command.of(name)), name=second or first)
    try:
        path = app.install_completion()
        # Bash alone: folders get their slash, and where nothing is known files are offered, as without completion.
        path.write_text(path.read_text().replace("complete -F ", "complete -o filenames -o bashdefault -o default -F "))
    except (ShellDetectionError, CycloptsError) as error:
        raise InputError(f"no completion for this shell: {error}; bash, zsh and fish have one") from None
    except OSError as error:
        raise InputError(f"cannot write the completion {error.filename}: {error.strerror}") from None
    return (
        f"Written: {path}\nA line at the end of your shell's start-up file reads it (fish reads it without one). "
        "It works in shells that are started from now on.\n"
    )


def _completed(command: Command) -> Any:
    """The command's function with types that a shell can complete: files, and words to choose from."""
    collected = collector(command)
    kinds = {field.name: _completed_kind(field) for field in command.fields}
    signature = inspect.signature(collected)
    parameters = [
        p.replace(annotation=Annotated[kinds[p.name], p.annotation.__metadata__[0]])
        for p in signature.parameters.values()
    ]
    collected.__signature__ = signature.replace(parameters=parameters)
    collected.__annotations__ = {p.name: p.annotation for p in parameters}
    return collected


def _completed_kind(field: Field) -> Any:
    """The type by which cyclopts completes a field's value."""
    if field.option.metavar.startswith(FILES):
        return tuple[Path, ...] if field.many and not field.option.positional else Path
    words = field.option.choices or (tuple(field.option.metavar.split("|")) if "|" in field.option.metavar else ())
    if words:
        one: Any = Literal[words]
        return tuple[one, ...] if field.many else one
    return str if field.many and field.option.positional else field.kind
