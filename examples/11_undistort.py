"""Make straight lines straight: pictures of a pinhole camera from those of a real one, and how straight they are."""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np

import calibrant as cb
from calibrant.geometry import se3, so3
from calibrant.simulate.render import render
from calibrant.simulate.scenes import intrinsics_scene

BOARD = "chessboard:9x6:25mm"


def bend_px(photo: Path) -> tuple[float, float]:
    """How far the nine corners of the board's first row lie from a straight line, rms, and the noise of a corner."""
    seen = cb.detect([photo], target=BOARD).views[0]
    row = seen.uv[seen.points[:, 1] == 0]
    across = np.linalg.svd(row - row.mean(axis=0), compute_uv=False)[1]
    return float(across / np.sqrt(len(row))), float(np.median(seen.sigma_px))


scene = intrinsics_scene(20, seed=1)
board, rng = cb.parse_target(BOARD), np.random.default_rng(0)
T_camera_target = se3.make(so3.exp([0.1, -0.2, 0]), [-0.09, -0.09, 0.24])

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    camera = cb.calibrate_intrinsics(scene.observations)
    camera.write(folder / "camera.json")
    cv2.imwrite(f"{folder}/photo.png", render(board.artwork(), scene.camera, T_camera_target, rng=rng))

    cb.undistort(folder / "photo.png", camera=folder / "camera.json", out=folder / "straight", alpha=0)

    pinhole = cb.read(folder / "straight" / "camera.json").camera
    fx, sigma = camera.camera.parameters["fx"], camera.camera.sigma["fx"]
    print(f"the camera:     fx = {fx:.2f} ± {sigma:.2f} px, with distortion")
    print(f"the new camera: fx = {pinhole.parameters['fx']:.2f} px, {pinhole.image_size} px, a pinhole")
    for label, photo in (("in the photo", folder / "photo.png"), ("undistorted", folder / "straight" / "photo.png")):
        bend, noise = bend_px(photo)
        print(f"a row of corners, {label}: {bend:.3f} px rms from a straight line, 1 sigma of a corner {noise:.3f} px")
