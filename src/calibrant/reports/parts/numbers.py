"""Numbers as people should read them: rounded to their uncertainty, never without it when it is known.

Two significant digits of the standard deviation are kept and the value is cut at the same decimal (Guide to the
Expression of Uncertainty in Measurement, JCGM 100:2008, section 7.2.6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_DIGITS_WITHOUT_SIGMA = 5
"""Significant digits of a number whose uncertainty is not known: enough to compare, too few to look exact."""
_MOST_DECIMALS = 12


@dataclass(frozen=True)
class Figure:
    """A named number with its 1 sigma: sigma None when it is not known, 0 when the value was held fixed."""

    name: str
    value: float
    sigma: float | None
    unit: str

    @property
    def fixed(self) -> bool:
        """Whether the value was given, not estimated."""
        return self.sigma == 0.0

    @property
    def value_text(self) -> str:
        """The value alone, rounded to its uncertainty."""
        return value_text(self.value, self.sigma)

    def sigma_text(self, multiple: int = 1) -> str:
        """`multiple` times sigma, "fixed" for a value that was held, empty when it is not known."""
        return "fixed" if self.fixed else sigma_text(self.sigma, multiple=multiple)

    @property
    def text(self) -> str:
        """Value, uncertainty and unit in one string."""
        return with_sigma(self.value, self.sigma, unit=self.unit)


def decimals_of(sigma: float) -> int:
    """Decimals that keep two significant digits of sigma; negative: digits before the point to round away."""
    return min(1 - math.floor(math.log10(abs(float(f"{sigma:.1e}")))), _MOST_DECIMALS)


def value_text(value: float, sigma: float | None) -> str:
    """The value rounded to the last digit that `sigma` (same unit, 1 sigma) leaves meaningful."""
    if not math.isfinite(value):
        return "unknown"
    if sigma is None or not math.isfinite(sigma) or sigma <= 0:
        return plain(value)
    decimals = decimals_of(sigma)
    return _signed_zero_free(f"{round(value, decimals):.{max(decimals, 0)}f}")


def sigma_text(sigma: float | None, *, multiple: int = 1) -> str:
    """`multiple` times sigma, cut at the decimal that two digits of 1 sigma set; empty when it is not known."""
    if sigma is None or not math.isfinite(sigma):
        return ""
    if sigma == 0:
        return "0"
    decimals = decimals_of(sigma)
    return f"{round(multiple * sigma, decimals):.{max(decimals, 0)}f}"


def with_sigma(value: float, sigma: float | None, *, unit: str = "") -> str:
    """Value ± 1 sigma with its unit, e.g. "531.92 ± 0.26 px"; without a known sigma, the value alone."""
    tail = f" {unit}" if unit and unit != "1" else ""
    if sigma is None or not math.isfinite(sigma) or sigma <= 0:
        return f"{value_text(value, sigma)}{tail}"
    return f"{value_text(value, sigma)} ± {sigma_text(sigma)}{tail}"


def plain(value: float, *, digits: int = _DIGITS_WITHOUT_SIGMA) -> str:
    """A number with `digits` significant digits and no exponent for ordinary sizes."""
    if not math.isfinite(value):
        return "unknown"
    if value == 0:
        return "0"
    magnitude = math.floor(math.log10(abs(value)))
    if not -_MOST_DECIMALS < magnitude < _MOST_DECIMALS:
        return f"{value:.{digits - 1}e}"
    return _signed_zero_free(f"{value:.{max(digits - 1 - magnitude, 0)}f}")


def _signed_zero_free(text: str) -> str:
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text
