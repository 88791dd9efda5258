"""Writes `verbs.pyi`, by which type checkers and editors know the verbs: python -m calibrant.tasks.signatures"""

from __future__ import annotations

import inspect
from pathlib import Path

from calibrant.tasks.registry import TASKS
from calibrant.tasks.verbs import VERBS, signature_of

STUB = Path(__file__).with_name("verbs.pyi")
HEAD = '''# Written by calibrant.tasks.signatures from the Requests; a test says when it is old.
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from calibrant.data import CalibrationResult
from calibrant.tasks.registry import Entry, Task

Words = str | Path | Iterable[str | Path] | Mapping[str, str | Path | Iterable[str | Path]]
"""One value, several of them, or several by the name of a camera or robot."""

VERBS: dict[str, str]

def verb(name: str) -> Callable[..., CalibrationResult | None]: ...
def signature_of(task: Task) -> Any: ...
def documentation(name: str, entry: Entry, task: Task) -> str: ...
'''


def stub() -> str:
    """The text of the stub file."""
    return HEAD + "".join(_declared(verb, name) for verb, name in VERBS.items())


def _declared(verb: str, name: str) -> str:
    parameters = signature_of(TASKS[name].load()).parameters.values()
    lines, starred = [], False
    for parameter in parameters:
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY and not starred:
            lines.append("    *,")
            starred = True
        default = "" if parameter.default is inspect.Parameter.empty else f" = {_literal(parameter.default)}"
        lines.append(f"    {parameter.name}: {parameter.annotation}{default},")
    return f"def {verb}(\n" + "\n".join(lines) + "\n) -> CalibrationResult: ...\n"


def _literal(value: object) -> str:
    """A default as Python text, in double quotes."""
    return f'"{value}"' if isinstance(value, str | Path) else repr(value)


if __name__ == "__main__":
    STUB.write_text(stub(), encoding="utf-8")
