"""calibrant capture, played by a folder of real photos."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.cli.application import run
from calibrant.tasks.listener import Listener


class Heard(Listener):
    """Keeps every note."""

    def __init__(self) -> None:
        self.notes: list[str] = []

    def note(self, text: str) -> None:
        self.notes.append(text)


def test_a_folder_plays_the_camera(
    shared_data: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard = Heard()
    monkeypatch.setattr("calibrant.cli.progress.listener", lambda *, silent: heard)
    photos = str(shared_data("opencv_stereo_9x6") / "left*.jpg")
    out, to = tmp_path / "camera.json", tmp_path / "kept"
    words = ["capture", "--camera", photos, "--target", "chessboard:9x6:25mm", "--to", str(to), "--out", str(out)]
    assert run([*words, "--until", "3px"]) == 0
    assert "next: " in "\n".join(heard.notes)
    result = json.loads(out.read_text())
    sigma = result["cameras"]["camera"]["sigma"]
    # It stops as soon as it may, and not before the camera is known as asked.
    assert max(sigma[name] for name in ("fx", "fy", "cx", "cy")) <= 3.0
    assert len(list(to.glob("*.png"))) == len(result["views"])
    # Nor while a check of the result would ask for more views.
    asks = next(c["status"] for c in result["checks"] if c["name"] == "views") != "ok"
    assert not asks or "next: " in heard.notes[-1]


def test_views_that_do_not_suffice_are_refused(
    shared_data: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    photo = str(shared_data("opencv_stereo_9x6") / "left01.jpg")
    assert run(["capture", "--camera", photo, "--target", "chessboard:9x6:25mm"]) == 1
    assert "only 1 view was worth keeping" in capsys.readouterr().err


def test_a_video_of_a_board_that_hardly_stands_still_says_so_and_keeps_what_was_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    squares = (np.add.outer(np.arange(5), np.arange(6)) % 2 * 255).astype(np.uint8)
    board = cv2.copyMakeBorder(np.kron(squares, np.ones((30, 30), np.uint8)), *[25] * 4, cv2.BORDER_CONSTANT, value=255)
    writer = cv2.VideoWriter(str(tmp_path / "video.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10, (640, 480))
    # Still for three frames, then carried to the right.
    for shift in (0, 0, 0, *range(20, 200, 20)):
        frame = np.full((480, 640), 120, np.uint8)
        frame[100 : 100 + board.shape[0], 50 + shift : 50 + shift + board.shape[1]] = board
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    words = ["capture", "--camera", str(tmp_path / "video.avi"), "--target", "chessboard:5x4:25mm"]
    assert run([*words, "--to", str(tmp_path / "kept")]) == 1
    said = capsys.readouterr().err
    assert "only 1 view was worth keeping, a calibration needs 3" in said
    assert "10 with the board moving, 1 like views kept before" in said
    assert "Hold the board still" in said
    assert [p.name for p in (tmp_path / "kept").iterdir()] == ["000001.png"]
    assert str(tmp_path / "kept") in said
    assert run(words) == 1
    assert "--to DIR keeps them" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--until", "1"], ["--to", "."], ["--target", "chessboard:9x6"]])
def test_bad_arguments(words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["capture", "--camera", "0", "--target", "chessboard:9x6:25mm", *words]) == 2
