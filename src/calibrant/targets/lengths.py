"""Lengths as people type them, always with their unit: 25mm, 0.025m, 2.5cm, 1in."""

from __future__ import annotations

import re
from decimal import Decimal, InvalidOperation

from calibrant.errors import InputError

# Decimal, not float: 36.195mm must be the double nearest to 0.036195, so that a length written and read back is equal.
METRES_PER_UNIT: dict[str, Decimal] = {
    "mm": Decimal("0.001"),
    "cm": Decimal("0.01"),
    "m": Decimal("1"),
    "um": Decimal("0.000001"),
    "in": Decimal("0.0254"),
}
_LENGTH = re.compile(r"\s*(?P<number>[+-]?[0-9.][0-9.eE+-]*?)\s*(?P<unit>[^\W\d_]*)\s*")


def parse_length(text: str, *, what: str = "a length") -> float:
    """Metres of a length with its unit.

    Args: text such as 25mm; what, how messages call the length.
    Raises: InputError for a bare number, an unknown unit, or a length that is not finite and above 0.
    """
    return check_length(parse_coordinate(text, what=what), what=what)


def parse_coordinate(text: str, *, what: str) -> float:
    """Metres of a length with its unit that may be 0 or negative.

    Raises: InputError for a bare number, an unknown unit, or a length that is not finite.
    """
    match = _LENGTH.fullmatch(text)
    if match is None:
        raise InputError(f"{what}: {text!r} is not a length; write a number and its unit, such as 25mm or 0.025m")
    unit = match["unit"].replace("µ", "u").replace("μ", "u")
    if not unit:
        raise InputError(f"{what}: {text!r} has no unit; write {text.strip()}mm or {text.strip()}m, whichever it is")
    if unit not in METRES_PER_UNIT:
        raise InputError(f"{what}: unknown unit {unit!r} in {text!r}; known units: {', '.join(METRES_PER_UNIT)}")
    try:
        return float(Decimal(match["number"]) * METRES_PER_UNIT[unit])
    except InvalidOperation:
        raise InputError(f"{what}: {match['number']!r} in {text!r} is not a number") from None


def check_length(metres: float, *, what: str) -> float:
    """The length, checked. Raises: InputError when it is not finite and above 0."""
    if not 0.0 < metres < float("inf"):
        raise InputError(f"{what} must be a finite length above 0, got {metres:g} m")
    return metres


def format_length(metres: float) -> str:
    """The length in millimetres with every digit it has: `parse_length` gives the same double back."""
    millimetres = Decimal(repr(float(metres))) / METRES_PER_UNIT["mm"]
    return f"{millimetres.normalize():f}mm"
