"""The pointer's axis in a picture: bright, dark or of a colour, found to a fraction of a pixel."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.perceive.pointing.axis import find_axis


def _picture(colour: tuple[int, int, int], ends: Array, *, background: int = 200) -> np.ndarray:
    """A stick, tapered, on a noisy table with a blob and a paler line, drawn at four times the size."""
    big = np.full((1200, 1600, 3), background, np.uint8)
    cv2.circle(big, (1200, 900), 160, (90, 90, 90), -1)
    a, b = 4.0 * ends
    normal = np.array([-(b - a)[1], (b - a)[0]]) / np.linalg.norm(b - a)
    corners = np.array([a + 14 * normal, b + 26 * normal, b - 26 * normal, a - 14 * normal])
    cv2.fillConvexPoly(big, np.rint(corners * 16).astype(np.int32), colour, cv2.LINE_AA, 4)
    small = cv2.resize(big, (400, 300), interpolation=cv2.INTER_AREA).astype(float)
    small += np.random.default_rng(5).normal(0, 3, small.shape)
    return np.clip(small, 0, 255).astype(np.uint8)


def _off(found: Array, ends: Array) -> float:
    """Largest distance of the found points from the true line, px; pixels of the big picture are 1/4 px, about 3/8."""
    a, b = ends - 0.375
    d = (b - a) / np.linalg.norm(b - a)
    return float(np.abs((found - a) @ np.array([-d[1], d[0]])).max())


@pytest.mark.parametrize(("colour", "background"), [((20, 20, 20), 200), ((250, 250, 250), 60)])
def test_the_longest_elongated_part_is_found(colour: tuple[int, int, int], background: int) -> None:
    ends = np.array([[60.0, 40.0], [250.0, 130.0]])
    axis = find_axis(_picture(colour, ends, background=background))
    found = axis.points
    assert _off(found, ends) < 0.3
    assert np.linalg.norm(found[1] - found[0]) > 150


def test_a_colour_is_found_by_its_hue() -> None:
    ends = np.array([[60.0, 240.0], [250.0, 130.0]])
    image = _picture((40, 40, 220), ends)  # red: hues on both sides of 0
    assert _off(find_axis(image, hues_deg=(345, 15)).points, ends) < 0.3
    with pytest.raises(InputError, match="no hue of that range"):
        find_axis(image, hues_deg=(100, 140))
    with pytest.raises(InputError, match="grey"):
        find_axis(image[..., 0], hues_deg=(100, 140))


def test_what_the_pictures_edge_cuts_off_is_no_pointer() -> None:
    """A strip of dark wall along the upper edge, longer than the stick, which comes in from below."""
    image = _picture((20, 20, 20), np.array([[200.0, 60.0], [230.0, 310.0]]))
    cv2.fillConvexPoly(image, np.array([[0, 0], [390, 0], [0, 45]], np.int32), (30, 30, 30))
    assert _off(find_axis(image).points, np.array([[200.0, 60.0], [230.0, 310.0]])) < 0.3
    image[70:] = 200
    with pytest.raises(InputError, match="no pointer was found"):
        find_axis(image)


def test_how_far_it_stands_out_is_told() -> None:
    image = np.full((300, 400), 200, np.uint8)
    image[40:50, 40:340] = 20
    alone = find_axis(image)
    assert alone.next_px == 0
    assert alone.words == "the only elongated part, 300 px long"
    image[200:208, 40:240] = 20
    both = find_axis(image)
    np.testing.assert_array_equal(both.points, alone.points)
    assert both.length_px / both.next_px == pytest.approx(1.5, abs=0.01)
    assert "300 px, 1.5 times as long as the next one" in both.words


def test_a_picture_without_a_pointer_is_refused() -> None:
    with pytest.raises(InputError, match="no pointer was found"):
        find_axis(np.full((100, 100), 90, np.uint8))
