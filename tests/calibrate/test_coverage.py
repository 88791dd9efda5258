"""95 % intervals hold the truth in 95 % of calibrations: a small size of benchmarks/monte_carlo_coverage.py."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.cameras import Camera, camera_model
from calibrant.simulate.scenes import IMAGE_SIZE, grid, look_at_board, observe
from calibrant.simulate.truth import chi_square

TRIALS = 80
LENSES = {
    "brown": (520.0, 523.0, 645.0, 507.0, -0.02, 0.03, 1e-3, -1e-3, 0.01),
    "kannala_brandt": (520.0, 523.0, 645.0, 507.0, -0.02, 0.02, -0.02, 0.03),
}


@pytest.mark.statistics
@pytest.mark.parametrize("model", LENSES)
def test_intervals_hold_the_truth(model: str) -> None:
    camera, board = Camera(camera_model(model), IMAGE_SIZE, np.array(LENSES[model])), grid(11, 8, 0.03)
    rng = np.random.default_rng(7)
    T = look_at_board(camera, board, 20, rng=rng, distance=(0.15, 0.45), tilt_deg=45)
    scores, chi = [], []
    for _ in range(TRIALS):
        found = calibrate_intrinsics(observe(camera, board, T, sigma_px=0.1, rng=rng), model=model).camera
        error = found.values - camera.values
        scores.append(error / np.array(list(found.sigma.values())))
        chi.append(chi_square(error, found.covariance))
    covered = np.mean(np.abs(scores) <= 1.96, axis=0)
    one = np.sqrt(0.95 * 0.05 / TRIALS)  # binomial, 1 sigma of one parameter's share
    assert covered.min() > 0.95 - 4 * one
    # Parameters that move together are covered together: their mean may be as uncertain as one of them.
    assert abs(covered.mean() - 0.95) < 3 * one
    k = len(camera.values)
    assert np.mean(chi) == pytest.approx(k, abs=4 * np.sqrt(2 * k / TRIALS))
    # No share of 1 in each: sigmas that are too large would pass all above but the mean of chi-square.
    assert np.std(scores, axis=0).mean() == pytest.approx(1, abs=3 / np.sqrt(2 * TRIALS))
