"""Least squares under inequalities: its optimality conditions, and standing still where they contradict each other."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.servoing.within import least_squares_within


@pytest.mark.parametrize("seed", range(20))
def test_no_allowed_step_makes_it_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(8, 5)), 3 * rng.normal(size=8)
    G, h = rng.normal(size=(12, 5)), -rng.uniform(0, 0.5, 12)
    x = least_squares_within(A, b, G, h)
    assert np.all(G @ x >= h - 1e-9)
    active = G[np.abs(G @ x - h) < 1e-8]
    gradient = A.T @ (A @ x - b)
    if not len(active):
        np.testing.assert_allclose(gradient, 0, atol=1e-9)
        return
    # Karush, Kuhn, Tucker: the gradient is a sum of active rows with factors that are not negative.
    factors = np.linalg.lstsq(active.T, gradient, rcond=None)[0]
    np.testing.assert_allclose(active.T @ factors, gradient, atol=1e-7)
    assert np.all(factors >= -1e-7)


def test_without_bounds_that_matter_it_is_plain_least_squares() -> None:
    rng = np.random.default_rng(0)
    A, b = rng.normal(size=(8, 5)), rng.normal(size=8)
    x = least_squares_within(A, b, np.eye(5), np.full(5, -100.0))
    np.testing.assert_allclose(x, np.linalg.lstsq(A, b, rcond=None)[0], atol=1e-12)
