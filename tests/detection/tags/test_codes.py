"""Codes read by our own decoder, against OpenCV's drawings and its detector."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from tests.detection.charuco_scenes import facing, photograph

from calibrant.detection import opencv
from calibrant.detection.tags.codes import dictionary_codes, read_codes
from calibrant.detection.tags.search import Effort, efforts, find_markers
from calibrant.targets.charuco import Charuco
from calibrant.targets.dictionaries import DICTIONARIES

QUAD = np.array([[49.5, 49.5], [149.5, 49.5], [149.5, 149.5], [49.5, 149.5]])


def drawn(name: str, marker_id: int) -> np.ndarray:
    cells = opencv.marker_cells(name, marker_id)
    image = np.full((200, 200), 255, np.uint8)
    edges = np.rint(np.linspace(50, 150, len(cells) + 1)).astype(int)
    for j, row in enumerate(cells):
        for i, cell in enumerate(row):
            image[edges[j] : edges[j + 1], edges[i] : edges[i + 1]] = 255 * cell
    return image


@pytest.mark.parametrize("name", DICTIONARIES)
def test_every_dictionarys_codes_are_those_of_its_drawings(name: str) -> None:
    codes, mended = dictionary_codes(name)
    assert len(codes) == DICTIONARIES[name].capacity
    assert mended >= 0
    for marker_id in (0, len(codes) // 2, len(codes) - 1):
        bits = opencv.marker_cells(name, marker_id)[1:-1, 1:-1].ravel()
        assert int("".join(str(int(b)) for b in bits), 2) == int(codes[marker_id, 0])


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("negative", [False, True])
def test_a_marker_is_read_at_every_turn_and_as_a_negative(turn: int, negative: bool) -> None:
    image = drawn("DICT_5X5_100", 17)
    found = read_codes(255 - image if negative else image, np.roll(QUAD, turn, axis=0)[None], "DICT_5X5_100")
    assert found.ids.tolist() == [17]
    np.testing.assert_allclose(found.corners[0], QUAD)


def test_wrong_bits_are_mended_as_far_as_the_dictionary_allows() -> None:
    name = "DICT_APRILTAG_36h11"
    mended = dictionary_codes(name)[1]
    image = drawn(name, 5)
    edges = np.rint(np.linspace(50, 150, 9)).astype(int)
    spoilt = image.copy()
    for k in range(mended + 1):
        if k == mended:
            assert read_codes(spoilt, QUAD[None], name).ids.tolist() == [5]
        cell = spoilt[edges[1] : edges[2], edges[1 + k] : edges[2 + k]]
        cell[:] = 255 - cell
    assert read_codes(spoilt, QUAD[None], name).ids.tolist() == []


def test_a_square_without_a_border_is_no_marker() -> None:
    image = np.random.default_rng(1).integers(0, 256, (200, 200)).astype(np.uint8)
    assert len(read_codes(image, QUAD[None], "DICT_4X4_1000")) == 0
    assert len(read_codes(np.full((200, 200), 90, np.uint8), QUAD[None], "DICT_4X4_1000")) == 0


def test_all_markers_that_opencv_reads_are_read() -> None:
    board = Charuco(7, 6, 0.04, 0.028, "DICT_5X5_100")
    quad = np.array([[60.0, 50.0], [430.0, 30.0], [440.0, 330.0], [40.0, 300.0]])
    for seed, blur_px in enumerate((0.7, 1.2, 1.6)):
        image, _ = photograph(board, facing(board, quad=quad), blur_px=blur_px, seed=seed)
        corners, ids, _ = cv2.aruco.ArucoDetector(opencv.dictionary(board.dictionary)).detectMarkers(image)
        theirs = opencv.Markers.of(corners, ids)
        ours = find_markers(image, board.dictionary, Effort(1))
        assert set(theirs.ids.tolist()) <= set(ours.ids.tolist())
        for marker_id, corners in zip(ours.ids.tolist(), ours.corners, strict=True):
            other = theirs.corners[theirs.ids.tolist().index(marker_id)] if marker_id in theirs.ids else corners
            # OpenCV's lie up to half a threshold's window inside the border.
            assert np.linalg.norm(other - corners, axis=1).max() < 4.0


def test_a_smaller_copy_gives_pixels_of_the_full_picture() -> None:
    image = np.kron(drawn("DICT_6X6_250", 7), np.ones((2, 2), np.uint8))
    for factor in (1, 2):
        found = find_markers(image, "DICT_6X6_250", Effort(factor))
        assert found.ids.tolist() == [7]
        np.testing.assert_allclose(found.corners[0], 2 * (QUAD + 0.5) - 0.5, atol=0.5 * factor)


def test_efforts_go_from_small_copies_to_the_full_picture() -> None:
    factors = [effort.factor for effort in efforts((1200, 1600), 400)]
    assert factors[:3] == [4, 2, 1]
    assert {effort.ink for effort in efforts((100, 100), 400, "light")} == {"light"}
