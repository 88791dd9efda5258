"""Values of options that hold for one camera of a pair or for both: left:k3, right=wide.yml, brown."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from calibrant.errors import InputError

SIDES = ("left", "right")
_SIDE = re.compile(r"^(?P<side>left|right)[:=](?P<value>.+)$")


def one_by_side(values: Sequence[str], *, option: str) -> dict[str, str]:
    """One value a side: a plain one is that of the sides that have none of their own.

    Raises: InputError for two values of one side.
    """
    own: dict[str, str] = {}
    plain: str | None = None
    for value in values:
        match = _SIDE.match(value)
        key, text = (match["side"], match["value"]) if match and not Path(value).exists() else ("", value)
        if key in own or (not key and plain is not None):
            raise InputError(f"{option} {value}: {'the ' + key + ' camera' if key else 'both sides'} has one already")
        if key:
            own[key] = text
        else:
            plain = text
    return {side: own.get(side, plain) for side in SIDES if own.get(side, plain) is not None}  # type: ignore[misc]


def named_by_side(values: Sequence[str], *, option: str) -> dict[str, Path]:
    """Files of the sides that are named. Raises: InputError for one without a side."""
    plain = next((v for v in values if _SIDE.match(v) is None), None)
    if plain is not None:
        raise InputError(f"{option} {plain}: say of which camera: left={plain} or right={plain}")
    return {side: Path(file) for side, file in one_by_side(values, option=option).items()}


def several_by_side(values: Sequence[str], *, option: str) -> dict[str, tuple[str, ...]]:
    """Any number of values a side, separated by commas; a plain one holds on both: left:k3,right:focal, aspect.

    Raises: InputError where a plain one follows one of a side in the same word, which may be meant either way.
    """
    out: dict[str, list[str]] = {side: [] for side in SIDES}
    for word in values:
        before = ""
        for value in (v.strip() for v in word.split(",") if v.strip()):
            match = _SIDE.match(value)
            if match is None and before:
                raise InputError(
                    f"{option} {word}: is {value!r} of the {before} camera or of both? Write {before}:{value}, or "
                    f"{option} {value} apart"
                )
            before = match["side"] if match else ""
            for side in [match["side"]] if match else SIDES:
                out[side].append(match["value"] if match else value)
    return {side: tuple(names) for side, names in out.items()}
