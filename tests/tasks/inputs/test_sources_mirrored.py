"""A board seen in the mirror is named so, with the option that the command has for it."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest

import calibrant as cb
from calibrant.errors import DetectionError
from calibrant.tasks.inputs.sources import Source

TARGET = "charuco:5x4:40mm:30mm:DICT_5X5_250"


@pytest.fixture
def mirrored(tmp_path: Path) -> Path:
    """A photo of the board, flipped left to right; beside it `upright/0.png`, as it is."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    board = cv2.aruco.CharucoBoard((5, 4), 0.04, 0.03, dictionary).generateImage((500, 400), marginSize=30)
    photo = cv2.GaussianBlur(board, (0, 0), 1)
    for name, image in (("upright", photo), ("mirrored", photo[:, ::-1])):
        (tmp_path / name).mkdir()
        cv2.imwrite(str(tmp_path / name / "0.png"), image)
    return tmp_path / "mirrored" / "0.png"


def test_the_mirror_image_is_the_reason_and_the_option_is_the_commands(mirrored: Path) -> None:
    source = Source(images=(str(mirrored),), target=TARGET)
    with pytest.raises(DetectionError, match=r"^0 of 1 boards found; .* in the mirror image: give --mirror-x$"):
        source.read([mirrored])


def test_of_several_cameras_it_is_that_of_the_camera(mirrored: Path) -> None:
    other = mirrored.parent.parent / "upright"
    with pytest.raises(DetectionError, match=r"camera top: .* in the mirror image: give mirror top"):
        cb.rig(images={"side": other, "top": mirrored.parent}, target=TARGET)
    with pytest.raises(DetectionError, match=r"camera right: .* in the mirror image: give mirror_right"):
        cb.stereo(left=other, right=mirrored.parent, target=TARGET)
