"""Simulated views of a flat grid through any camera model: boards all around the field, facing the camera, tilted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.cameras import CameraModel
from calibrant.data import Observations
from calibrant.geometry import se3, so3

SIZE = (1280, 1024)
GRID = np.stack([*np.meshgrid(np.arange(9), np.arange(7)), np.zeros((7, 9))], axis=-1).reshape(-1, 3) * 0.03
GRID -= GRID.mean(axis=0)


def board_poses(count: int, *, reach_deg: float, distance: tuple[float, float], seed: int = 51) -> np.ndarray:
    """T_camera_target (count, 4, 4): centres up to reach_deg from the axis, leaning by up to 40 degrees."""
    rng = np.random.default_rng(seed)
    angle = np.deg2rad(reach_deg) * np.sqrt(rng.uniform(0, 1, count))
    around = rng.uniform(0, 2 * np.pi, count)
    to_centre = so3.exp(np.stack([-np.sin(around) * angle, np.cos(around) * angle, np.zeros(count)], axis=1))
    lean = so3.exp(rng.uniform(-0.7, 0.7, (count, 3)) * [1, 1, 2])
    centre = to_centre @ np.array([0.0, 0.0, 1.0]) * rng.uniform(*distance, (count, 1))
    return se3.make(to_centre @ lean, centre)


def observe(
    model: CameraModel, values: Sequence[float] | np.ndarray, T: np.ndarray, *, sigma: float, seed: int = 52
) -> Observations:
    """Points that lie in the image and in the valid field, with noise; views with fewer than 20 are left out."""
    rng = np.random.default_rng(seed)
    points, pixels = [], []
    for pose in T:
        p = se3.apply(pose, GRID)
        keep = model.valid(values, p)
        uv = model.project(values, np.where(keep[:, None], p, [0, 0, 1.0]))
        keep &= np.all((uv >= 0) & (uv < SIZE), axis=1)
        if keep.sum() >= 20:
            points.append(GRID[keep])
            pixels.append(uv[keep] + rng.normal(0, sigma, (int(keep.sum()), 2)))
    return Observations.from_points(points, pixels, image_size=SIZE)
