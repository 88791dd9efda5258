"""Every option that a message of the house names is one of a command."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import calibrant
from calibrant.cli.command import Command
from calibrant.tasks.registry import TASKS

PACKAGE = Path(calibrant.__file__).parent
FOREIGN = {"--help", "--version", "--install-completion"}


def test_advice_names_options_that_there_are() -> None:
    known = FOREIGN | {field.flag for name in TASKS for field in Command.of(name).fields}
    strange = []
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*[a-z]\b(?!-)", node.value)) - known
                strange += [f"{path.relative_to(PACKAGE)}:{node.lineno}: {flag}" for flag in sorted(named)]
    assert not strange, "\n".join(strange)
