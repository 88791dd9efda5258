"""tests/ mirrors src/: who moves a module finds its tests in the folder of the same name, and moves them too."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WITHOUT_A_PACKAGE = {"contracts"}
"""Rules that hold for the whole house."""


def folders() -> list[Path]:
    """Folders of tests/ that hold Python files."""
    return sorted({file.parent.relative_to(ROOT / "tests") for file in (ROOT / "tests").rglob("*.py")} - {Path()})


@pytest.mark.parametrize("folder", folders(), ids=str)
def test_a_folder_of_tests_has_its_room(folder: Path) -> None:
    room = ROOT / "src" / "calibrant" / folder
    assert str(folder) in WITHOUT_A_PACKAGE or room.is_dir() or room.with_suffix(".py").is_file(), (
        f"tests/{folder} stands beside nothing: src/calibrant has no {folder}"
    )
