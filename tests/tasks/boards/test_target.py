"""calibrant target: writes the artwork and its spec, or nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrant.errors import InputError
from calibrant.targets.registry import parse_target
from calibrant.tasks.boards.target import Request
from calibrant.tasks.boards.target import run as run_task
from calibrant.tasks.writing import check_writable, write_documents

SPEC = "charuco:4x5:30mm:18mm:DICT_5X5_100"


def run(spec: str, *, out: Path, force: bool = False) -> str:
    """The task with its documents written, as every door does it; returns what a person is told."""
    check_writable(out, force=force)
    outcome = run_task(Request(spec=spec, out=out))
    write_documents(outcome.documents, force=force)
    assert outcome.summary is not None
    return str(outcome.summary())


@pytest.mark.parametrize("ending", ["pdf", "svg", "png", "PDF"])
def test_artwork_and_spec_are_written(tmp_path: Path, ending: str) -> None:
    out = tmp_path / f"board.{ending}"
    text = run(SPEC, out=out)
    assert out.stat().st_size > 1000
    assert parse_target(str(tmp_path / "board.yaml")) == parse_target(SPEC)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([out.name, "board.yaml"])
    assert "Print at 100 %" in text


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("chessboard:9x6:25mm", []),
        ("chessboard:9x9:15mm", ["looks the same turned by 180 degrees", "one even and one odd count"]),
        ("circles:6x6:20mm", ["looks the same turned by 90 degrees", ":bigdot"]),
        ("chessboard:9x6:40mm", ["does not fit on A4: this is A2"]),
    ],
)
def test_what_a_board_cannot_tell_is_said_before_it_is_printed(tmp_path: Path, spec: str, words: list[str]) -> None:
    told = " ".join(run_task(Request(spec=spec, out=tmp_path / "board.pdf")).warnings)
    assert bool(told) == bool(words)
    for word in words:
        assert word in told


def test_the_same_spec_gives_the_same_bytes(tmp_path: Path) -> None:
    run(SPEC, out=tmp_path / "a.pdf")
    run(SPEC, out=tmp_path / "b.pdf")
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()


@pytest.mark.parametrize("existing", ["board.pdf", "board.yaml"])
def test_files_of_the_user_are_kept(tmp_path: Path, existing: str) -> None:
    (tmp_path / existing).write_text("mine")
    with pytest.raises(InputError, match=f"{existing} exists already.*--force"):
        run(SPEC, out=tmp_path / "board.pdf")
    assert [p.name for p in tmp_path.iterdir()] == [existing]
    run(SPEC, out=tmp_path / "board.pdf", force=True)
    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("spec", "name", "message"),
    [
        (SPEC, "board.jpg", "must be one of .pdf, .svg, .png"),
        (SPEC, "missing/board.pdf", "there is no folder"),
        ("charuco:4x5:30mm:40mm:DICT_5X5_100", "board.pdf", "must be smaller"),
    ],
)
def test_nothing_is_written_when_something_is_wrong(tmp_path: Path, spec: str, name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        run(spec, out=tmp_path / name)
    assert list(tmp_path.iterdir()) == []
