"""Shares in messages are numbers that people write."""

from __future__ import annotations

import pytest

from calibrant.percent import percent


@pytest.mark.parametrize(
    ("share", "said"), [(0.00123, "0.12 %"), (-0.254, "25 %"), (0.995, "100 %"), (1.1, "110 %"), (0.0, "0 %")]
)
def test_two_digits_and_no_powers_of_ten(share: float, said: str) -> None:
    assert percent(share) == said
