"""The worked examples of docs/conventions.md hold."""

from __future__ import annotations

import doctest
from pathlib import Path


def test_the_examples_of_the_conventions_hold() -> None:
    page = Path(__file__).resolve().parents[2] / "docs" / "conventions.md"
    result = doctest.testfile(str(page), module_relative=False, encoding="utf-8")
    assert result.attempted > 10
    assert result.failed == 0
