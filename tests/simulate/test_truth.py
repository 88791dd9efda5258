"""The comparison with the truth: exact on constructed errors, and chi-square on drawn ones."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.data import as_transform
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.simulate.truth import point_truth, transform_truth

T_TRUE = se3.exp([0.4, -0.2, 0.9, 0.1, 0.3, -0.2])


def test_a_known_error_is_measured() -> None:
    delta = np.array([np.deg2rad(0.3), 0, 0, 3e-3, 4e-3, 0])
    estimate = as_transform("base", "camera", se3.retract(T_TRUE, -delta), np.diag(delta**2 + 1e-12))
    truth = transform_truth(estimate, T_TRUE)
    assert truth.translation_mm == pytest.approx(5.0)
    assert truth.rotation_deg == pytest.approx(0.3)
    assert truth.normalised == pytest.approx(3.0, rel=1e-4)  # three axes off by one sigma each
    assert truth.inside


@pytest.mark.statistics
def test_the_region_holds_99_of_100() -> None:
    rng = np.random.default_rng(0)
    L = 1e-3 * (np.tril(rng.normal(size=(6, 6))) + 3 * np.eye(6))
    n = 1500
    draws = [
        transform_truth(as_transform("a", "b", se3.retract(T_TRUE, L @ rng.standard_normal(6)), L @ L.T), T_TRUE)
        for _ in range(n)
    ]
    assert np.mean([d.normalised for d in draws]) == pytest.approx(6.0, abs=4 * np.sqrt(12 / n))
    assert np.mean([d.inside for d in draws]) == pytest.approx(0.99, abs=4 * np.sqrt(0.0099 / n))


@pytest.mark.statistics
def test_the_points_sigma_is_the_rms_of_its_error() -> None:
    rng = np.random.default_rng(1)
    L = 1e-3 * (np.tril(rng.normal(size=(6, 6))) + 2 * np.eye(6))
    p = np.array([0.05, -0.1, 0.5])
    n = 1500
    found = [
        point_truth(as_transform("a", "b", se3.retract(T_TRUE, L @ rng.standard_normal(6)), L @ L.T), T_TRUE, p)
        for _ in range(n)
    ]
    rms = np.sqrt(np.mean([f.error_mm**2 for f in found]))
    # The mean of three correlated squares over n draws: at most sqrt(2 / n) relative, half of it for the root.
    assert rms == pytest.approx(np.mean([f.sigma_mm for f in found]), rel=4 * np.sqrt(0.5 / n))


def test_an_estimate_without_covariance_is_refused() -> None:
    with pytest.raises(InputError, match="no covariance"):
        transform_truth(as_transform("base", "camera", T_TRUE), T_TRUE)
