"""Values as people type them: names with commas, names with values, pixels and per cent with their units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from calibrant.errors import InputError


def split_names(values: Sequence[str]) -> tuple[str, ...]:
    """Names given as separate values or separated by commas."""
    return tuple(n.strip() for value in values for n in value.split(",") if n.strip())


def pixels(text: str | None, *, option: str) -> float | None:
    """A length in pixels with its unit: 1.0px. Raises: InputError for a bare number or another unit."""
    if text is None:
        return None
    number = text.strip().removesuffix("px").strip()
    try:
        value = float(number)
    except ValueError:
        value = -1.0
    if not text.strip().endswith("px") or not 0 < value < float("inf"):
        raise InputError(f"{option} takes a length in pixels with its unit, such as 1.0px; got {text!r}")
    return value


def by_name(option: str, pairs: tuple[str, ...]) -> Mapping[str, str]:
    """NAME=VALUE by name. Raises: InputError for what is no pair."""
    parts = [pair.partition("=") for pair in pairs]
    bad = next((name for name, equals, _ in parts if not (name and equals)), None)
    if bad is not None:
        raise InputError(f"{option} takes NAME=VALUE, got {bad!r}")
    return {name: value for name, _, value in parts}
