"""A corner whose fit failed is no corner: boards seen at a glancing angle and out of focus, whose truth is known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.detection.charuco_scenes import photograph

from calibrant.detection.charuco.detector import CharucoDetector
from calibrant.detection.images.images import load_grey
from calibrant.geometry import so3
from calibrant.targets.charuco import Charuco
from calibrant.targets.registry import parse_target

BOARD = Charuco(11, 8, 0.008, 0.004, "DICT_5X5_100")
GLANCING_DEG = 74.0


def glancing(distance: float) -> np.ndarray:
    """Homography of the board turned away by GLANCING_DEG: its near squares are some ten times its far ones."""
    R = so3.exp([0.0, -np.deg2rad(GLANCING_DEG), 0.0]) @ so3.exp([0.0, 0.0, 0.1])
    middle = 0.5 * BOARD.square * np.array([BOARD.columns, BOARD.rows, 0.0])
    K = np.array([[700.0, 0.0, 320.0], [0.0, 700.0, 240.0], [0.0, 0.0, 1.0]])
    return np.asarray(K @ np.column_stack([R[:, :2], np.array([0.0, 0.0, distance]) - R @ middle]))


@pytest.mark.parametrize(("distance", "blur_px"), [(0.055, 1.0), (0.065, 2.0)])
def test_near_squares_of_a_board_seen_at_a_glance(distance: float, blur_px: float) -> None:
    # Their corners were predicted far off from markers alone, and stayed there: 3 to 6 px off at a sigma of 0.5.
    image, truth = photograph(BOARD, glancing(distance), size=(640, 480), blur_px=blur_px, noise=1.0, seed=3)
    found = CharucoDetector().detect(image, BOARD)
    assert len(found.point_ids) >= 30
    assert np.linalg.norm(found.uv - truth[found.point_ids], axis=1).max() < 0.5


@pytest.mark.parametrize(
    ("name", "spec", "count"),
    [("v1", "charuco:17x11:8mm:4mm:DICT_5X5_100", 140), ("b_t45_s6", "charuco:7x5:20mm:15mm:DICT_5X5_50", 20)],
)
def test_pictures_from_the_field(shared_case: Callable[[str], Path], name: str, spec: str, count: int) -> None:
    folder, target = shared_case("04-charuco-misplaced"), parse_target(spec)
    found = CharucoDetector().detect(load_grey(folder / f"{name}.png"), target)
    off = np.linalg.norm(found.uv - np.loadtxt(folder / f"{name}.txt")[found.point_ids], axis=1)
    assert len(off) >= count
    assert found.sigma_px is not None
    # Rayleigh's distribution exceeds 4.5 sigmas in one of 25,000 corners; edges along the raster held 9 of them.
    assert np.all(off < 4.5 * found.sigma_px)
    assert np.mean((off / found.sigma_px) ** 2) < 2.0 * 1.25


@pytest.mark.parametrize("noise", [1.0, 4.0])
def test_corners_of_squares_too_small_for_the_fit_state_what_they_err_by(noise: float) -> None:
    board, error, sigma = Charuco(9, 7, 0.03, 0.0225, "DICT_4X4_50"), [], []
    for k in range(3):
        turn, scale = 0.3 + 0.5 * k, 17.0 / board.square
        c, s = scale * np.cos(turn), scale * np.sin(turn)
        middle = 0.5 * board.square * np.array([board.columns, board.rows])
        shift = np.array([180.0, 150.0]) - np.array([[c, -s], [s, c]]) @ middle
        H = np.array([[c, -s, shift[0]], [s, c, shift[1]], [0.0, 0.0, 1.0]])
        image, truth = photograph(board, H, size=(360, 300), blur_px=0.5, noise=noise, seed=k)
        found = CharucoDetector().detect(image, board)
        error.append(found.uv - truth[found.point_ids])
        sigma.append(found.sigma_px)
    off, stated = np.concatenate(error), np.concatenate(sigma)
    assert len(off) > 100
    # 0.5 px was stated of each: a chi-square of 0.02.
    assert np.median(stated) < 0.2
    assert 0.25 < np.mean((off / stated[:, None]) ** 2) < 1.5
