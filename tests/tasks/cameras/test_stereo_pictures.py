"""The images of a pair: a camera that saw no board is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.errors import DetectionError
from calibrant.geometry import se3
from calibrant.opencv import cv2
from calibrant.simulate.render import render
from calibrant.simulate.scenes import standard_camera
from calibrant.targets.registry import parse_target


def test_a_camera_that_saw_no_board_is_named(tmp_path: Path) -> None:
    target, rng = parse_target("chessboard:9x6:25mm"), np.random.default_rng(0)
    T = se3.make(np.eye(3), np.array([0.0, 0.0, 0.6]) - target.points.mean(axis=0))
    shown = render(target.artwork(), standard_camera(), T, rng=rng)
    for side, picture in (("left", shown), ("right", np.full_like(shown, 90))):
        for k in range(2):
            (tmp_path / side).mkdir(exist_ok=True)
            cv2.imwrite(str(tmp_path / side / f"{k}.png"), np.clip(picture + rng.normal(0, 2, shown.shape), 0, 255))
    with pytest.raises(DetectionError, match="camera right: 0 of 2 boards found"):
        cb.stereo(left=tmp_path / "left", right=tmp_path / "right", target="chessboard:9x6:25mm")
