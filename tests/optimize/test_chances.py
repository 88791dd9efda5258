"""The chances against SciPy's, over the arguments that the tests of the data use."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import fdtrc, gammaincc, stdtr

from calibrant.optimize.chances import chi2_tail, f_tail, share_tail, t_tail

FREEDOMS = [(6, 0.5), (6, 3.0), (4, 47.5), (6, 5994.0), (1, 12), (2994, 2994), (57, 57), (120, 30), (6, 1e6)]
F = np.array([0.0, 1e-6, 0.03, 0.5, 0.999, 1.0, 1.001, 1.3, 2.0, 7.0, 60.0, 1e4, 1e9])


@pytest.mark.parametrize(("numerator", "denominator"), FREEDOMS)
def test_f_tail(numerator: float, denominator: float) -> None:
    # ln Gamma of a thousand carries 1e-12; tails below 1e-290 are not told from zero.
    np.testing.assert_allclose(
        f_tail(numerator, denominator, F), fdtrc(numerator, denominator, F), rtol=2e-9, atol=1e-290
    )


@pytest.mark.parametrize("freedom", [1, 3, 40, 2000, 50000])
def test_t_tail(freedom: int) -> None:
    t = np.array([0.0, 1e-3, 0.7, 2.0, 9.0, 60.0])
    np.testing.assert_allclose(t_tail(freedom, t), stdtr(freedom, -t), rtol=2e-9, atol=1e-290)


@pytest.mark.parametrize("freedom", [1, 2, 12, 96, 1000, 200_000, 1_000_000])
def test_chi2_tail(freedom: int) -> None:
    values = freedom * np.array([0.0, 1e-4, 0.3, 0.9, 1.0, 1.1, 2.0, 9.0])
    ours = [chi2_tail(freedom, float(v)) for v in values]
    np.testing.assert_allclose(ours, gammaincc(freedom / 2, values / 2), rtol=2e-9, atol=1e-290)


def test_shapes_and_limits() -> None:
    assert f_tail(6, 30, 1.5).shape == ()
    assert f_tail(6, 30, np.ones((2, 3))).shape == (2, 3)
    np.testing.assert_array_equal(f_tail(6, 30, [0.0, np.inf]), [1.0, 0.0])


def test_share_of_squares_by_chance() -> None:
    """Of 10 squares with 6 degrees of freedom 2 unknowns take 8: F = (8 / 2) / (2 / 4) = 8 of (2, 4)."""
    assert share_tail(8.0, 10.0, unknowns=2, freedom=6.0) == pytest.approx(fdtrc(2, 4, 8.0), rel=1e-9)
    # Noise known to be 2 a number: what is left, 0.5 each, cannot make the share look rarer than that.
    assert share_tail(8.0, 10.0, unknowns=2, freedom=6.0, least=2.0) == pytest.approx(fdtrc(2, 4, 2.0), rel=1e-9)
    # Nothing left but rounding, or nothing at all: rare, and no chance to name.
    assert share_tail(10.0, 10.0, unknowns=2, freedom=6.0) == pytest.approx(0.0, abs=1e-25)
    assert share_tail(0.0, 0.0, unknowns=2, freedom=6.0) == 1.0
