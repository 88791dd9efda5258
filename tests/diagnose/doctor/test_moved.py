"""The quick look at every place where something may have moved."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.diagnose.doctor.faults import moved


@pytest.mark.parametrize("counted", [40, moved.MOST_COUNTED])
@pytest.mark.parametrize("n", [7, 24, 61])
def test_medians_before_and_from_every_place(monkeypatch: pytest.MonkeyPatch, n: int, counted: int) -> None:
    """Those of NumPy, to the last digit: in one go and place by place, with equal values among them."""
    monkeypatch.setattr(moved, "MOST_COUNTED", counted)
    d = np.random.default_rng(n).normal(size=(n, 6)).round(1)
    places = np.arange(3, n - 2)
    before, after = moved._medians(d, places)
    np.testing.assert_array_equal(before, [np.median(d[:k], axis=0) for k in places])
    np.testing.assert_array_equal(after, [np.median(d[k:], axis=0) for k in places])
