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
    assert np.all(off < np.maximum(6.0 * found.sigma_px, 0.25))
