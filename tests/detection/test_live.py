"""Which frames of a running camera are kept, and which view is asked for next."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.detection.detection import Detection
from calibrant.detection.live import Frame, Session, frames_from, view_numbers
from calibrant.errors import InputError
from calibrant.targets.chessboard import Chessboard

BOARD = Chessboard(6, 5, 0.02)
SHAPE = (480, 640)


def frame(*, blur: float = 0.0) -> Frame:
    """A running frame of fine texture, so that it is as sharp as it is not blurred."""
    grey = np.random.default_rng(0).integers(0, 256, SHAPE).astype(np.uint8)
    return Frame("f", cv2.GaussianBlur(grey, (0, 0), blur) if blur else grey, running=True)


def seen(x: float, y: float, *, scale: float = 2000.0, shear: float = 0.0) -> Detection:
    """The board with its first corner at (x, y) px, `scale` px a metre, its rows sheared."""
    points = BOARD.points[:, :2] * scale
    uv = np.column_stack([points[:, 0] + shear * points[:, 1] + x, points[:, 1] + y])
    return Detection(BOARD.point_ids, uv)


def kept(session: Session, detection: Detection, **look: float) -> tuple[Session, str | None]:
    """The session after the board stood still for two frames."""
    session, _ = replace(session, last=detection), None
    return session.look(frame(**look), detection)


def test_a_board_must_stand_still_be_sharp_and_be_new() -> None:
    start = Session(BOARD)
    after, reason = start.look(frame(), seen(100, 100))
    assert reason == "moving"
    after, reason = after.look(frame(), seen(100.3, 100))
    assert reason is None
    assert kept(after, seen(110, 100))[1] == "seen before"
    assert kept(after, seen(400, 300), blur=2.0)[1] == "not sharp"
    assert kept(after, seen(400, 300))[1] is None
    assert after.look(frame(), Detection.nothing("none"))[1] == "no board"


def test_the_four_numbers() -> None:
    at_left_top, at_right_bottom = (view_numbers(BOARD, d, SHAPE) for d in (seen(0, 0), seen(440, 320)))
    assert at_left_top is not None
    assert at_right_bottom is not None
    assert at_left_top[0] < 0.1 < 0.9 < at_right_bottom[0]
    assert at_left_top[1] < 0.1 < 0.9 < at_right_bottom[1]
    np.testing.assert_allclose(at_left_top[2] ** 2, 200 * 160 / (640 * 480), rtol=1e-9)
    sheared = view_numbers(BOARD, seen(100, 100, shear=np.tan(0.2)), SHAPE)
    assert sheared is not None
    # A corner off its right angle by 0.2 rad.
    np.testing.assert_allclose([at_left_top[3], sheared[3]], [0.0, 0.4], atol=1e-6)


def test_what_is_missing_is_asked_for() -> None:
    session = Session(BOARD)
    assert session.missing() is not None
    for x, y, scale, shear in ((0, 0, 1500, 0), (480, 0, 1500, 0), (0, 350, 1500, 0.3), (480, 350, 1500, 0.3)):
        session, reason = kept(session, seen(x, y, scale=scale, shear=shear))
        assert reason is None
    assert session.coverage()["X"] == session.coverage()["Y"] == session.coverage()["skew"] == 1.0
    assert session.missing() == "hold the board nearer"
    session, _ = kept(session, seen(20, 20, scale=5500))
    assert session.missing() is None


def test_sources(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "2.png"), np.zeros((10, 20), np.uint8))
    cv2.imwrite(str(tmp_path / "10.png"), np.zeros((10, 20), np.uint8))
    assert [(f.name, f.running, f.grey.shape) for f in frames_from(str(tmp_path))] == [
        ("2.png", False, (10, 20)),
        ("10.png", False, (10, 20)),
    ]
    (tmp_path / "broken.mp4").write_bytes(b"nothing")
    for source in ("missing.mp4", str(tmp_path / "broken.mp4")):
        with pytest.raises(InputError, match="cannot be opened"):
            next(frames_from(source))
