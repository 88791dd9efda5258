"""Where is the target? From one photo by a camera that is known; and from one that leaves two answers open."""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np

import calibrant as cb
from calibrant.geometry import se3, so3
from calibrant.simulate.render import render
from calibrant.simulate.scenes import intrinsics_scene

scene = intrinsics_scene(20, seed=1)
calibrated = cb.calibrate_intrinsics(scene.observations)  # its uncertainty counts below
rng = np.random.default_rng(0)

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    calibrated.write(folder / "camera.json")
    for spec, tilt_deg, distance in (
        ("charuco:8x6:30mm:22mm:DICT_5X5_100", 30.0, 0.5),
        ("marker:40mm:DICT_APRILTAG_36h11:10", 20.0, 1.5),  # a small thing, far away
    ):
        target = cb.parse_target(spec)
        R = so3.exp([0, np.deg2rad(tilt_deg), 0]) @ so3.exp([0, 0, 0.3])
        T_camera_target = se3.make(R, [0.02, 0.01, distance])
        cv2.imwrite(f"{folder}/photo.png", render(target.artwork(), scene.camera, T_camera_target, rng=rng))

        result = cb.pose(folder / "photo.png", camera=folder / "camera.json", target=spec, cache="none")
        print(f"{spec}: verdict {result.verdict}")
        for found in result.transforms:
            off = 1e3 * (found.matrix[:3, 3] - T_camera_target[:3, 3])
            turn = np.rad2deg(np.linalg.norm(se3.local(found.matrix, T_camera_target)[:3]))
            print(
                f"  {found.child}: 1 sigma {np.round(found.sigma_translation_mm, 3)} mm, off by {np.round(off, 3)} mm"
            )
            print(f"      rotation 1 sigma {np.round(found.sigma_rotation_deg, 3)} deg, off by {turn:.3f} deg")
        for check in result.checks:
            if check.status != "ok":
                print(f"  {check.status}: {check.name}: {check.message}")
