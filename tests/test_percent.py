"""Shares in messages are numbers that people write."""

from __future__ import annotations

import pytest

from calibrant.percent import percent
from calibrant.reports.kinds.unchanged import chance_text


@pytest.mark.parametrize(
    ("share", "said"), [(0.00123, "0.12 %"), (-0.254, "25 %"), (0.995, "100 %"), (1.1, "110 %"), (0.0, "0 %")]
)
def test_two_digits_and_no_powers_of_ten(share: float, said: str) -> None:
    assert percent(share) == said


def test_a_chance_near_one_is_no_power_of_ten() -> None:
    assert [chance_text(p) for p in (1.0, 0.998, 0.003, 1e-9)] == ["100 %", "100 %", "0.3 %", "below 1 in a million"]
