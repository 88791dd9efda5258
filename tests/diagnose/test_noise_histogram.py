"""The histogram of residuals: counts as NumPy's, the noise of the model, what lies far out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.data import CalibrationResult
from calibrant.diagnose.noise_histogram import noise_histograms


def test_noise_as_stated_falls_as_expected(intrinsics_result: CalibrationResult) -> None:
    rng, sigma = np.random.default_rng(0), 0.1
    result = replace(intrinsics_result, sigma_px=sigma)
    r = rng.normal(scale=sigma, size=(20000, 2))
    (found,) = noise_histograms(result, [("camera", r[:9000]), ("camera", r[9000:])])
    assert found.total == 40000
    assert found.expected.sum() == pytest.approx(40000)
    # Each count is Poisson's: chi^2 per bin about 1.
    busy = found.expected > 5
    assert np.mean((found.counts - found.expected)[busy] ** 2 / found.expected[busy]) == pytest.approx(1.0, abs=0.6)
    assert found.far == pytest.approx(0.0027, abs=8e-4)
    assert found.far_expected == pytest.approx(0.0026998, abs=1e-6)


def test_without_a_stated_noise_there_is_none(intrinsics_result: CalibrationResult) -> None:
    assert noise_histograms(replace(intrinsics_result, sigma_px=None), [("camera", np.zeros((3, 2)))]) == ()
