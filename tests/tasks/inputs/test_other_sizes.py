"""Images of another size than their camera's are left out, and a check of the result says which."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations
from calibrant.detection import detect
from calibrant.opencv import cv2
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import look_at_board
from calibrant.targets.registry import parse_target
from calibrant.tasks.inputs.session import with_misses

SPEC = "chessboard:6x5:30mm"


def seen(folder: Path, larger: int) -> Observations:
    """A board as printed, five pictures of it, so many of them at twice the size."""
    camera = Camera.create("pinhole", {"fx": 900.0, "fy": 900.0, "cx": 639.5, "cy": 479.5}, image_size=(1280, 960))
    rng, target = np.random.default_rng(2), parse_target(SPEC)
    T = look_at_board(camera, target.points, 1, rng=rng, distance=(0.4, 0.5))[0]
    grey = render(target.artwork(), camera, T, rng=rng, look=Look(clutter=0, noise_grey=2.0))
    for k in range(5):
        width = 640 if k >= larger else 1280
        picture = cv2.resize(grey, (width, 3 * width // 4), interpolation=cv2.INTER_AREA)
        picture[0, k] ^= 8  # no two are the same, byte by byte
        cv2.imwrite(str(folder / f"{k}.png"), picture)
    return detect(folder, target=SPEC)


def test_images_left_out_for_their_size_are_warned_of(tmp_path: Path) -> None:
    found = with_misses(CalibrationResult("intrinsics", "ok", observations=seen(tmp_path, 2)))
    check = found.check("image-sizes")
    assert (check.status, found.verdict) == ("warn", "warn")
    assert "2 of 5 images are not 640x480 px and are left out: 0.png, 1.png" in check.message


def test_images_of_one_size_are_not(tmp_path: Path) -> None:
    found = with_misses(CalibrationResult("intrinsics", "ok", observations=seen(tmp_path, 0)))
    assert (found.checks, found.verdict) == ((), "ok")
