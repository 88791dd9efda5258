"""Completion of commands and options in a person's shell, as cyclopts makes it."""

from __future__ import annotations

from calibrant.cli.command import Command, collector
from calibrant.errors import InputError
from calibrant.tasks.registry import GROUPS, TASKS


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
        command = collector(Command.of(name))
        (groups[first] if second else app).command(command, name=second or first)
    try:
        path = app.install_completion()
    except (ShellDetectionError, CycloptsError, OSError) as error:
        raise InputError(f"no completion for this shell: {error}; bash, zsh and fish have one") from None
    return f"Written: {path}\nIt works in shells that are started from now on.\n"
