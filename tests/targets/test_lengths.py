"""Lengths: exact both ways, and refused with the reason."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrant.errors import InputError
from calibrant.targets.lengths import format_length, parse_length


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("25mm", 0.025),
        ("0.025m", 0.025),
        ("1in", 0.0254),
        ("2.5cm", 0.025),
        ("250um", 0.00025),
        ("250µm", 0.00025),
        (" 36.195 mm ", 0.036195),
        ("1e-3m", 0.001),
    ],
)
def test_a_length_is_the_nearest_double(text: str, metres: float) -> None:
    assert parse_length(text) == metres


@given(st.floats(min_value=1e-9, max_value=1e6))
def test_a_written_length_reads_back_equal(metres: float) -> None:
    assert parse_length(format_length(metres)) == metres


def test_millimetres_are_written_as_people_write_them() -> None:
    assert format_length(0.036195) == "36.195mm"
    assert format_length(0.1) == "100mm"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("25", "no unit; write 25mm or 25m"),
        ("25furlong", "unknown unit 'furlong'.*mm, cm, m"),
        ("mm", "is not a length"),
        ("", "is not a length"),
        ("-3mm", "above 0"),
        ("0mm", "above 0"),
        ("1e999m", "above 0"),
        ("1.2.3mm", "is not a number"),
    ],
)
def test_what_is_not_a_length_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_length(text, what="the square's side")
