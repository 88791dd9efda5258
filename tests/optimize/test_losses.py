"""Robust losses: formulas, weights as derivatives, scales."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.optimize.losses import Loss, cauchy, geman_mcclure, huber, squared

LOSSES = {"squared": squared(), "huber": huber(1.5), "cauchy": cauchy(2.0), "gm": geman_mcclure(3.0, mu=4.0)}


@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_weight_is_the_derivative(loss: Loss) -> None:
    s = np.array([1e-6, 0.3, 1.0, 2.2, 2.3, 30.0, 1e4])  # on both sides of Huber's corner at 2.25
    h = 1e-6 * np.maximum(s, 1e-3)
    difference = (loss.evaluate(s + h)[0] - loss.evaluate(s - h)[0]) / (2 * h)
    np.testing.assert_allclose(loss.evaluate(s)[1], difference, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_small_residuals_count_fully(loss: Loss) -> None:
    rho, weight = loss.evaluate(np.array([0.0, 1e-8]))
    np.testing.assert_allclose(rho, [0, 1e-8], rtol=1e-6)
    np.testing.assert_allclose(weight, 1, atol=1e-7)


def test_geman_mcclure_is_bounded() -> None:
    assert geman_mcclure(3.0).evaluate(np.array([1e12]))[0] == pytest.approx(9.0)
    assert geman_mcclure(3.0).evaluate(np.array([9.0]))[1] == pytest.approx(0.25)


@pytest.mark.parametrize("k", [0.0, -1.0, float("nan"), float("inf")])
def test_scales_must_be_positive(k: float) -> None:
    with pytest.raises(InputError, match="above 0"):
        huber(k)
