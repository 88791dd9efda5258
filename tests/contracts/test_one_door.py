"""Files are read through one door, `calibrant.reading.files`: it knows pipes, devices, and how large is too large."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from docs.house import parsed

import calibrant

PACKAGE = Path(calibrant.__file__).parent
OPENS = {"read_text", "read_bytes", "open", "load", "loadtxt", "genfromtxt", "fromfile", "imread", "memmap", "fdopen"}
"""Names of functions and methods that open a file by its name."""
OF_OTHERS = {"json", "yaml", "entry", "task", "command", "resources", "parser", "zipfile", "tarfile", "pickle"}
ALLOWED = {
    "reading/files.py": "the door",
    "data/result_file.py": "writes",
    "tasks/writing.py": "writes",
    "reports/page.py": "the package's own templates",
    "formats/projects/lock.py": "a lock, in which who holds it stands",
    "formats/projects/folder.py": "a folder's names brought onto the disk",
    "compiled.py": "the package's own code",
    "executors.py": "the script that runs, which Python has read already",
    "detection/cache.py": "the package's own code",
    "ros/side.py": "its own standard output",
    "cli/completion.py": "the shell's script, which it has just written",
}


def openings(file: Path) -> Iterator[tuple[int, str]]:
    """Line and name of every call that opens a file by itself."""
    tree = parsed(file)
    door = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("calibrant.reading")
        for alias in node.names
    }
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        called = node.func
        if isinstance(called, ast.Attribute) and called.attr in OPENS:
            of = called.value.id if isinstance(called.value, ast.Name) else ""
            inside_archive = of == "archive"
            numpys = called.attr in ("load", "loadtxt", "genfromtxt", "fromfile", "memmap") and of not in (
                "np",
                "numpy",
            )
            inside_stream = any(k.arg == "fileobj" for k in node.keywords)
            if not inside_archive and not inside_stream and not numpys and of not in OF_OTHERS:
                yield node.lineno, called.attr
        elif isinstance(called, ast.Name) and called.id in OPENS - door:
            yield node.lineno, called.id


def test_no_reader_opens_a_file_by_itself() -> None:
    found = {
        f"{name}:{line}": call
        for file in sorted(PACKAGE.rglob("*.py"))
        if (name := file.relative_to(PACKAGE).as_posix()) not in ALLOWED
        for line, call in openings(file)
    }
    assert found == {}, "read it with calibrant.reading.files"


def test_the_exceptions_are_there() -> None:
    assert [name for name in ALLOWED if not (PACKAGE / name).is_file()] == []
