"""docs/first-hand-eye.md shows what its commands print today."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.mark.long
def test_the_page_shows_what_its_commands_print(tmp_path: Path) -> None:
    """Word by word; figures may differ, as rounding does from one machine to the next."""
    spec = importlib.util.spec_from_file_location("first_hand_eye", DOCS / "first_hand_eye.py")
    assert spec is not None
    assert spec.loader is not None
    page_maker = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(page_maker)
    page_maker.make_sets(tmp_path)
    page = (DOCS / "first-hand-eye.md").read_text(encoding="utf-8")
    again = page_maker.refreshed(page, tmp_path, None)
    assert _words(page) == _words(again), "run `python docs/first_hand_eye.py --page` and look at what changed"


def _words(page: str) -> list[str]:
    return re.sub(r"[-\d.]+", "#", page).split()
