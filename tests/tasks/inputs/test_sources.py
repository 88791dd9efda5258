"""Which photos are meant, and what they are called where folders hold files of one name."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrant.errors import InputError
from calibrant.tasks.inputs.sources import Source
from calibrant.tasks.options.images import SearchOptions


@pytest.fixture
def two_folders(tmp_path: Path) -> tuple[str, ...]:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        for i in range(2):
            (tmp_path / folder / f"img_0{i}.png").write_bytes(b"")
    return str(tmp_path / "a"), str(tmp_path / "b")


def source(images: tuple[str, ...], *exclude: str) -> Source:
    return Source(images=images, target="chessboard:9x6:25mm", search=SearchOptions(exclude=exclude))


def test_files_of_one_name_are_told_apart(two_folders: tuple[str, ...]) -> None:
    with pytest.raises(InputError, match=r"there are a/img_00\.png, a/img_01\.png, b/img_00\.png, b/img_01\.png$"):
        source(two_folders, "other.png").files()


def test_a_name_with_its_folder_leaves_out_that_photo_alone(two_folders: tuple[str, ...]) -> None:
    kept = [f"{f.parent.name}/{f.name}" for f in source(two_folders, "b/img_00.png").files()]
    assert kept == ["a/img_00.png", "a/img_01.png", "b/img_01.png"]
    assert [f.parent.name for f in source(two_folders, "img_00.png").files()] == ["a", "b"]
