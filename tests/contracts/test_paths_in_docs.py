"""What the documents call by its path is there."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BASES = (ROOT, ROOT / "src" / "calibrant", ROOT / "docs")
"""Where a path may start: a file of the package is named from the package."""

DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]

_PATH = re.compile(r"`([A-Za-z_.][\w.-]*(?:/[\w.-]+)*/?)`")
_PLACEHOLDER = "NAME"


def named_paths(text: str) -> Iterator[str]:
    """Words in backticks that look like a file or folder of the tree: a Python file, or a path whose start is there."""
    for match in _PATH.finditer(text):
        path = match[1]
        starts = "/" in path.rstrip("/") and any((base / path.partition("/")[0]).is_dir() for base in BASES)
        if path.endswith(".py") or (starts and not path.startswith(".")):
            yield path


def is_there(path: str) -> bool:
    """Whether the path, or for one with a placeholder its folder, exists; a bare file name may lie anywhere in src."""
    if _PLACEHOLDER in path:
        path = path[: path.index(_PLACEHOLDER)]
        return not path or is_there(path)
    if any((base / path).exists() for base in BASES):
        return True
    return "/" not in path and any((ROOT / "src").rglob(path))


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda d: d.relative_to(ROOT).as_posix())
def test_every_path_in_a_document_is_there(document: Path) -> None:
    assert [p for p in named_paths(document.read_text(encoding="utf-8")) if not is_there(p)] == []


def test_a_path_that_is_not_there_is_seen() -> None:
    text = "see `calibrate/nothing.py`, `cameras/registry.py`, `cameras/NAME.py`, `lost/NAME.py`, `se3.py`"
    found = list(named_paths(f"{text}, `out/a.json`, `good/`"))
    assert found == ["calibrate/nothing.py", "cameras/registry.py", "cameras/NAME.py", "lost/NAME.py", "se3.py"]
    assert [p for p in found if not is_there(p)] == ["calibrate/nothing.py", "lost/NAME.py"]
