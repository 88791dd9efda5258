"""A spec that is not the board's: no wrong numbers are given, and what the board is, is named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.detection.charuco_scenes import facing, photograph
from tests.detection.chessboard_pictures import Lens
from tests.detection.chessboard_pictures import facing as facing_camera
from tests.detection.chessboard_pictures import picture as chessboard

from calibrant.cameras import Camera
from calibrant.detection.charuco.detector import CharucoDetector
from calibrant.detection.detection import Detection
from calibrant.detection.images.images import load_grey
from calibrant.detection.pipeline import detect
from calibrant.detection.registry import detector_for, second_look
from calibrant.errors import DetectionError
from calibrant.geometry import se3, so3
from calibrant.simulate.render import Look, render
from calibrant.targets.charuco import Charuco
from calibrant.targets.registry import parse_target

LENS = Lens(290.0, 160.0, 120.0)
BOARD = Charuco(5, 7, 0.03, 0.022, "DICT_5X5_100")
QUADS = (
    0.75 * np.array([[150.0, 20.0], [470.0, 40.0], [480.0, 450.0], [130.0, 430.0]]),
    0.75 * np.array([[180.0, 60.0], [420.0, 20.0], [490.0, 420.0], [110.0, 380.0]]),
    0.75 * np.array([[120.0, 30.0], [400.0, 60.0], [420.0, 440.0], [150.0, 460.0]]),
)


def picture(k: int, board: Charuco = BOARD) -> np.ndarray:
    return photograph(board, facing(board, quad=QUADS[k]), seed=k)[0]


@pytest.mark.parametrize("k", range(len(QUADS)))
def test_columns_and_rows_exchanged(k: int) -> None:
    found = CharucoDetector().detect(picture(k), replace(BOARD, columns=7, rows=5))
    assert found.reason == "the image looks like 5x7 squares, you asked for 7x5"
    assert found.another


@pytest.mark.parametrize("name", ["1", "2", "15"])
def test_exchanged_on_photos_that_were_misnumbered(shared_data: Callable[[str], Path], name: str) -> None:
    # 8 to 16 corners of each were given the numbers of others, by two markers that lie alike on both boards.
    grey = load_grey(shared_data("handeye_rct_charuco_static") / "images" / f"{name}.png")
    found = CharucoDetector().detect(grey, parse_target("charuco:7x5:36.195mm:18.256mm:DICT_6X6_250"))
    assert found.reason == "the image looks like 5x7 squares, you asked for 7x5"


@pytest.mark.parametrize("asked", [0.018, 0.0275])
def test_a_marker_s_size_that_is_off_by_a_fifth_is_named(asked: float) -> None:
    found = CharucoDetector().detect(picture(0), replace(BOARD, marker=asked))
    said = found.reason if found.notes == () else found.notes[0]
    assert said is not None
    assert "measure" in said
    assert any(text in said for text in ("0.70 of a square", "0.75 of a square", "21.", "22mm"))


def test_the_right_size_is_not_doubted() -> None:
    assert CharucoDetector().detect(picture(0), BOARD).notes == ()


def test_a_run_whose_images_mostly_show_another_board_is_refused(tmp_path: Path) -> None:
    other = replace(BOARD, columns=7, rows=5)
    turned = [np.roll(q, 1, axis=0) for q in QUADS]
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"{k}.png"), photograph(other, facing(other, quad=turned[k]), seed=k)[0])
    cv2.imwrite(str(tmp_path / "2.png"), picture(2))
    with pytest.raises(DetectionError, match=r"2 of 3 images look like 7 columns .* you asked for 5x7, which 1 seems"):
        detect(tmp_path, target=BOARD)
    assert len(detect(tmp_path, target=other).views) == 2


def test_the_corners_of_a_strip_lie_on_one_line() -> None:
    strip = Charuco(2, 12, 0.03, 0.022, "DICT_5X5_100")
    quad = 0.75 * np.array([[280.0, 10.0], [350.0, 10.0], [350.0, 460.0], [280.0, 460.0]])
    found = CharucoDetector().detect(picture_of(strip, quad), strip)
    assert not found.found
    assert "corners of a ChArUco board of 2x12 squares lie on one line" in str(found.reason)


def picture_of(board: Charuco, quad: np.ndarray) -> np.ndarray:
    return photograph(board, facing(board, quad=quad))[0]


@pytest.mark.parametrize("shape", [(33_000, 480), (360, 33_000)])
def test_pictures_with_more_pixels_a_side_than_opencv_counts(shape: tuple[int, int]) -> None:
    large, (small, truth) = np.full(shape, 90, np.uint8), photograph(BOARD, facing(BOARD, quad=QUADS[0]))
    corner = np.array([shape[1] - small.shape[1], shape[0] - small.shape[0]])
    large[corner[1] :, corner[0] :] = small
    found = CharucoDetector().detect(large, BOARD)
    assert len(found.point_ids) == 24
    assert np.abs(found.uv - truth[found.point_ids] - corner).max() < 0.2


def test_a_picture_that_opencv_fails_on_costs_itself_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture(k))
    search = CharucoDetector.detect
    calls: list[int] = []

    def fails_once(self: CharucoDetector, *args: object, **options: object) -> object:
        calls.append(1)
        if len(calls) == 1:
            cv2.remap(np.zeros((4, 4), np.uint8), np.zeros(0, np.float32), None, cv2.INTER_LINEAR)
        return search(self, *args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(CharucoDetector, "detect", fails_once)
    found = detect(tmp_path, target=BOARD, workers=1)
    assert [v.id for v in found.views] == ["1.png"]
    assert found.missed[0].id == "0.png"
    assert "cannot be searched" in found.missed[0].reason


def looked_twice(grey: np.ndarray, spec: str) -> Detection:
    target = parse_target(spec)
    return second_look(grey, target, detector_for(target.kind).detect(grey, target))


@pytest.mark.parametrize("k", range(len(QUADS)))
def test_a_charuco_board_asked_for_as_a_chessboard_is_named(k: int) -> None:
    found = looked_twice(picture(k), "chessboard:9x6:25mm")
    assert found.looks_like == "a ChArUco board (use charuco:5x7:25mm:MARKER:DICT_5X5_50)"
    assert found.another
    assert not found.found


def test_its_corners_are_measured_where_their_number_is_the_one_asked_for() -> None:
    camera = Camera.create("pinhole", {"fx": 600.0, "fy": 600.0, "cx": 239.5, "cy": 179.5}, image_size=(480, 360))
    T = se3.make(so3.exp(np.array([0.2, 0.1, 1.5])), np.array([0.09, -0.08, 0.45]))
    grey = render(BOARD.artwork(), camera, T, rng=np.random.default_rng(0), look=Look(clutter=0, noise_grey=1.0))
    found = looked_twice(grey, "chessboard:4x6:30mm")
    assert len(found.uv) == 24
    assert "as charuco:5x7:30mm:MARKER:DICT_5X5_50" in found.notes[-1]


def test_a_chessboard_asked_for_as_a_charuco_board_is_named() -> None:
    pose = facing_camera(9, 6, LENS, distance=15, tilt_deg=10, axis_deg=30, roll_deg=5)
    grey = chessboard(9, 6, pose, LENS, (320, 240), seed=1)
    found = looked_twice(grey, "charuco:5x7:30mm:22mm:5x5_100")
    assert found.looks_like == "a chessboard (use chessboard:9x6:30mm)"
    assert found.another
    # As many corners as the board has, without a marker: which of the two it is, blur may hide.
    found = looked_twice(grey, "charuco:10x7:30mm:22mm:5x5_100")
    assert found.looks_like is None
    assert "too blurred, or it is a chessboard (use chessboard:9x6:30mm)" in (found.reason or "")


def test_a_plain_chessboard_is_not_doubted() -> None:
    pose = facing_camera(9, 6, LENS, distance=15, tilt_deg=10, axis_deg=30, roll_deg=5)
    found = looked_twice(chessboard(9, 6, pose, LENS, (320, 240), seed=1), "chessboard:9x6:25mm")
    assert (len(found.uv), found.notes) == (54, ())
