"""Records as JSON and back: defaults are left out, every wrong kind is named with its place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isnan, nan
from typing import Any

import pytest

from calibrant.data.typed_json import as_json, from_json
from calibrant.errors import InputError


@dataclass(frozen=True)
class Part:
    """A part."""

    name: str
    size: float = nan
    count: int = 1


@dataclass(frozen=True)
class Whole:
    """A whole."""

    parts: tuple[Part, ...]
    pair: tuple[float, float] = (0.0, 1.0)
    by_name: Mapping[str, Part] = field(default_factory=dict)
    note: str | None = None
    on: bool = False


def test_a_record_comes_back() -> None:
    whole = Whole((Part("a", 2.5), Part("b")), (1.0, 2.0), {"x": Part("c", count=3)}, "said", True)
    data = as_json(whole)
    assert data["parts"] == [{"name": "a", "size": 2.5}, {"name": "b"}]
    assert as_json(Whole(())) == {"parts": []}
    back = from_json(Whole, data, "whole")
    assert (back.pair, back.note, back.on) == ((1.0, 2.0), "said", True)
    assert (back.by_name["x"].name, back.by_name["x"].count) == ("c", 3)
    assert isnan(back.by_name["x"].size)
    assert back.parts[0] == whole.parts[0]
    assert from_json(Whole, {"parts": [], "pair": [1, 2], "note": None}, "whole").pair == (1.0, 2.0)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ([], r"whole is \[\], expected an object"),
        ({}, "whole has no key 'parts'; it has: none"),
        ({"parts": [], "colour": 1}, "whole has the key 'colour'; expected: parts, pair"),
        ({"parts": {}}, r"whole\.parts is \{\}, expected a list"),
        ({"parts": [{"name": 3}]}, r"whole\.parts\[0\]\.name is 3, expected text"),
        ({"parts": [{"name": "a", "size": True}]}, r"parts\[0\]\.size is true, expected a number"),
        ({"parts": [{"name": "a", "count": 1.5}]}, r"parts\[0\]\.count is 1\.5, expected an integer"),
        ({"parts": [], "pair": [1]}, r"whole\.pair is \[1\], expected 2 values"),
        ({"parts": [], "by_name": []}, r"whole\.by_name is \[\], expected an object"),
        ({"parts": [], "by_name": {"x": {}}}, r"whole\.by_name\.x has no key 'name'"),
        ({"parts": [], "on": 1}, r"whole\.on is 1, expected true or false"),
    ],
)
def test_what_is_of_another_kind_is_named_with_its_place(data: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        from_json(Whole, data, "whole")
