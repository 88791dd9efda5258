"""Doubles as text with all their digits, as every file that is written has them: read again they are the same."""

from __future__ import annotations

from collections.abc import Iterable


def text_of(values: Iterable[float]) -> list[str]:
    """Each number's shortest text that is read as the same double, none of them a zero below zero."""
    return [repr(float(v) + 0.0) for v in values]


def row_of(values: Iterable[float]) -> str:
    """Numbers in a row with blanks between them."""
    return " ".join(text_of(values))


def digits(value: float) -> str:
    """A double with all its digits and a point, which YAML 1.1 wants in every float.

    >>> digits(1e-7), digits(2.0)
    ('1.0e-07', '2.0')
    """
    mantissa, e, exponent = text_of((value,))[0].partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + (f"e{int(exponent):+03d}" if e else "")
