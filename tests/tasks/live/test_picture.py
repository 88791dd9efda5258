"""Pictures as sensor_msgs has them, in grey values."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.tasks.live.picture import Picture

COLOUR = np.random.default_rng(5).integers(0, 256, (6, 8, 3)).astype(np.uint8)
GREY = cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)


def picture(encoding: str, rows: np.ndarray, *, padding: int = 0, big_endian: bool = False) -> Picture:
    lines = rows.reshape(6, -1).view(np.uint8)
    lines = np.hstack([lines, np.full((6, padding), 77, np.uint8)])
    return Picture("/i", 0.0, "c", 8, 6, encoding, lines.shape[1], lines.ravel(), big_endian)


@pytest.mark.parametrize(
    ("encoding", "rows"),
    [
        ("bgr8", COLOUR),
        ("rgb8", np.ascontiguousarray(COLOUR[..., ::-1])),
        ("bgra8", np.dstack([COLOUR, np.full((6, 8), 9, np.uint8)])),
        ("mono8", GREY),
        ("8UC1", GREY),
    ],
)
@pytest.mark.parametrize("padding", [0, 3])
def test_every_encoding_gives_the_same_grey(encoding: str, rows: np.ndarray, padding: int) -> None:
    np.testing.assert_array_equal(picture(encoding, rows, padding=padding).grey(), GREY)


def test_a_bayer_picture_of_one_colour_is_that_grey() -> None:
    """Rows R G R G …, G B G B …: R 200, G 100, B 50; grey by Rec. 601."""
    rows = np.zeros((6, 8), np.uint8)
    rows[::2, ::2], rows[::2, 1::2], rows[1::2, ::2], rows[1::2, 1::2] = 200, 100, 100, 50
    grey = picture("bayer_rggb8", rows).grey()
    assert abs(int(grey[3, 3]) - round(0.299 * 200 + 0.587 * 100 + 0.114 * 50)) <= 1


@pytest.mark.parametrize("big", [False, True])
def test_sixteen_bits_keep_their_order(big: bool) -> None:
    rows = (GREY.astype(np.uint16) * 257).astype(">u2" if big else "<u2")
    grey = picture("mono16", rows, big_endian=big).grey()
    assert np.corrcoef(grey.ravel(), GREY.ravel())[0, 1] > 0.999


def test_compressed_pictures_and_what_is_none() -> None:
    png = cv2.imencode(".png", GREY)[1].ravel()
    np.testing.assert_array_equal(Picture("/i", 0, "c", 0, 0, "compressed", 0, png).grey(), GREY)
    with pytest.raises(InputError, match=r"/i: the picture .* is damaged"):
        Picture("/i", 0, "c", 0, 0, "compressed", 0, np.zeros(4, np.uint8)).grey()
    with pytest.raises(InputError, match="/i: the encoding 'yuv999' is not read; expected mono8"):
        picture("yuv999", GREY).grey()
    with pytest.raises(InputError, match="/i: 7 bytes in rows of 8 are no 8x6 px of mono8"):
        Picture("/i", 0, "c", 8, 6, "mono8", 8, np.zeros(7, np.uint8)).grey()
