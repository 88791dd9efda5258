"""Where is the board? From one photo by a camera that is known; and from one that leaves two answers open."""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np

import calibrant as cb
from calibrant.geometry import se3, so3
from calibrant.simulate.render import render
from calibrant.simulate.scenes import intrinsics_scene

BOARD = "charuco:8x6:30mm:22mm:DICT_5X5_100"
scene = intrinsics_scene(20, seed=1)
calibrated = cb.calibrate_intrinsics(scene.observations)  # its uncertainty counts below
board, rng = cb.parse_target(BOARD), np.random.default_rng(0)
middle = 0.5 * (board.points.min(axis=0) + board.points.max(axis=0))

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    calibrated.write(folder / "camera.json")
    for label, tilt_deg, distance in (("near and tilted", 30.0, 0.5), ("far and nearly square", 3.0, 1.8)):
        R = so3.exp([0, np.deg2rad(tilt_deg), 0]) @ so3.exp([0, 0, 0.3])
        T_camera_target = se3.make(R, np.array([0.02, 0.01, distance]) - R @ middle)
        cv2.imwrite(f"{folder}/photo.png", render(board.artwork(), scene.camera, T_camera_target, rng=rng))

        result = cb.pose(folder / "photo.png", camera=folder / "camera.json", target=BOARD, cache="none")
        found = result.transform("camera", "target")
        off = 1e3 * (found.matrix[:3, 3] - T_camera_target[:3, 3])
        print(f"{label}: verdict {result.verdict}")
        print(f"  place   {np.round(1e3 * found.matrix[:3, 3], 2)} mm, 1 sigma {np.round(found.sigma_translation_mm, 3)}")
        print(f"  off by  {np.round(off, 3)} mm; rotation known to {np.round(found.sigma_rotation_deg, 3)} deg (1 sigma)")
        for check in result.checks:
            if check.status != "ok":
                print(f"  {check.status}: {check.name}: {check.message}")
