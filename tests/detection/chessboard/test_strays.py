"""Corners of a chessboard's grid that lie where another corner is."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras.camera import Camera
from calibrant.detection.chessboard.detector import ChessboardDetector
from calibrant.detection.chessboard.strays import stray_corners
from calibrant.geometry import se3, so3
from calibrant.simulate.render import Look, render
from calibrant.targets.chessboard import Chessboard

Array = np.ndarray


def fisheye() -> Camera:
    parameters = {"fx": 380.0, "fy": 380.0, "cx": 640.0, "cy": 480.0}
    return Camera.create(
        "kannala_brandt", parameters | dict.fromkeys(("k1", "k2", "k3", "k4"), 0.0), image_size=(1280, 960)
    )


def near_pose() -> Array:
    """A board that fills a fisheye's picture: its far squares are a tenth of its near ones."""
    return se3.make(so3.exp([-0.51, 0.1, -1.29]), [-0.134, 0.094, 0.065])


def bent_grid() -> Array:
    """Corners (9, 12) of a board as the fisheye sees it."""
    board = Chessboard(12, 9, 0.02)
    uv = fisheye().project(se3.apply(near_pose(), board.points))
    return np.asarray(uv.reshape(9, 12, 2))


def test_a_lens_makes_no_corner_a_stray() -> None:
    assert not stray_corners(bent_grid()).any()


@pytest.mark.parametrize("at", [(0, 0), (0, 5), (4, 6), (8, 11), (8, 9)])
def test_a_corner_on_its_neighbours_place_is_one(at: tuple[int, int]) -> None:
    grid = bent_grid()
    row, column = at
    beside = (row, column - 1) if column else (row, column + 1)
    grid[at], grid[beside] = grid[beside].copy(), np.nan
    found = stray_corners(grid)
    assert found[at]
    assert found.sum() == 1


def test_no_witness_no_stray() -> None:
    grid = np.full((4, 5, 2), np.nan)
    grid[0, 0], grid[3, 4] = (10.0, 10.0), (50.0, 20.0)
    assert not stray_corners(grid).any()


@pytest.mark.parametrize("seed", [2, 3])
def test_no_corner_of_a_blurred_board_in_a_fisheye_is_elsewhere(seed: int) -> None:
    # Beyond the foreshortened corners that blur hides, two were taken for those before them: 38 and 52 px off.
    board, camera, rng = Chessboard(12, 9, 0.02), fisheye(), np.random.default_rng(seed)
    pose = near_pose()
    look = Look(blur_px=3.66, noise_grey=2.0, ink_grey=100.0, clutter=20)
    found = ChessboardDetector().detect(render(board.artwork(), camera, pose, rng=rng, look=look), board)
    truth = camera.project(se3.apply(pose, board.points))
    off = min(np.linalg.norm(found.uv - way[found.point_ids], axis=1).max(initial=0.0) for way in (truth, truth[::-1]))
    assert len(found.uv) > 70
    assert off < 1.0
