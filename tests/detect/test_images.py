"""Reading images and lists of images; every way in which users get that wrong is named."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrant.detect.images import expand, load_grey, to_grey8
from calibrant.errors import InputError

RAMP = np.tile(np.arange(64, dtype=np.uint8) * 4, (48, 1))


def save(path, image):
    cv2.imwrite(str(path), image)
    return path


def test_numbers_in_names_are_sorted_by_value(tmp_path):
    for name in ("10.png", "2.png", "1.png", "a10.png", "a9.png"):
        save(tmp_path / name, RAMP)
    (tmp_path / "notes.txt").write_text("not an image")
    names = ["1.png", "2.png", "10.png", "a9.png", "a10.png"]
    assert [p.name for p in expand(tmp_path)] == names
    assert [p.name for p in expand([tmp_path / "*.png"])] == names


def test_order_given_is_kept_and_a_file_is_taken_once(tmp_path):
    first, second = save(tmp_path / "b.png", RAMP), save(tmp_path / "a.png", RAMP)
    assert expand([first, second, first, tmp_path]) == [first, second]


def test_a_name_with_brackets_is_a_file_before_it_is_a_pattern(tmp_path):
    file = save(tmp_path / "shot[1].png", RAMP)
    assert expand(file) == [file]


@pytest.mark.parametrize("name", ["missing.png", "*.png"])
def test_missing_files_and_patterns_are_named(tmp_path, name):
    with pytest.raises(InputError, match=r"missing\.png does not exist|no file matches .*\*\.png"):
        expand(tmp_path / name)


def test_folder_without_images_and_no_images(tmp_path):
    with pytest.raises(InputError, match="holds no images"):
        expand(tmp_path)
    with pytest.raises(InputError, match="no images were given"):
        expand([])


@pytest.mark.parametrize(
    "image", [RAMP, cv2.cvtColor(RAMP, cv2.COLOR_GRAY2BGR), cv2.cvtColor(RAMP, cv2.COLOR_GRAY2BGRA)]
)
def test_grey_colour_and_alpha_read_alike(tmp_path, image):
    grey = load_grey(save(tmp_path / "a.png", image))
    assert grey.dtype == np.uint8
    assert np.abs(grey.astype(int) - RAMP).max() <= 1


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_deep_images_keep_their_contrast(tmp_path, bits):
    deep = (RAMP.astype(np.uint16) << (bits - 8)).astype(np.uint16)
    assert np.abs(load_grey(save(tmp_path / "a.png", deep)).astype(int) - RAMP).max() <= 1


def test_floats_truth_values_and_wrong_shapes():
    assert to_grey8(np.linspace(0, 1, 12).reshape(3, 4)).max() == 255
    assert set(np.unique(to_grey8(np.eye(4, dtype=bool)))) == {0, 255}
    assert to_grey8(np.zeros((3, 4), np.uint16)).max() == 0
    with pytest.raises(InputError, match="2 channels"):
        to_grey8(np.zeros((4, 4, 2), np.uint8))


def test_exif_orientation_is_respected(tmp_path):
    ok, data = cv2.imencode(".jpg", RAMP)
    assert ok
    # A minimal EXIF block: little-endian TIFF with one entry, orientation (0x0112) = 6: turn by 90 degrees.
    tiff = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"
    block = b"Exif\0\0" + tiff
    raw = data.tobytes()
    file = tmp_path / "a.jpg"
    file.write_bytes(raw[:2] + b"\xff\xe1" + (len(block) + 2).to_bytes(2, "big") + block + raw[2:])
    assert load_grey(file).shape == (64, 48)


def test_bad_files_are_named(tmp_path):
    empty, text = tmp_path / "empty.png", tmp_path / "text.png"
    empty.touch()
    text.write_text("no image")
    with pytest.raises(InputError, match=r"empty\.png is empty"):
        load_grey(empty)
    with pytest.raises(InputError, match=r"text\.png is not an image"):
        load_grey(text)
    with pytest.raises(InputError, match=r"gone\.png does not exist"):
        load_grey(tmp_path / "gone.png")
    with pytest.raises(InputError, match="cannot be read"):
        load_grey(tmp_path)
