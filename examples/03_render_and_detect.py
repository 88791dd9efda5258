"""Draw a ChArUco board as a camera would see it, find it again, and see how far the corners are from the truth."""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np

import calibrant as cb
from calibrant.geometry import se3
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import look_at_board, standard_camera

board = cb.parse_target("charuco:8x6:30mm:22mm:DICT_5X5_100")
camera = standard_camera()
rng = np.random.default_rng(0)
poses = look_at_board(camera, board.points, 3, rng=rng, distance=(0.35, 0.6))
look = Look(blur_px=0.8, noise_grey=4.0, clutter=60)  # a soft lens, a noisy sensor, things lying around

with tempfile.TemporaryDirectory() as folder:
    for i, T_camera_target in enumerate(poses):
        cv2.imwrite(f"{folder}/{i}.png", render(board.artwork(), camera, T_camera_target, rng=rng, look=look))
    observations = cb.detect(sorted(Path(folder).glob("*.png")), target=board)

for view, T_camera_target in zip(observations.views, poses):
    truth = camera.project(se3.apply(T_camera_target, view.points))
    error = np.sqrt(np.mean((view.uv - truth) ** 2))
    print(f"{view.id}: {len(view)} of {len(board.points)} corners, {error:.3f} px RMS per axis from the truth")
    assert error < 0.1, "rendered corners are found to a few hundredths of a pixel"
assert len(observations.views) == len(poses)
