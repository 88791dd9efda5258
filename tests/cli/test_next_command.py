"""The command that goes on: inputs kept, outputs left, patterns of photos as a person wrote them."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrant.cli.command import Command, parse
from calibrant.cli.next_command import next_command
from calibrant.tasks.outcome import NextStep


def told(words: list[str], command: str = "hand-eye", *more: str) -> str:
    return next_command(NextStep("go on", command, more), parse(Command.of("doctor"), words))


@pytest.fixture
def photos(tmp_path: Path) -> list[str]:
    folder = tmp_path / "my photos"
    folder.mkdir()
    files = [folder / f"{i}.png" for i in range(5)]
    for file in files:
        file.touch()
    (folder / "notes.txt").touch()
    return [str(f) for f in files]


def test_what_a_shell_made_of_a_pattern_is_the_pattern_again(photos: list[str]) -> None:
    folder = Path(photos[0]).parent
    given = ["--images", *photos, "-t", "chessboard:9x6:25mm", "--poses", "p.csv"]
    assert told(given) == f"calibrant hand-eye --images '{folder}'/*.png --target chessboard:9x6:25mm --poses p.csv"
    # Not all of the folder: the names as they were given.
    assert "4.png" in told(["--images", *photos[1:], "--poses", "p.csv"])


def test_outputs_and_options_of_this_command_alone_are_left_out() -> None:
    given = ["--apply", "--poses=p.csv", "--target-poses", "t.csv", "--out", "a.json", "--repaired-poses", "r.csv"]
    assert told([*given, "-q", "--force"], "hand-eye", "--out", "b c.json") == (
        "calibrant hand-eye --poses p.csv --target-poses t.csv --out 'b c.json'"
    )
    assert told([*given, "--json"], "doctor") == "calibrant doctor --apply --poses p.csv --target-poses t.csv"
