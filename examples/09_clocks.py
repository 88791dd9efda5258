"""Camera and robot each have a clock: by how much do they differ? From one smooth motion that both recorded."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import calibrant as cb
from calibrant.geometry import rotations, se3, so3
from calibrant.simulate.noise import noisy_poses

OFFSET = 0.043  # seconds: the camera's clock is behind


def gripper(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """T_base_gripper at times t: a sweep that turns about all axes, by up to a radian a second."""
    w = np.stack([0.5 * np.sin(1.3 * t), 0.4 * np.sin(0.9 * t + 1), 0.5 * np.cos(1.7 * t)], axis=-1)
    p = np.stack([0.5 + 0.15 * np.sin(1.1 * t), 0.2 * np.cos(0.8 * t), 0.4 + 0.1 * np.sin(1.9 * t)], axis=-1)
    return se3.make(so3.exp(w), p)


def save(path: Path, times: NDArray[np.float64], T: NDArray[np.float64]) -> Path:
    """Times in seconds and poses, one a line."""
    rows = np.column_stack([times, T[:, :3, 3], rotations.quaternion_xyzw_from_matrix(T[:, :3, :3])])
    lines = ["timestamp,x,y,z,qx,qy,qz,qw", *(",".join(f"{v:.9f}" for v in row) for row in rows)]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


rng = np.random.default_rng(0)
T_gripper_camera = se3.exp([0.3, -0.2, 0.5, 0.03, -0.05, 0.1])
T_base_target = se3.exp([2.9, 0.1, 0.2, 0.6, 0.1, 0.0])
robot_times, image_times = np.arange(0, 9, 0.008), np.arange(0.5, 8.5, 1 / 30)
T_camera_target = se3.inverse(gripper(image_times) @ T_gripper_camera) @ T_base_target
seen = noisy_poses(T_camera_target, sigma_mm=0.2, sigma_deg=0.02, rng=rng)

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    result = cb.time_offset(
        poses=save(folder / "robot.csv", robot_times, gripper(robot_times)),
        target_poses=save(folder / "camera.csv", image_times - OFFSET, seen),
        setup="eye-in-hand",
    )

print(result)
offset = result.figures["offset"]
print(f"\nt_robot = t_camera + {1e3 * offset.value:.3f} ± {1e3 * offset.sigma:.3f} ms; truth {1e3 * OFFSET:.0f} ms")
