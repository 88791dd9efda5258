"""Two cameras on one gripper in one problem: the transform between them comes out better than either mounting."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import calibrant as cb
from calibrant.geometry import se3
from calibrant.simulate.cell import make_cell, photograph
from calibrant.simulate.scenes import target_poses

T_left_right = se3.exp([0.02, -0.05, 0.03, 0.06, 0.004, -0.002])  # the truth: 6 cm apart, turned by 3 degrees

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    left = make_cell(4, views=9)
    X = left.X @ T_left_right
    right = replace(left, X=X, T_camera_target=target_poses(left.setup, X, left.Z, left.T_base_gripper))
    photograph(left, folder / "left")
    photograph(right, folder / "right")

    result = cb.hand_eye(
        images={"left": folder / "left" / "images", "right": folder / "right" / "images"},
        poses=folder / "left" / "poses.csv",
        target=left.target.spec,
        cache="none",
    )

print(result)
print()
for parent, child, truth in (
    ("gripper", "left", left.X),
    ("gripper", "right", right.X),
    ("left", "right", T_left_right),
):
    found = result.transform(parent, child)
    off = 1e3 * (found.matrix[:3, 3] - truth[:3, 3])
    print(f"T_{parent}_{child}: off by {np.round(off, 3)} mm, 1 sigma {np.round(found.sigma_translation_mm, 3)} mm")
