"""Calibrate a camera from photos of a chessboard, your own or, where none are given, drawn ones with a known truth.

python examples/01_photos.py
python examples/01_photos.py chessboard:9x6:25mm photos/*.jpg
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

import calibrant as cb
from calibrant.simulate.render import render
from calibrant.simulate.scenes import look_at_board, standard_camera

BOARD = "chessboard:9x6:25mm"  # inner corners, side of a square


def draw_photos(folder: Path) -> list[Path]:
    """Ten photos of a board on a cluttered table, by a camera whose parameters are known."""
    board, camera, rng = cb.parse_target(BOARD), standard_camera(), np.random.default_rng(5)
    paths = []
    for i, T_camera_target in enumerate(look_at_board(camera, board.points, 10, rng=rng, distance=(0.25, 0.5))):
        paths.append(folder / f"{i}.png")
        cv2.imwrite(str(paths[-1]), render(board.artwork(), camera, T_camera_target, rng=rng))
    return paths


with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    target, photos = (sys.argv[1], sys.argv[2:]) if len(sys.argv) > 2 else (BOARD, draw_photos(folder))
    result = cb.intrinsics(photos, target=target, cache="none")
    print(result)

    print("\nparameter      found        1 sigma        truth")
    truth = standard_camera().parameters if len(sys.argv) < 3 else {}
    for key, value in result.camera.parameters.items():
        print(f"{key:9} {value:12.5f}  {result.camera.sigma[key]:11.5f}  {truth.get(key, np.nan):12.5f}")

    result.write(folder / "camera.json")
    again = cb.read(folder / "camera.json")
    print(f"\nRead back from its file: fx = {again.camera.parameters['fx']:.3f} px, verdict {again.verdict}")
