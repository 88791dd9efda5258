"""Segments by colour: hues that run through 0, files in degrees and per cent, a range picked from a pixel."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrant.errors import InputError, RefusedError
from calibrant.perceive.colour.ranges import ColourRange, hsv
from calibrant.perceive.colour.segments import cleaned, find_segments, segments, the_one


def _bgr(hue: float, saturation: float, value: float) -> np.ndarray:
    pixel = np.array([[[hue, saturation / 100, value / 100]]], np.float32)
    return np.rint(255 * cv2.cvtColor(pixel, cv2.COLOR_HSV2BGR)[0, 0]).astype(np.uint8)


def _picture(*parts: tuple[tuple[int, int, int, int], tuple[float, float, float]]) -> np.ndarray:
    image = np.full((120, 160, 3), 150, np.uint8)
    for (x, y, w, h), colour in parts:
        image[y : y + h, x : x + w] = _bgr(*colour)
    return image


@pytest.mark.parametrize("hue", [350.0, 0.0, 9.0])
def test_red_is_found_on_both_sides_of_zero(hue: float) -> None:
    image = _picture(((40, 30, 30, 20), (hue, 90, 80)))
    (found,) = find_segments(image, ColourRange.parse("h:345-15 s:50-100 v:30-100"))
    assert found.area_px == pytest.approx(600, abs=12)  # opening rounds four corners
    assert found.centre == pytest.approx([54.5, 39.5], abs=1e-6)


@pytest.mark.parametrize("hue", [30.0, 330.0])
def test_neighbours_of_red_are_not(hue: float) -> None:
    image = _picture(((40, 30, 30, 20), (hue, 90, 80)))
    assert not find_segments(image, ColourRange.parse("h:345-15 s:50-100 v:30-100"))


def test_a_text_is_read_and_written_again() -> None:
    text = "h:345-15 s:50-100 v:30-100"
    assert ColourRange.parse(text).spec == text
    assert ColourRange.parse(" H:10..20 ") == ColourRange((10.0, 20.0))


@pytest.mark.parametrize("text", ["", "red", "h:10", "h:10-20 x:3-4", "h:-5-20", "s:60-40", "h:10-400", "v:0-150"])
def test_what_is_no_range_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        ColourRange.parse(text)


def test_opencv_numbers_select_the_same_pixels() -> None:
    low, high = (5, 100, 60), (25, 255, 255)
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (200, 200, 3)).astype(np.uint8)
    theirs = cv2.inRange(cv2.cvtColor(image, cv2.COLOR_BGR2HSV), low, high) > 0
    ours = ColourRange.from_opencv(low, high).mask(image)
    # Theirs rounds to two degrees, and to 1/255: pixels at the rim differ.
    assert np.mean(theirs != ours) < 0.01
    assert ours.any()


def test_a_range_is_picked_around_a_pixel_with_the_spread_it_has() -> None:
    rng = np.random.default_rng(1)
    patch = np.stack([rng.normal(2, 4, 3000) % 360, np.full(3000, 80.0), rng.normal(70, 2, 3000)], axis=1)
    image = np.full((50, 60, 3), 150, np.uint8)
    image[:] = np.array([_bgr(*p) for p in patch]).reshape(50, 60, 3)
    picked = ColourRange.of_pixel(image, (30, 25), radius=8)
    first, last = picked.hue_deg
    assert first > 300  # the range runs through 0
    assert last < 40
    assert picked.mask(image).mean() > 0.995
    opposite = _picture(((40, 30, 30, 20), (182.0, 80.0, 70.0)))
    assert not picked.mask(opposite).any()


def test_a_pixel_outside_is_refused() -> None:
    with pytest.raises(InputError, match="outside"):
        ColourRange.of_pixel(_picture(), (500, 3))


def test_grey_pictures_have_no_colours() -> None:
    with pytest.raises(InputError, match="blue, green, red"):
        hsv(np.zeros((4, 4), np.uint8))


def test_opening_takes_specks_and_closing_fills_gaps() -> None:
    mask = np.zeros((60, 60), bool)
    mask[20:40, 20:40] = True
    mask[30, 30] = False
    mask[5, 5] = True
    out = cleaned(mask)
    assert out[30, 30]
    assert not out[5, 5]


def test_all_segments_are_given_largest_first() -> None:
    image = _picture(
        ((10, 10, 30, 30), (120, 90, 80)), ((60, 40, 20, 20), (120, 90, 80)), ((140, 0, 20, 20), (120, 90, 80))
    )
    found = find_segments(image, ColourRange((100.0, 140.0), (50.0, 100.0)))
    assert [round(s.area_px, -2) for s in found] == [900, 400, 400]
    assert [s.on_edge for s in found].count(True) == 1


def test_the_one_is_nearest_or_refused() -> None:
    mask = np.zeros((60, 60), bool)
    mask[5:15, 5:15] = mask[40:50, 40:50] = True
    found = segments(mask)
    with pytest.raises(RefusedError, match="2 parts"):
        the_one(found)
    assert the_one(found, near=(44, 44)).centre == pytest.approx([44.5, 44.5])
    with pytest.raises(RefusedError, match="not found"):
        the_one([])
