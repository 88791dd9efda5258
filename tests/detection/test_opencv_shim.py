"""The shim over OpenCV gives the same on every version it promises."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from tests.detection.charuco_scenes import facing, photograph

from calibrant.detection import opencv
from calibrant.detection.tags.search import Effort, find_markers
from calibrant.errors import InputError
from calibrant.targets.charuco import Charuco
from calibrant.targets.dictionaries import DICTIONARIES


def test_the_version_is_one_we_promise() -> None:
    major, minor = (int(n) for n in cv2.__version__.split(".")[:2])
    assert (4, 12) <= (major, minor) < (6, 0)


@pytest.mark.parametrize("name", DICTIONARIES)
def test_every_dictionarys_cells_are_read_back(name: str) -> None:
    last = DICTIONARIES[name].capacity - 1
    cells = opencv.marker_cells(name, last)
    assert cells.shape == (DICTIONARIES[name].bits + 2,) * 2
    assert not cells[0].any()
    assert not cells[:, -1].any()
    image = np.pad(np.kron(cells.astype(np.uint8) * 255, np.ones((12, 12), np.uint8)), 40, constant_values=255)
    found = find_markers(image, name, Effort(1))
    assert last in found.ids
    side = 12.0 * cells.shape[0]
    at = found.corners[found.ids.tolist().index(last)]
    np.testing.assert_allclose(at, 40.0 + side * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) - 0.5, atol=0.5)


def test_samples_are_bilinear_with_pixel_centres_at_whole_numbers() -> None:
    image = np.array([[0, 100], [200, 40]], np.uint8)
    values = opencv.sample(image, np.array([[[0.0, 0.0], [1.0, 0.0], [0.5, 0.0], [0.5, 0.5], [-3.0, 0.0]]]))
    np.testing.assert_allclose(values, [[0, 100, 50, 85, 0]], atol=0.51)


def test_opencvs_charuco_corners_come_in_our_pixel_convention() -> None:
    target = Charuco(5, 4, 0.04, 0.02, "DICT_5X5_100")
    image, truth = photograph(target, facing(target, quad=np.array([[60.0, 40], [420, 50], [410, 320], [70, 310]])))
    ids, uv = opencv.charuco_corners(image, target)
    assert len(ids) == 12
    # Its corners scatter by some 0.04 px here, the mean of 12 by a third of that.
    np.testing.assert_allclose((uv - truth[ids]).mean(axis=0), 0.0, atol=0.04)


def test_an_unknown_dictionary_is_refused() -> None:
    with pytest.raises(InputError, match="unknown marker dictionary"):
        opencv.dictionary("DICT_3X3_9")
