"""Boards fainter than 8 bits can show, on a gradient that fills them: found in what the file has more."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest
from tests.detection.chessboard_pictures import Lens, corners, facing, picture

from calibrant.detection import detect
from calibrant.detection.images.faint import flattened
from calibrant.detection.images.images import to_grey8
from calibrant.detection.pipeline import FAINT_NOTE
from calibrant.errors import DetectionError
from calibrant.targets.chessboard import Chessboard

TARGET = Chessboard(9, 6, 0.025)
LENS = Lens(580.0, 320.0, 256.0)
POSE = facing(9, 6, LENS, distance=15, tilt_deg=20, axis_deg=30, roll_deg=5)


@cache
def drawn_board() -> np.ndarray:
    """8 bits (512, 640)."""
    return picture(9, 6, POSE, LENS, (640, 512), seed=1)


def thermal(contrast: float, seed: int) -> np.ndarray:
    """16 bits (512, 640): a board of that contrast, noise of 2 % of it, on light that triples."""
    drawn = drawn_board().astype(np.float64)
    y, x = np.mgrid[:512, :640]
    light = 8000.0 * (1.0 + 2.0 * (x / 640) ** 1.5) * (1.0 + 0.3 * np.sin(y / 200.0))
    noise = np.random.default_rng(seed).normal(0.0, 0.02 * contrast, drawn.shape)
    return np.rint(light * (1.0 + contrast * (drawn / 255.0 - 0.5) + noise)).astype(np.uint16)


@pytest.mark.parametrize("contrast", [0.01, 0.03])
def test_a_faint_board_on_a_gradient_is_found_where_it_is(tmp_path, contrast):
    cv2.imwrite(str(tmp_path / "thermal.png"), thermal(contrast, seed=1))
    found = detect(tmp_path, target=TARGET)
    (view,) = found.views
    assert FAINT_NOTE in found.notes
    error = view.uv - corners(9, 6, POSE, LENS)[view.point_ids]
    assert len(view) == 54
    assert np.sqrt((error**2).mean()) < 0.1


def test_what_eight_bits_show_is_measured_in_them(tmp_path):
    deep = drawn_board().astype(np.uint16) * 257
    cv2.imwrite(str(tmp_path / "deep.png"), deep)
    cv2.imwrite(str(tmp_path / "shallow.png"), to_grey8(deep))
    found = detect(tmp_path, target=TARGET)
    assert FAINT_NOTE not in found.notes
    assert np.array_equal(found.views[0].uv, found.views[1].uv)


def test_noise_alone_shows_no_board(tmp_path):
    noise = np.random.default_rng(2).normal(9000.0, 30.0, (256, 320)).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "noise.png"), noise)
    with pytest.raises(DetectionError, match="0 of 1"):
        detect(tmp_path, target=TARGET)


def test_pictures_of_eight_bits_are_not_looked_at_twice(tmp_path):
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((50, 60), 99, np.uint8))
    cv2.imwrite(str(tmp_path / "same.png"), np.full((50, 60), 9900, np.uint16))
    assert not list(flattened(tmp_path / "grey.png"))
    assert not list(flattened(tmp_path / "same.png"))
