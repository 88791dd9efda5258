"""Help as plain text: made from the Request alone, so that it costs no library."""

from __future__ import annotations

import inspect
import shutil
import textwrap
from collections.abc import Iterable, Sequence

from calibrant.cli.command import Command
from calibrant.tasks.options.fields import Field

WIDEST = 100
"""Columns of help on a wide terminal: longer lines are hard to read."""
NAMES = 34
"""Columns of options' names; a longer one has its words on the next line."""


def command_help(command: Command) -> str:
    """What `calibrant COMMAND --help` prints."""
    fields = command.fields
    positional = [f for f in fields if f.option.positional]
    named = [f for f in fields if not f.option.positional]
    optional = [f"[{f.option.metavar}]" if f.many or not f.required else f.option.metavar for f in positional]
    words = " ".join(["[OPTIONS]", *optional])
    parts = [f"Usage: calibrant {command.name} {words}", _paragraphs(inspect.getdoc(command.task.Request) or "")]
    if positional:
        parts.append(_section("Arguments", [(f.option.metavar, f.help) for f in positional]))
    rows = [(_names(f), f"{_help(f, command)}{_else(f)}") for f in named]
    parts.append(_section("Options", [*rows, ("-h, --help", "Show this message.")]))
    return "\n\n".join(parts) + "\n"


def group_help(group: str, words: str, commands: Iterable[tuple[str, str]]) -> str:
    """What `calibrant --help` prints, or `calibrant GROUP --help`: the commands, and one line of each."""
    rows = list(commands)
    options = [("-h, --help", "Show this message.")]
    if group == "calibrant":
        options.append(("--version", "Show the version."))
        options.append(("--install-completion", "Complete commands and options in this shell."))
    parts = [f"Usage: {group} COMMAND [ARGUMENTS]", _paragraphs(words), _section("Options", options)]
    return "\n\n".join([*parts, _section("Commands", rows)]) + "\n"


def _names(field: Field) -> str:
    names = f"{field.option.short}, {field.flag}" if field.option.short else field.flag
    return names if field.kind is bool else f"{names} {field.option.metavar or 'VALUE'}"


def _help(field: Field, command: Command) -> str:
    return command.entry.out if field.name == "out" and "out" in command.entry.outputs else field.help


def _else(field: Field) -> str:
    """What holds when the option is not given, where its words do not say it."""
    if field.required:
        return " Required."
    silent = field.kind is bool or field.default in (None, "", (), "auto") or "default" in field.help
    return "" if silent else f" Default: {field.default}."


def _width() -> int:
    return min(shutil.get_terminal_size((WIDEST, 24)).columns, WIDEST)


def _lines(text: str, width: int) -> list[str]:
    """The words in lines; what is typed as it stands (eye-in-hand, --without-marked) is not broken at its hyphens."""
    return textwrap.wrap(" ".join(text.split()), width, break_on_hyphens=False)


def _paragraphs(text: str) -> str:
    """Paragraphs filled to the width; lines that show a command stay as they are."""
    out = []
    for paragraph in text.split("\n\n"):
        shown = paragraph.lstrip().startswith("calibrant ")
        out.append(textwrap.indent(paragraph, "  ") if shown else "\n".join(_lines(paragraph, _width())))
    return "\n\n".join(out)


def _section(title: str, rows: Sequence[tuple[str, str]]) -> str:
    column = min(NAMES, max(len(name) for name, _ in rows) + 2, _width() // 2 - 2)  # words have half of a narrow one
    lines = [f"{title}:"]
    for name, words in rows:
        filled = _lines(words, _width() - column - 2) or [""]
        if len(name) + 2 > column:
            lines.append(f"  {name}")
        else:
            lines.append(f"  {name:{column}}{filled.pop(0)}".rstrip())
        lines += [f"  {'':{column}}{line}" for line in filled]
    return "\n".join(lines)
