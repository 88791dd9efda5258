"""AprilGrids that cannot be: what is wrong with them, in words."""

from __future__ import annotations

import pytest

from calibrant.errors import InputError
from calibrant.targets.aprilgrid import AprilGrid
from calibrant.targets.registry import parse_target


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"columns": 0}, "an AprilGrid needs at least one tag, got 0x6"),
        ({"tag": -0.03}, "the tag's side"),
        ({"spacing": 1.2}, "the gap between tags over a tag's side, above 0 and below 1; got 1.2"),
        ({"border": 3}, "the border of the tags is 1 or 2 cells wide, got 3"),
        ({"columns": 60, "rows": 60}, "a grid of 60x60 tags needs 3600 ids, .* has only 587"),
    ],
)
def test_a_grid_that_cannot_be(changed: dict[str, float], message: str) -> None:
    whole = {"columns": 6, "rows": 6, "tag": 0.03, "spacing": 0.3, "dictionary": "DICT_APRILTAG_36h11"}
    with pytest.raises(InputError, match=message):
        AprilGrid(**{**whole, **changed})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("aprilgrid:6x6:30mm:wide:36h11", "the spacing of an AprilGrid is the gap between tags over a"),
        ("aprilgrid:6x6:30mm:0.3:36h11:border=7", "unknown option 'border=7' of an AprilGrid"),
    ],
)
def test_a_spec_that_says_no_grid(spec: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_target(spec)
