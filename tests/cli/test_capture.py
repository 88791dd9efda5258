"""calibrant capture, played by a folder of real photos."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from calibrant.cli.application import run


def test_a_folder_plays_the_camera(
    shared_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photos = str(shared_data("opencv_stereo_9x6") / "left*.jpg")
    out, to = tmp_path / "camera.json", tmp_path / "kept"
    words = ["capture", "--camera", photos, "--target", "chessboard:9x6:25mm", "--to", str(to), "--out", str(out)]
    assert run([*words, "--until", "2px"]) == 0
    said = capsys.readouterr().out
    assert "next: " in said
    result = json.loads(out.read_text())
    sigma = result["cameras"]["camera"]["sigma"]
    # It stops as soon as it may, and not before the camera is known as asked.
    assert max(sigma[name] for name in ("fx", "fy", "cx", "cy")) <= 2.0
    assert len(list(to.glob("*.png"))) == len(result["views"]) < 13


def test_views_that_do_not_suffice_are_refused(
    shared_data: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    photo = str(shared_data("opencv_stereo_9x6") / "left01.jpg")
    assert run(["capture", "--camera", photo, "--target", "chessboard:9x6:25mm"]) == 1
    assert "only 1 views" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--until", "1"], ["--to", "."], ["--target", "chessboard:9x6"]])
def test_bad_arguments(words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["capture", "--camera", "0", "--target", "chessboard:9x6:25mm", *words]) == 2
