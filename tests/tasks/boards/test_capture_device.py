"""`capture --camera-device`: a recorded camera plays, and its end is no error."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.devices.recorded.made import write_pictures

import calibrant as cb
from calibrant.errors import InputError, RefusedError


def test_recording_ends_and_what_was_taken_counts(tmp_path: Path) -> None:
    write_pictures(tmp_path)
    with pytest.raises(RefusedError, match="not kept: 4 without the board"):
        cb.capture(camera_device=f"folder:{tmp_path}", target="chessboard:9x6:25mm")


def test_one_camera_is_named(tmp_path: Path) -> None:
    for given in ({}, {"camera": "0", "camera_device": "opencv:0"}):
        with pytest.raises(InputError, match="name the camera"):
            cb.capture(target="chessboard:9x6:25mm", **given)
