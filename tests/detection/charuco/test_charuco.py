"""ChArUco detection on drawn boards with known corners, and on real pictures."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.detection.charuco_scenes import facing, photograph

from calibrant.cameras.camera import Camera
from calibrant.detection.charuco.detector import CharucoDetector
from calibrant.detection.detection import Detection
from calibrant.detection.opencv import charuco_corners
from calibrant.targets.charuco import Charuco
from calibrant.targets.registry import parse_target

BOARD = Charuco(7, 6, 0.04, 0.028, "DICT_5X5_100")
WHOLE = 0.75 * np.array([[90.0, 70.0], [560.0, 40.0], [600.0, 430.0], [60.0, 400.0]])
CORNERS = 30


@lru_cache
def _whole() -> tuple[np.ndarray, np.ndarray]:
    return photograph(BOARD, facing(BOARD, quad=WHOLE))


def whole() -> tuple[np.ndarray, np.ndarray]:
    """The whole board, drawn once; the image is the test's own to draw on."""
    image, truth = _whole()
    return image.copy(), truth


def detect(image: np.ndarray, target: Charuco = BOARD) -> Detection:
    return CharucoDetector().detect(image, target)


def errors(found: Detection, truth: np.ndarray) -> np.ndarray:
    return np.linalg.norm(found.uv - truth[found.point_ids], axis=1)


def test_every_corner_is_found_where_it_is() -> None:
    image, truth = whole()
    found = detect(image)
    assert found.point_ids.tolist() == list(range(CORNERS))
    # The drawing itself, of 9 jittered samples a pixel, is good to some 0.02 px per axis.
    assert np.sqrt(np.mean(errors(found, truth) ** 2)) < 0.045
    assert errors(found, truth).max() < 0.12
    assert found.notes == ()
    assert found.sigma_px is not None
    assert np.all((found.sigma_px > 0) & (found.sigma_px < 0.1))


def test_corners_are_more_accurate_than_opencvs() -> None:
    image, truth = photograph(BOARD, facing(BOARD, quad=WHOLE), noise=4.0, blur_px=1.2)
    found = detect(image)
    ids, uv = charuco_corners(image, BOARD)
    theirs = np.sqrt(np.mean(np.sum((uv - truth[ids]) ** 2, axis=1)))
    assert set(ids.tolist()) <= set(found.point_ids.tolist())
    assert np.sqrt(np.mean(errors(found, truth) ** 2)) < theirs


def test_part_of_a_board_keeps_its_numbers() -> None:
    image, truth = photograph(BOARD, facing(BOARD, quad=WHOLE + np.array([210.0, 110.0])))
    found = detect(image)
    h, w = image.shape
    clear = np.all((truth > 12) & (truth < np.array([w, h]) - 12), axis=1)
    assert set(np.flatnonzero(clear)) <= set(found.point_ids.tolist())
    assert 6 <= clear.sum() < CORNERS
    assert errors(found, truth).max() < 0.3


def test_a_hidden_part_gives_no_corners() -> None:
    image, truth = whole()
    image[110:225, 190:315] = 128
    found = detect(image)
    hidden = np.all((truth > [190, 110]) & (truth < [315, 225]), axis=1)
    assert not set(np.flatnonzero(hidden)) & set(found.point_ids.tolist())
    assert len(found.point_ids) >= CORNERS - hidden.sum() - 6
    # Corners whose window is cut by the patch's edge may move a little; none may be elsewhere.
    assert errors(found, truth).max() < 1.0


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
def test_a_turned_board_keeps_its_numbers(turn: int) -> None:
    image, truth = photograph(BOARD, facing(BOARD, quad=np.roll(WHOLE, turn, axis=0)))
    found = detect(image)
    assert len(found.point_ids) == CORNERS
    assert errors(found, truth).max() < 0.15


@pytest.mark.parametrize("told", [False, True])
def test_a_negative_is_found_out(told: bool) -> None:
    printed = replace(BOARD, inverted=True)
    image, truth = photograph(printed, facing(printed, quad=WHOLE))
    found = detect(image, printed if told else BOARD)
    assert len(found.point_ids) == CORNERS
    assert errors(found, truth).max() < 0.1
    assert [("negative" in note) for note in found.notes] == ([] if told else [True])


@pytest.mark.parametrize("told", [False, True])
def test_the_legacy_layout_is_found_out(told: bool) -> None:
    printed = replace(BOARD, legacy=True)
    image, truth = photograph(printed, facing(printed, quad=WHOLE))
    found = detect(image, printed if told else BOARD)
    assert len(found.point_ids) == CORNERS
    assert errors(found, truth).max() < 0.1
    assert [("legacy layout" in note) for note in found.notes] == ([] if told else [True])


def test_a_wide_lens_loses_no_corner() -> None:
    image, truth = photograph(BOARD, facing(BOARD, quad=1.25 * (WHOLE - 180.0) + 180.0), bend=-0.35)
    found = detect(image)
    h, w = image.shape
    clear = np.all((truth > 12) & (truth < np.array([w, h]) - 12), axis=1)
    assert set(np.flatnonzero(clear)) <= set(found.point_ids.tolist())
    assert errors(found, truth).max() < 0.15


def test_a_known_camera_leads_past_a_hidden_strip() -> None:
    image, truth = whole()
    # Two columns of squares hidden: the right part lies more than two squares from anything known when its markers
    # are made unreadable too.
    image[:, 188:296] = 128
    for i in range(BOARD.marker_count):
        centre = facing(BOARD, quad=WHOLE) @ [*(BOARD.marker_corners[i].mean(axis=0)), 1.0]
        u, v = np.round(centre[:2] / centre[2]).astype(int)
        if u > 296:
            cv2.circle(image, (int(u), int(v)), 9, 128, -1)
    camera = Camera.create("pinhole", {"fx": 450, "fy": 450, "cx": 240, "cy": 180}, image_size=(480, 360))
    without = detect(image)
    with_camera = CharucoDetector().detect(image, BOARD, camera=camera)
    assert len(with_camera.point_ids) > len(without.point_ids)
    assert errors(with_camera, truth).max() < 0.5


def test_a_misread_marker_moves_no_corner() -> None:
    image, truth = whole()
    # A marker of the board where there is none, upside down, on a part of the picture beside the board.
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    image[308:358, 4:54] = 255
    image[315:350, 11:46] = np.rot90(cv2.aruco.generateImageMarker(dictionary, 11, 35), 2)
    found = detect(image)
    assert len(found.point_ids) >= CORNERS - 2
    assert errors(found, truth).max() < 0.2


@pytest.mark.parametrize(
    ("asked", "reason"),
    [
        (replace(BOARD, dictionary="DICT_6X6_250"), "markers of DICT_5X5_50 seen, you asked for DICT_6X6_250"),
        (Charuco(4, 5, 0.04, 0.028, "DICT_5X5_100"), "looks like 7x6 squares, you asked for 4x5"),
        (
            Charuco(6, 7, 0.04, 0.028, "DICT_5X5_100"),
            "looks like 7 columns of squares, 6 rows of them seen, you asked for 6x7",
        ),
        (
            Charuco(9, 8, 0.04, 0.028, "DICT_5X5_100"),
            "looks like 7 columns of squares, 6 rows of them seen, you asked for 9x8",
        ),
        (
            Charuco(7, 6, 0.04, 0.016, "DICT_5X5_100"),
            r"markers measure 2[789](\.\d)?mm on squares of 40mm, you asked for 16mm",
        ),
    ],
)
def test_a_wrong_spec_is_named(asked: Charuco, reason: str) -> None:
    image, _ = whole()
    found = detect(image, asked)
    assert not found.found
    assert len(found.uv) == 0
    assert found.reason is not None
    assert re.search(reason, found.reason), found.reason


def test_a_strip_of_a_board_tells_its_columns() -> None:
    image, _ = whole()
    image[130:] = 128  # two rows of markers are left
    found = detect(image, Charuco(5, 8, 0.04, 0.028, "DICT_5X5_100"))
    assert found.looks_like == "7 columns of squares, 2 rows of them seen"


def test_pictures_without_a_board_give_none() -> None:
    rng = np.random.default_rng(3)
    noise = rng.integers(0, 256, (480, 640), dtype=np.uint8)
    floor = (255 * ((np.arange(480)[:, None] // 40 + np.arange(640) // 40) % 2)).astype(np.uint8)
    for image in (np.full((480, 640), 120, np.uint8), noise, cv2.GaussianBlur(noise, (0, 0), 4), floor):
        found = detect(image)
        assert found.reason == "no markers of DICT_5X5_100 seen", found.reason


@pytest.mark.parametrize("shape", [(1, 1), (5, 700), (30, 30)])
def test_tiny_pictures_give_a_reason(shape: tuple[int, int]) -> None:
    assert not detect(np.full(shape, 90, np.uint8)).found


def test_a_real_set_is_found_whole(shared_data: Callable[[str], Path]) -> None:
    folder = shared_data("handeye_rct_charuco_static") / "images"
    target = parse_target("charuco:5x7:36.195mm:18.256mm:DICT_6X6_250")
    points, pixels = [], []
    files = sorted(folder.glob("*.png"))
    for file in files:
        found = detect(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), target)
        assert len(found.point_ids) >= 20, file.name
        points.append(target.points[found.point_ids].astype(np.float32))
        pixels.append(found.uv.astype(np.float32))
    assert len(files) == 12
    rms = cv2.calibrateCamera(points, pixels, (1600, 1200), None, None)[0]
    # OpenCV's own corners give 0.512 px, and leave out what is hard.
    assert rms < 0.512


def test_a_negative_is_found_in_real_frames(shared_data: Callable[[str], Path]) -> None:
    folder = shared_data("multicam_caliscope_charuco") / "post_optimization" / "calibration" / "extrinsic"
    target = parse_target("charuco:4x5:54mm:40.5mm:DICT_4X4_1000")
    video = cv2.VideoCapture(str(folder / "cam_0.mp4"))
    for _ in range(5):
        ok, frame = video.read()
        assert ok
        found = detect(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), target)
        assert len(found.point_ids) >= 8
        assert found.notes == ("The board is a negative: add :inverted in the spec to say so.",)


def test_thin_paper_around_the_markers_does_not_hide_them() -> None:
    # Strips of one pixel between each marker and the squares beside it, grey after a blur of as much.
    for inverted in (False, True):
        thin = Charuco(4, 5, 0.04, 0.038, "DICT_4X4_50", inverted=inverted)
        quad = 0.7 * np.array([[60.0, 20.0], [330.0, 25.0], [325.0, 345.0], [65.0, 340.0]])
        image, truth = photograph(thin, facing(thin, quad=quad), blur_px=1.0)
        found = detect(image, thin)
        assert len(found.point_ids) >= 4
        assert errors(found, truth).max() < 2.0
