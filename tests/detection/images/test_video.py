"""Videos as images: which frames, in which order, and what they show."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.detection import detect
from calibrant.detection.images.files import expand
from calibrant.detection.images.images import load_grey
from calibrant.errors import InputError

COUNT, SHARP = 12, (2, 7, 9)


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """A video whose frame i has a bar i * 8 px from the left; sharp at SHARP, blurred elsewhere."""
    file = tmp_path / "bar.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (160, 120))
    if not writer.isOpened():
        pytest.skip("this OpenCV cannot write videos")
    for i in range(COUNT):
        image = np.full((120, 160, 3), 40, np.uint8)
        image[20:100, 20 + 8 * i : 40 + 8 * i] = 220
        writer.write(image if i in SHARP else cv2.GaussianBlur(image, (0, 0), 4.0))
    writer.release()
    return file


def left_edge(grey: np.ndarray) -> int:
    """Index of the bar's frame, by its left edge."""
    return round((int(np.argmax(grey[60] > 130)) - 20) / 8)


def test_every_frame_by_its_number(video: Path) -> None:
    files = expand(video)
    assert [f.name for f in files] == [f"{i:06d}" for i in range(COUNT)]
    assert [left_edge(load_grey(f)) for f in files] == list(range(COUNT))
    # Backwards too: a frame is what its number says, however it is come by.
    assert left_edge(load_grey(files[3])) == 3


def test_the_sharpest_of_every_few(video: Path) -> None:
    assert [int(f.name) for f in expand(f"{video}@4")] == [2, 7, 9]


def test_patterns_and_names_of_frames(video: Path) -> None:
    assert expand(str(video.parent / "*.avi")) == expand(video)
    assert expand(expand(video)[4:6]) == expand(video)[4:6]


@pytest.mark.parametrize("name", ["missing.mp4@3", "bar.avi@0"])
def test_a_wrong_name_is_named(video: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"does not exist|at least 1"):
        expand(video.parent / name)


def test_a_file_that_is_no_video(tmp_path: Path) -> None:
    (tmp_path / "broken.mp4").write_bytes(b"no video at all")
    with pytest.raises(InputError, match=r"broken\.mp4"):
        expand(tmp_path / "broken.mp4")


def test_boards_in_a_real_video(shared_data: Callable[[str], Path]) -> None:
    folder = shared_data("multicam_caliscope_charuco") / "post_optimization/calibration/extrinsic"
    observations = detect(folder / "cam_0.mp4@6", target="charuco:4x5:54mm:40.5mm:DICT_4X4_1000:inverted")
    # The board is in all 57 frames, by the data's own note; the sharpest of six must show it.
    assert len(observations.views) == 10
    assert all(len(view) >= 8 for view in observations.views)
