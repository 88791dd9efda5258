"""What rounding leaves in a mean: as simulated, and in a plane seen straight on."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.planes import find_plane, rays_of
from calibrant.perceive.registered_depth.steps import depth_step, mean_rounding, rounding_error


@pytest.mark.parametrize("scatter", [0.0, 0.1, 0.2, 0.3])
def test_rounding_leaves_as_much_in_a_mean_as_stated(scatter: float) -> None:
    rng = np.random.default_rng(1)
    truths = (np.arange(400) + 0.5) / 400
    left = [float(np.mean(np.rint(t + scatter * rng.standard_normal(2000)))) - t for t in truths]
    # The mean of 2000 scatters by less than 0.008; 29 terms leave out 1 % where nothing scatters.
    assert rounding_error(1.0, scatter) == pytest.approx(float(np.sqrt(np.mean(np.square(left)))), rel=0.06, abs=0.003)


def test_the_step_is_read_from_the_depths() -> None:
    rng = np.random.default_rng(2)
    z = (0.22 + 0.0003 * rng.standard_normal((60, 80))).astype(np.float32)
    assert depth_step(z, 0.22) < 1e-5
    assert mean_rounding(z, 1 / z.ravel()) < 1e-6
    assert depth_step(np.rint(z * 1000) / 1000, 0.22) == pytest.approx(0.001, abs=1e-6)


@pytest.mark.parametrize("phase", [0.0, 0.25, 0.5])
def test_a_plane_in_whole_millimetres_is_as_far_as_stated(phase: float) -> None:
    """Seen straight on, nearly all depths of a table are one and the same number."""
    camera = Camera.create("pinhole", {"fx": 308.0, "fy": 308.0, "cx": 159.5, "cy": 119.5}, image_size=(320, 240))
    rng = np.random.default_rng(3)
    away = 0.22 + 1e-3 * phase
    noise = DepthNoise.stereo(focal_px=308.0, baseline_m=0.05)
    z = away + float(noise.sigma_z(away)) * 0.5 * rng.standard_normal((240, 320))
    z = np.rint(z * 1000) / 1000
    plane = find_plane(z, rays_of(camera), np.ones(z.shape, dtype=bool), noise=noise)
    off = plane.a - np.array([0.0, 0.0, 1 / away])
    # Three numbers: chi-squared beyond 16.3 comes once in a thousand.
    assert off @ np.linalg.solve(plane.covariance, off) < 16.3
    assert abs(1e3 * (plane.distance - away)) < 0.5
    # A plane of one number alone would be certain of itself; half a step is all that it knows.
    assert 1e3 * plane.distance**2 * np.sqrt(plane.covariance[2, 2]) < 0.5
    assert phase != 0.0 or plane.share > 0.99
