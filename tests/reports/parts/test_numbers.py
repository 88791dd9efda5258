"""Numbers are cut where their uncertainty says, and carry it."""

from __future__ import annotations

import math

import pytest

from calibrant.reports.parts.numbers import Figure, plain, sigma_text, value_text, with_sigma


@pytest.mark.parametrize(
    ("value", "sigma", "expected"),
    [
        (531.9184, 0.2612, "531.92 ± 0.26"),
        (0.083412, 0.00113, "0.0834 ± 0.0011"),
        (-1265.731, 12.4, "-1266 ± 12"),
        (123456.0, 1234.0, "123500 ± 1200"),
        (-0.00001, 0.52, "0.00 ± 0.52"),
        (1.0, 0.0999, "1.00 ± 0.10"),
        (1.0, 0.996, "1.0 ± 1.0"),
    ],
)
def test_two_digits_of_sigma(value: float, sigma: float, expected: str) -> None:
    assert with_sigma(value, sigma) == expected


def test_unit_is_written_unless_the_number_is_pure() -> None:
    assert with_sigma(12.5, 0.5, unit="mm") == "12.50 ± 0.50 mm"
    assert with_sigma(12.5, 0.5, unit="1") == "12.50 ± 0.50"


def test_three_sigma_is_cut_at_the_decimal_of_one_sigma() -> None:
    assert sigma_text(0.2612) == "0.26"
    assert sigma_text(0.2612, multiple=3) == "0.78"


@pytest.mark.parametrize("sigma", [None, math.nan, math.inf])
def test_unknown_sigma_leaves_the_value_alone(sigma: float | None) -> None:
    assert with_sigma(531.91843, sigma, unit="px") == "531.92 px"
    assert sigma_text(sigma) == ""


def test_fixed_values_say_so() -> None:
    figure = Figure("k3", 0.0, 0.0, "1")
    assert (figure.value_text, figure.sigma_text()) == ("0", "fixed")


def test_values_that_are_not_finite_are_unknown() -> None:
    assert value_text(math.nan, 0.1) == "unknown"
    assert plain(math.inf) == "unknown"


@pytest.mark.parametrize(("value", "expected"), [(0.0, "0"), (1234.5678, "1234.6"), (-0.00012345678, "-0.00012346")])
def test_plain_keeps_five_significant_digits(value: float, expected: str) -> None:
    assert plain(value) == expected
