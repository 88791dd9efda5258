"""What a stereo pair states of itself against the truth, over seeds; benchmarks/eyes/stereo.py has a thousand."""

from __future__ import annotations

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.stereo.depth import point_certainty
from calibrant.geometry import se3
from calibrant.geometry.triangulation import refine_points, triangulate
from calibrant.simulate.stereo import stereo_scene
from calibrant.simulate.truth import normalised

POINT = np.array([[0.02, 0.01, 0.65]])
SEEDS = 40


@pytest.mark.statistics
def test_transform_baseline_and_depth_err_as_stated() -> None:
    scores, baselines, depths = [], [], []
    for seed in range(SEEDS):
        scene = stereo_scene(5000 + seed)
        found = cb.calibrate_stereo(scene.observations)
        T, baseline = found.transform("left", "right"), found.figures["baseline"]
        scores.append(normalised(T, scene.T_left_right))
        baselines.append((baseline.value - 1e3 * np.linalg.norm(scene.T_left_right[:3, 3])) / baseline.sigma)
        T_right_left = se3.inverse(scene.T_left_right)
        uv = scene.cameras["left"].project(POINT), scene.cameras["right"].project(se3.apply(T_right_left, POINT))
        left, right = found.cameras["left"], found.cameras["right"]
        rays, at = np.stack([left.unproject(uv[0]), right.unproject(uv[1])]), np.stack([np.eye(4), T.matrix])
        (p,) = refine_points(triangulate(rays, T_world_camera=at), rays, T_world_camera=at)
        assert found.joint_covariance is not None
        C = found.joint_covariance.whole
        sure = point_certainty((left, right), at, p, covariance=C, sigma_px=(1.0, 1.0)).calibration[0]
        depths.append((p[2] - POINT[0, 2]) / np.sqrt(sure[2, 2]))
    # The mean of 40 chi-squares of 6 has a deviation of sqrt(12 / 40) = 0.55, the rms of 40 normals one of 0.11.
    assert 4.3 < np.mean(scores) < 7.7
    for values in (baselines, depths):
        assert 0.67 < np.sqrt(np.mean(np.square(values))) < 1.33
        assert np.mean(np.abs(values) < 1.96) >= 0.85
