"""Every command has an example line in the docs, and every example line names commands and options that exist."""

from __future__ import annotations

import re
import shlex
from functools import cache
from pathlib import Path

import pytest

from calibrant.cli.command import Command
from calibrant.cli.help import command_help
from calibrant.tasks.registry import TASKS

DOCS = Path(__file__).parents[2] / "docs"
LINE = re.compile(r"^(?: {4})?(calibrant [a-z].*)$", re.MULTILINE)


@cache
def commands() -> dict[tuple[str, ...], set[str]]:
    """The options of every command by its words, ("tool", "touch")."""
    return {tuple(name.split()): Command.of(name).flags for name in TASKS}


def lines() -> list[tuple[str, list[str]]]:
    found = []
    for file in (DOCS.parent / "README.md", *sorted(DOCS.glob("*.md"))):
        for text in LINE.findall(re.sub(r"\\\n\s*", "", file.read_text(encoding="utf-8"))):
            found.append((file.name, shlex.split(text, comments=True)[1:]))
    return found


def words_of(words: list[str]) -> tuple[str, ...] | None:
    return next((key for key in commands() if tuple(words[: len(key)]) == key), None)


@pytest.mark.parametrize("name", TASKS)
def test_examples_in_help_are_whole_commands(name: str) -> None:
    """Copied as they stand: one line, or lines that a backslash joins."""
    shown = "\n".join(
        re.sub("^  ", "", line) for line in command_help(Command.of(name)).split("Options:")[0].splitlines()
    )
    paragraphs = [p for p in shown.split("\n\n") if p.startswith("calibrant ")]
    assert paragraphs
    for text in "\n".join(re.sub(r"\\\n\s*", "", p) for p in paragraphs).splitlines():
        words = re.sub(r"\[|\]", "", text).split()
        assert words[0] == "calibrant", text
        assert words_of(words[1:]) == tuple(name.split()), text
        assert {w for w in words if w.startswith("--")} <= set(Command.of(name).flags), text


def test_every_command_has_an_example_line() -> None:
    shown = {words_of(words) for name, words in lines() if name == "commands.md"}
    missing = sorted(" ".join(key) for key in commands() if key not in shown and key[0] != "study")
    assert not missing


@pytest.mark.parametrize(("file", "words"), lines(), ids=lambda value: value if isinstance(value, str) else None)
def test_example_lines_use_options_that_exist(file: str, words: list[str]) -> None:
    key = words_of(words)
    assert key is not None, f"{file}: no command {' '.join(words[:2])}"
    assert {w for w in words if w.startswith("--")} <= commands()[key]
