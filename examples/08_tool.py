"""Where is the tool's tip? Touch one point from several directions, and write down the robot's poses."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import calibrant as cb
from calibrant.geometry import se3, so3
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.noise import noisy_poses

TIP = np.array([0.012, -0.034, 0.151])  # the truth, metres in the flange
POINT = np.array([0.5, 0.1, 0.05])  # the touched point, metres in the base

rng = np.random.default_rng(0)
down = so3.exp([np.pi, 0, 0])
R = down @ so3.exp(0.6 * rng.uniform(-1, 1, (8, 3)))  # the flange points down, tilted by up to 35 degrees
true = se3.make(R, POINT - R @ TIP)

with tempfile.TemporaryDirectory() as name:
    poses = Path(name) / "touches.csv"
    said = cb.RobotPoses.from_matrices(noisy_poses(true, sigma_mm=0.1, sigma_deg=0.02, rng=rng))
    poses.write_text(poses_csv(said), encoding="utf-8")
    result = cb.tool_touch(poses=poses)

print(result)
tip = result.transform("flange", "tip")
print(f"\ntip at       {np.round(1e3 * tip.matrix[:3, 3], 3)} mm in the flange")
print(f"1 sigma      {np.round(tip.sigma_translation_mm, 3)} mm")
print(f"truth        {np.round(1e3 * TIP, 3)} mm")
