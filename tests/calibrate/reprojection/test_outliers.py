"""The limit between noise and fault, from the residuals alone."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.reprojection.outliers import MINIMUM_LIMIT_SIGMAS, mark, median


def norms(n: int, sigma: float, seed: int = 0) -> np.ndarray:
    return np.linalg.norm(np.random.default_rng(seed).normal(0, sigma, (n, 2)), axis=1)


def test_the_scale_survives_a_minority_of_gross_errors() -> None:
    r = norms(2000, 0.2)
    r[:400] += 30
    found = mark(r, np.arange(0, 2001, 100))
    # 20 % of contamination moves the median to the 62.5 % point of the rest: a factor of 1.19.
    assert 0.2 < found.sigma_px < 0.27
    assert not found.keep[:400].any()
    assert found.keep[400:].all()


@pytest.mark.statistics
def test_clean_data_lose_nothing() -> None:
    lost = sum(int((~mark(norms(1000, 0.1, seed), np.array([0, 1000])).keep).sum()) for seed in range(50))
    assert lost <= 1  # 0.01 points are expected per set at the least, so 0.5 in fifty


def test_a_view_goes_as_a_whole_when_most_of_it_is_wrong() -> None:
    r = norms(300, 0.1)
    r[100:160] += 5  # 60 of 100
    r[200:240] += 5  # 40 of 100
    found = mark(r, np.array([0, 100, 200, 300]))
    assert found.drop_view.tolist() == [False, True, False]
    assert not found.keep[100:200].any()
    assert found.keep[240:].all()


def test_a_person_can_lower_the_limit_but_not_raise_it() -> None:
    r = norms(500, 0.1)
    offsets = np.array([0, 500])
    assert mark(r, offsets, max_error_px=0.15).limit_px == 0.15
    assert mark(r, offsets, max_error_px=50.0).limit_px == mark(r, offsets).limit_px
    assert mark(r, offsets).limit_px >= MINIMUM_LIMIT_SIGMAS * mark(r, offsets).sigma_px


def test_rounding_is_no_outlier() -> None:
    r = np.full(50, 1e-13)
    r[7] = 1e-9
    assert mark(r, np.array([0, 50])).keep.all()


def test_the_median_is_numpys() -> None:
    for n in (1, 2, 7, 1000):
        values = np.random.default_rng(n).normal(size=n)
        assert median(values) == np.median(values)
