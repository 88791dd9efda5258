"""Documents are written all or none: what stood there before is there again, whatever goes wrong on the way."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from calibrant.errors import InputError
from calibrant.tasks.outcome import Document
from calibrant.tasks.writing import check_folder, check_writable, write_documents


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_all_are_written(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")
    documents = [Document(tmp_path / "a.txt", b"new"), Document(tmp_path / "made" / "b.txt", lambda: b"late")]
    assert write_documents(documents, force=True) == [tmp_path / "a.txt", tmp_path / "made" / "b.txt"]
    assert (tmp_path / "a.txt").read_bytes() == b"new"
    assert (tmp_path / "made" / "b.txt").read_bytes() == b"late"
    assert names(tmp_path) == ["a.txt", "made"]


def test_a_file_that_is_there_is_kept_without_force(tmp_path: Path) -> None:
    (tmp_path / "b.txt").write_text("old")
    with pytest.raises(InputError, match=r"b\.txt exists already; give another name, or --force to replace it"):
        write_documents([Document(tmp_path / "a.txt", b"a"), Document(tmp_path / "b.txt", b"b")], force=False)
    assert names(tmp_path) == ["b.txt"]


def test_one_name_for_two_documents(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="two outputs would be written to"):
        write_documents([Document(tmp_path / "a", b"1"), Document(tmp_path / "a", b"2")], force=False)
    assert names(tmp_path) == []


def test_a_document_that_cannot_be_made_leaves_nothing(tmp_path: Path) -> None:
    def fails() -> bytes:
        raise InputError("no picture")

    documents = [Document(tmp_path / "new" / "a", b"1"), Document(tmp_path / "new" / "b", fails)]
    with pytest.raises(InputError, match="no picture"):
        write_documents(documents, force=False)
    assert names(tmp_path) == []


def test_what_was_moved_comes_back_when_the_next_cannot_be(tmp_path: Path) -> None:
    """The third place becomes a folder after it was looked at: the files moved before it are as they were."""
    (tmp_path / "old.txt").write_text("old")

    def blocks() -> bytes:
        (tmp_path / "last.txt").mkdir()
        return b"3"

    texts = [Document(tmp_path / "new.txt", b"1"), Document(tmp_path / "old.txt", b"2")]
    with pytest.raises(InputError, match=r"cannot write .*last\.txt: .*; nothing was written"):
        write_documents([*texts, Document(tmp_path / "last.txt", blocks)], force=True)
    assert (tmp_path / "old.txt").read_text() == "old"
    assert names(tmp_path) == ["last.txt", "old.txt"]


def test_places_that_cannot_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="it is a folder; give a file name"):
        check_writable(tmp_path, force=True)
    with pytest.raises(InputError, match=r"there is no folder .*none; make it first"):
        check_writable(tmp_path / "none" / "a", force=True)
    with pytest.raises(InputError, match=r"--overlays .*file is a file; give a folder"):
        check_folder(tmp_path / "file", option="--overlays")
    with pytest.raises(InputError, match=r"--overlays .*there is no folder .*none; make it first"):
        check_folder(tmp_path / "none" / "a", option="--overlays")


def test_folders_that_may_not_be_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Said before the work; and where the system refuses only then, in words too."""
    with monkeypatch.context() as closed:
        closed.setattr("os.access", lambda path, mode: False)
        for path in (tmp_path, tmp_path / "new"):
            with pytest.raises(InputError, match=f"--overlays {path}: the folder {tmp_path} is not writable"):
                check_folder(path, option="--overlays")

    def refuse(path: Path) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(InputError, match=r"cannot make the folder .*new: Permission denied"):
        write_documents([Document(tmp_path / "new" / "a.txt", b"a")], force=False)


def test_an_interrupt_while_files_are_moved_waits_for_all_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a").write_text("old")
    move = Path.replace

    def interrupted(self: Path, target: str | Path) -> Path:
        os.kill(os.getpid(), signal.SIGINT)
        return move(self, target)

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt, match=r"interrupted; every file was written: .*a, .*b"):
        write_documents([Document(tmp_path / "a", b"new"), Document(tmp_path / "b", b"new")], force=True)
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"a": "new", "b": "new"}


def test_an_interrupt_before_leaves_nothing(tmp_path: Path) -> None:
    def stopped() -> bytes:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_documents([Document(tmp_path / "d" / "a", b"new"), Document(tmp_path / "b", stopped)], force=True)
    assert list(tmp_path.iterdir()) == []


def test_a_draft_follows_no_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "secret").write_text("untouched")
    names = iter(["first", "first", "second"])
    monkeypatch.setattr("calibrant.reading.files.secrets.token_hex", lambda n: next(names))
    (tmp_path / ".a.first.tmp").symlink_to(tmp_path / "secret")
    write_documents([Document(tmp_path / "a", b"new")], force=True)
    assert (tmp_path / "a").read_text() == "new"
    assert (tmp_path / "secret").read_text() == "untouched"


def test_folders_within_a_folder_that_is_written_as_a_whole(tmp_path: Path) -> None:
    whole = tmp_path / "mav0"
    write_documents(
        [Document(whole / "cam0" / "a.yaml", b"a", whole), Document(whole / "b.yaml", b"b", whole)], force=False
    )
    assert (whole / "cam0" / "a.yaml").read_bytes() + (whole / "b.yaml").read_bytes() == b"ab"

    def fails() -> bytes:
        raise InputError("not this one")

    other = tmp_path / "other"
    with pytest.raises(InputError, match="not this one"):
        write_documents([Document(other / "cam0" / "a.yaml", fails, other)], force=False)
    assert not other.exists()
    with pytest.raises(InputError, match="make it first"):
        write_documents([Document(tmp_path / "typed" / "wrong" / "a.yaml", b"a")], force=False)
    with pytest.raises(InputError, match="make it first"):
        write_documents(
            [Document(tmp_path / "no" / "other" / "a" / "a.yaml", b"a", tmp_path / "no" / "other")], force=False
        )
    assert not (tmp_path / "no").exists()
